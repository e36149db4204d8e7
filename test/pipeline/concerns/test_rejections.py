"""The text for a rejected frame contains numbers and the expected values, and no internal keys."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, frame

from lassokin_ros.core.lasso import solver
from lassokin_ros.core.observation import CameraPose, Rejection
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.concerns.rejections import rejection_text

FEWEST = "expected 4 or more (min_landmarks)"


def with_landmarks(observation, count):
    """An observation with only this number of visible landmarks."""
    seen = np.where(np.arange(len(observation.confidence)) < count, observation.confidence, 0.0)
    return replace(observation, confidence=seen)


def spoilt(rejection, used):
    """Observations that a tracker rejects for this reason, and words that the text must contain."""
    later = replace(used, stamp=used.stamp + 1 / 30)
    small = replace(later, points=1e-3 * used.points, stamp=used.stamp + 10.0)
    return {
        Rejection.TOO_FEW_LANDMARKS: (
            with_landmarks(later, 3),
            f"3 landmarks at or above min_confidence 0.2; {FEWEST}",
        ),
        Rejection.TOO_SMALL: (
            small,
            "smaller than the noise, or behind the camera; expected 6 px (3 noise_px) or more",
        ),
        Rejection.NOT_CERTIFIED: (later, "the optimum was not proved, its KKT residual is "),
        Rejection.OLD_STAMP: (used, "the stamp is not newer than the last one; expected a newer one"),
        Rejection.LATE: (replace(used, camera=CameraPose("other")), "is not newer than the last one used, of another"),
        Rejection.UNPLACED: (
            replace(later, camera=CameraPose("right", known=False)),
            "the pose of camera 'right' is unknown; expected",
        ),
        Rejection.NOT_FINITE: (replace(later, focal=np.inf), "the focal length inf px; expected finite numbers"),
        Rejection.WRONG_SHAPE: (replace(later, points=later.points[:5]), "points (5, 2), confidence (17,); "),
    }[rejection]


@pytest.mark.parametrize("rejection", Rejection)
def test_every_rejection_is_described_with_the_expected_values(rejection, monkeypatch):
    tracker = Tracker(CONFIG)
    assert tracker.track(frame(tracker)).accepted
    observation, words = spoilt(rejection, frame(tracker))
    if rejection is Rejection.NOT_CERTIFIED:
        monkeypatch.setattr(solver, "KKT_TOLERANCE", -1.0)
    answer = tracker.track(observation)
    assert answer.rejection is rejection
    said = rejection_text(answer, observation, CONFIG)
    assert words in said and "expected" in said and rejection.value not in said and "\n" not in said


def test_invisible_landmarks_are_described():
    tracker = Tracker(CONFIG)
    observation = with_landmarks(frame(tracker), 5)
    observation = replace(observation, points=1e3 * observation.points)
    said = rejection_text(tracker.track(observation), observation, CONFIG)
    assert said.startswith(
        "0 landmarks at or above min_confidence 0.2, and 5 outside any field of view, as with camera_info of another "
        "camera; expected 4 or more"
    )


def test_enough_landmarks_far_from_their_tracks_are_described():
    """Four are left, two of them far off twice, when the tracks of the others have ended."""
    tracker = Tracker(CONFIG)
    first = frame(tracker)
    away = first.points.copy()
    away[:2] += 0.4
    answers = []
    for stamp, points in ((0.0, first.points), (0.2, first.points), (0.29, away), (0.35, away)):
        moved = points + 1e-3 * stamp  # otherwise they would be repeated keypoints
        observation = replace(with_landmarks(first, 17 if stamp == 0.0 else 4), points=moved, stamp=stamp)
        answers.append(tracker.track(observation))
    assert [answer.accepted for answer in answers] == [True, True, True, False]
    said = rejection_text(answers[-1], observation, CONFIG)
    assert said.startswith("4 landmarks at or above min_confidence 0.2, but some of them are far from their tracks")
