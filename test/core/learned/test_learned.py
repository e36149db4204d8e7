"""All that is learned together: what a new height keeps, what a reset forgets."""

from dataclasses import replace

import numpy as np
import pytest
from cases import scaled_forearms
from sequences import CONFIG, observations

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

TRUE_HEIGHT = 1.9


def person(seconds, height=TRUE_HEIGHT, seed=0):
    """(true joints, observation with measured depth) of a person with other proportions than the built-in ones."""
    skeleton = scaled_forearms(Skeleton.load("anthropometric", height), 1.15)
    truth = Tracker(replace(CONFIG, height=height), skeleton)
    noise = np.random.default_rng(seed)
    frames = []
    for joints, observation in observations(truth, seconds):
        landmarks = truth.kinematics.pose(motion(truth.skeleton, np.array([observation.stamp]))).landmarks[0]
        depth = landmarks[:, 2] + 0.02 * noise.normal(size=len(landmarks))
        frames.append((joints, replace(observation, depth=depth)))
    return frames


def known(tracker):
    """What does not depend on the size: log-lengths, mean posture, relative model error, kept frames."""
    learned = tracker.learned
    lengths, error = learned.lengths, learned.model_error
    return [lengths.lengths, lengths.deviation, learned.mean_pose.mean, error.ratio, error._known, len(lengths._frames)]


def test_a_measured_height_scales_what_was_learned():
    """Nothing is learned anew after it is adopted."""
    tracker = Tracker(replace(CONFIG, height=0.0))
    for _, observation in person(3.0):
        assert tracker.track(observation).accepted
    before, height, solved = known(tracker), tracker.skeleton.height, tracker._solved
    assert height == pytest.approx(TRUE_HEIGHT, rel=0.05)
    assert np.abs(before[0]).max() > 0.01 and before[-1] > 10 and before[4] > 1
    tracker.learned.feet._begun = [0.0, None]
    tracker._resize(1.1, np.zeros(3))
    assert all(np.allclose(one, other, rtol=1e-12, atol=0) for one, other in zip(before, known(tracker)))
    assert tracker.skeleton.height == pytest.approx(1.1 * height) and not any(tracker.learned.feet.standing)
    assert np.array_equal(tracker._solved.state.rotations, solved.state.rotations)
    assert np.allclose(tracker._solved.pose.landmarks, 1.1 * solved.pose.landmarks, rtol=1e-9, atol=1e-9)


def test_a_reset_forgets_the_person_and_the_camera_only_if_asked():
    tracker = Tracker(replace(CONFIG, height=0.0))
    fresh = Tracker(replace(CONFIG, height=0.0))
    for same_camera in (True, False):
        for _, observation in person(3.0):
            tracker.track(observation)
        learned, direction = tracker.learned, tracker.learned.vertical.direction
        assert learned.height.measured and learned.lengths.lengths.any() and learned.model_error._known > 1
        tracker.reset(same_camera)
        assert not learned.height.measured and not learned.lengths.lengths.any()
        assert np.array_equal(learned.mean_pose.mean, fresh.learned.mean_pose.mean)
        assert learned.model_error.deviation == pytest.approx(fresh.learned.model_error.deviation)
        assert tracker._cameras[0].depth_noise.factor == 1.0 and learned.size_check.ratio == 1.0
        assert np.allclose(tracker.skeleton.offsets, fresh.skeleton.offsets, rtol=1e-12)
        assert (learned.vertical.direction is direction) == same_camera


def test_a_new_configured_height_scales_the_given_body():
    """It makes the tracker forget the person; the tree and the proportions of an own skeleton stay."""
    own = scaled_forearms(Skeleton.load("anthropometric", 1.75), 1.2)
    tracker = Tracker(replace(CONFIG, height=1.75), own)
    for _, observation in person(1.0, 1.75):
        tracker.track(observation)
    tracker.tune(replace(CONFIG, height=1.4))
    assert tracker.state is None and tracker.skeleton.height == pytest.approx(1.4)
    assert np.allclose(tracker.skeleton.offsets, own.offsets * 1.4 / 1.75, rtol=1e-12)
    fresh = Tracker(replace(CONFIG, height=1.4), own.at_height(1.4))
    assert tracker.learned.model_error.deviation == pytest.approx(fresh.learned.model_error.deviation)
    for (_, observation), _ in zip(person(1.0, 1.4), range(20)):
        a, b = tracker.track(observation), fresh.track(observation)
        assert np.allclose(a.pose.positions, b.pose.positions, atol=1e-6)
