"""Keypoints repeated with a new stamp: they get an output but are no evidence. And a frozen camera."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body
from sequences import CONFIG, FOCAL, RATE, WITHOUT_NETWORK, frame, observations, same

from lassokin_ros.core.image.measurement import MeasurementFilter
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import Observation, Status
from lassokin_ros.core.tracker import Tracker

NOW = replace(CONFIG, smoothing=0.0)


def tracked(seconds=2.0, config=CONFIG):
    """(a tracker that has tracked the synthetic motion, its last observation)."""
    tracker = Tracker(config)
    sequence = [observation for _, observation in observations(tracker, seconds)]
    for observation in sequence:
        assert tracker.track(observation).repeated == 0
    return tracker, sequence[-1]


def later(observation, seconds):
    return replace(observation, stamp=observation.stamp + seconds)


def test_the_age_is_that_of_bitwise_equal_keypoints():
    measurements = MeasurementFilter(body())
    points, confidence = np.full((2, 2), np.nan), np.ones(2)

    def age(stamp, confidence):
        return measurements._age(Observation(stamp, points.copy(), confidence, FOCAL))

    ages = [age(stamp, confidence) for stamp in (1.0, 1.5, 3.0)]
    other = np.array([1.0, np.nextafter(1.0, 2.0)])
    ages += [age(3.5, other), age(4.0, other)]
    measurements.forget()
    assert [*ages, age(5.0, other)] == [0.0, 0.5, 2.0, 0.0, 0.5, 0.0]


def test_detecting_repeated_keypoints_improves_tracking_with_a_slow_detector(times=4):
    """Image error relative to the true points at each frame's own stamp."""
    errors = []
    for trifle in (0.0, 1e-12):  # makes them new
        tracker = Tracker(replace(CONFIG, noise_px=1.0))
        sequence = [observation for _, observation in observations(tracker, 6.0, noise_px=0.5)]
        exact = [observation for _, observation in observations(tracker, 6.0, noise_px=0.0)]
        mine = []
        for i, observation in enumerate(sequence):
            points = sequence[i - i % times].points + trifle * (i % times)
            estimate = tracker.track(replace(observation, points=points))
            assert estimate.accepted and estimate.certificate.kkt_residual <= 1e-6
            assert (estimate.repeated > 0) == (trifle == 0 and i % times > 0)
            mine.append(np.linalg.norm(project(estimate.pose.landmarks) - exact[i].points, axis=-1).mean() * FOCAL)
        errors.append(np.mean(mine))
    assert errors[0] < 0.9 * errors[1]


def test_a_repeated_frame_is_not_used_for_learning():
    (once, last), (twice, _) = tracked(config=NOW), tracked(config=NOW)
    learned = twice.learned
    vertical, motion = learned.vertical.direction.copy(), learned.lengths.kept_motion
    mean = learned.mean_pose.mean.copy()
    lengths, deviation = learned.lengths.skeleton.offsets, learned.model_error.deviation
    for i in range(30):
        twice.track(later(last, (i + 1) / 60))
    assert np.array_equal(learned.vertical.direction, vertical) and learned.lengths.kept_motion == motion
    assert np.array_equal(learned.lengths.skeleton.offsets, lengths) and learned.model_error.deviation == deviation
    assert np.array_equal(learned.mean_pose.mean, mean) and np.array_equal(once.learned.mean_pose.mean, mean)
    assert np.array_equal(
        twice._cameras[0].measurements.filter._tracks.velocity,
        once._cameras[0].measurements.filter._tracks.velocity,
    )


@pytest.mark.parametrize("config", [replace(WITHOUT_NETWORK, smoothing=0.0), NOW])
def test_repeated_keypoints_are_no_evidence_of_a_standstill(config):
    """With half of the frames repeated, the state is about the same as without these frames.

    Feet are not held: they would keep the distance at which they were when their contact began.
    """
    config = replace(config, hold_feet=False)
    with_repeats, without, distances = Tracker(config), Tracker(config), []
    sequence = [observation for _, observation in observations(without, 4.0)]
    for i, observation in enumerate(sequence[::2]):
        expected = without.track(observation)
        estimate = with_repeats.track(observation)
        if i > 5:
            apart = np.linalg.norm(estimate.pose.positions - expected.pose.positions, axis=-1).mean()
            assert apart < 0.06
            distances.append(apart)
        with_repeats.track(later(observation, 1 / RATE))
    assert np.mean(distances) < 0.015


def test_frozen_keypoints_keep_the_pose_and_report_their_age():
    tracker, last = tracked()
    answers = [tracker.track(later(last, 0.1 * (i + 1))) for i in range(100)]
    assert all(a.accepted and a.status is Status.TRACKING and not a.initialised for a in answers)
    assert np.allclose([a.repeated for a in answers], 0.1 * np.arange(1, 101))
    assert np.abs(answers[-1].pose.positions - answers[10].pose.positions).max() < 0.1
    assert np.abs(answers[-1].pose.positions - answers[-2].pose.positions).max() < 1e-3
    moves_on = replace(later(last, 10.1), points=last.points + 1e-3)
    assert tracker.track(moves_on).initialised  # the motion in between is unknown


def test_the_cost_of_repeated_keypoints_is_that_of_the_last_new_ones():
    """They are no measurement, so that the fit says no more about the pose than it did."""
    tracker, last = tracked()
    new = tracker.track(replace(later(last, 0.1), points=last.points + 1e-3))
    again = tracker.track(replace(later(last, 0.2), points=last.points + 1e-3))
    assert new.repeated == 0 < again.repeated and new.cost == again.cost


def test_a_single_frame_repeated_gives_a_constant_pose():
    """As with `ros2 topic pub`: the velocity of the first frame is unknown, and the points still count."""
    tracker = Tracker(CONFIG)
    first = tracker.track(frame(tracker))
    for i in range(60):
        answer = tracker.track(frame(tracker, (i + 1) / RATE))
    assert answer.accepted and np.abs(answer.pose.positions - first.pose.positions).max() < 0.1


def test_equal_keypoints_after_a_rejected_start_or_a_gap_are_used():
    tracker = Tracker(replace(CONFIG, lost_after=0.5))
    good = frame(tracker)
    tracker.tune(replace(tracker.config, min_landmarks=18))
    assert not tracker.track(good).accepted
    tracker.tune(replace(tracker.config, min_landmarks=4))
    assert tracker.track(later(good, 0.1)).repeated == 0
    assert tracker.track(later(good, 0.2)).repeated == pytest.approx(0.1)
    learned = tracker.learned.model_error.deviation
    found = tracker.track(later(good, 2.0))
    assert found.initialised and found.repeated == 0
    fresh = Tracker(tracker.config)
    fresh.learned.model_error.deviation = learned  # it is the same detector
    assert same(fresh.track(later(good, 2.0)).state, found.state)
