"""Properties of the tracker that hold for any motion: what may not change an answer, and what moves it along."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, WITHOUT_NETWORK, detected
from test_who_sees import UP, A, B, Scene

from lassokin_ros.core.body.proportions import partners
from lassokin_ros.core.tracker import Tracker

SETTINGS = {"network": CONFIG, "no network": WITHOUT_NETWORK}


@pytest.fixture(scope="module")
def seen():
    """5 s of the demo's detector, with points that are missing, swapped and off."""
    return detected(5.0)[1]


def answers(tracker, frames):
    """(f, n, 3) m: the joints of each frame, NaN for a rejected one."""
    found = []
    for images in frames:
        estimate = tracker.track(images)
        found.append(estimate.pose.positions if estimate.accepted else np.full((24, 3), np.nan))
    assert np.isfinite(found[-1]).all()
    return np.array(found)


def apart(one, other):
    """m: the largest distance of a joint in any frame. The same frames must be accepted."""
    assert np.array_equal(np.isnan(one), np.isnan(other))
    return float(np.nanmax(np.linalg.norm(one - other, axis=-1)))


@pytest.mark.parametrize("settings", SETTINGS)
def test_the_time_of_day_does_not_change_the_poses(seen, settings):
    """Of a date of today, stamps as floats are rounded to 0.2 us; 0.1 and 0.2 s are whole numbers of frames."""
    later = [replace(one, stamp=one.stamp + 1.7e9) for one in seen]
    found = [answers(Tracker(SETTINGS[settings]), frames) for frames in (seen, later)]
    assert apart(*found) < 2e-3


def test_a_reset_tracker_equals_a_new_one(seen):
    for config in SETTINGS.values():
        tracker, new = Tracker(config), Tracker(config)
        answers(tracker, seen[:101])
        tracker.reset()
        assert np.array_equal(answers(tracker, seen[:40]), answers(new, seen[:40]), equal_nan=True)


def test_a_reset_tracker_of_two_cameras_and_unknown_height_equals_a_new_one():
    scene = Scene(2.0, height=1.9)
    frames = [[scene.seen(index, camera, depth=True) for camera in (A, B)] for index in range(len(scene.times))]
    config = replace(CONFIG, height=0.0)
    tracker, new = Tracker(config, up=UP), Tracker(config, up=UP)
    answers(tracker, frames)
    assert tracker.skeleton.height > 1.8
    tracker.reset()
    assert apart(answers(tracker, frames[:20]), answers(new, frames[:20])) < 1e-6


def test_a_camera_that_sees_nobody_does_not_change_the_poses():
    scene = Scene(1.0)
    alone = [scene.seen(index, A) for index in range(len(scene.times))]
    both = [[one, scene.seen(index, B, shown=False)] for index, one in enumerate(alone)]
    assert apart(*(answers(Tracker(CONFIG, up=UP), frames) for frames in (alone, both))) < 1e-9


def mirrored(observation, names):
    other = partners(names)
    points, confidence = observation.points[other] * [-1.0, 1.0], observation.confidence[other]
    return replace(observation, points=points, confidence=confidence)


@pytest.mark.parametrize("settings, tolerance", [("network", 0.1), ("no network", 1e-6)])
def test_a_mirrored_person_has_mirrored_poses(seen, settings, tolerance):
    """Nearly, with the network: the whitening of its depths has no symmetry."""
    tracker, other = (Tracker(SETTINGS[settings]) for _ in range(2))
    names, joints = tracker.layout.names, partners(tracker.skeleton.joint_names)
    one = answers(tracker, seen[:60])
    two = answers(other, [mirrored(frame, names) for frame in seen[:60]])[:, joints] * [-1.0, 1.0, 1.0]
    assert apart(one, two) < tolerance
