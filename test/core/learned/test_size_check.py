"""The check of a given height against measured depth: it finds the true size, whatever the pose does."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body
from sequences import CONFIG, observations

from lassokin_ros.core.learned.height import FEWEST_FRAMES, SizeCheck
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion


def tracked(given, true, seconds=4.0):
    """A tracker with a given height, after seconds of a person of the true height with measured depth."""
    body, tracker = Tracker(replace(CONFIG, height=true)), Tracker(replace(CONFIG, height=given))
    noise = np.random.default_rng(1)
    for _, observation in observations(body, seconds):
        landmarks = body.kinematics.pose(motion(body.skeleton, np.array([observation.stamp]))).landmarks[0]
        depth = landmarks[:, 2] + 0.02 * noise.normal(size=len(landmarks))
        assert tracker.track(replace(observation, depth=depth)).accepted
    return tracker


@pytest.mark.parametrize("given, true, wrong", [(1.75, 1.75, False), (1.9, 1.6, True), (1.6, 1.9, True)])
def test_a_wrong_height_is_found_and_the_right_one_is_not_doubted(given, true, wrong):
    check = tracked(given, true).learned.size_check
    assert check.wrong is wrong and check.ratio == pytest.approx(true / given, rel=0.04)


def test_there_is_no_result_before_enough_frames_or_after_a_reset():
    tracker = tracked(1.9, 1.6, 1.0)
    assert len(tracker.learned.size_check._ratios) < FEWEST_FRAMES
    assert tracker.learned.size_check.ratio == 1.0 and not tracker.learned.size_check.wrong
    tracker = tracked(1.9, 1.6)
    tracker.reset()
    assert not tracker.learned.size_check.wrong


def test_without_depth_nothing_is_checked():
    tracker = Tracker(CONFIG)
    for _, observation in observations(tracker, 1.0):
        tracker.track(observation)
    assert not tracker.learned.size_check._ratios


@pytest.mark.parametrize("visible", [slice(None), slice(0, 11)], ids=["body", "upper body"])
def test_depths_on_occluders_cause_no_doubt(visible):
    """Of each frame's depths, 15 % are 0.2 to 1 m too near."""
    tracker, random = Tracker(CONFIG), np.random.default_rng(2)
    for _, observation in observations(tracker, 5.0):
        landmarks = tracker.kinematics.pose(motion(tracker.skeleton, np.array([observation.stamp]))).landmarks[0]
        depth = landmarks[:, 2] + 0.03 * random.normal(size=17)
        depth -= (random.random(17) < 0.15) * random.uniform(0.2, 1.0, 17)
        confidence = np.zeros(17)
        confidence[visible] = 1.0
        tracker.track(replace(observation, depth=depth, confidence=confidence))
    assert len(tracker.learned.size_check._ratios) >= FEWEST_FRAMES and not tracker.learned.size_check.wrong


def test_lengths_are_those_of_limbs_and_trunk_without_implausible_ones():
    tracker = Tracker(CONFIG)
    check, names = tracker.learned.size_check, tracker.layout.names
    places = tracker.kinematics.pose(motion(tracker.skeleton, np.zeros(1))).landmarks[0]
    usable = np.ones(len(names), dtype=bool)
    measured, given = check.lengths(1.1 * places, usable)
    assert len(measured) == check.limb_count(usable) + 2  # both sides of the trunk
    assert measured.sum() == pytest.approx(1.1 * given.sum(), rel=0.01)
    places[names.index("left_wrist")] += 1.0
    usable[names.index("right_shoulder")] = False
    assert len(check.lengths(places, usable)[0]) == len(measured) - 3  # a forearm, an upper arm and a side
    check.use(tracker.skeleton.scaled(0.8))
    assert check.lengths(places, np.ones(len(names), dtype=bool))[1].max() == pytest.approx(0.8 * given.max())


def test_ratios_of_other_sources_count_once_in_a_tenth_of_a_second():
    check = SizeCheck(body())
    for number in range(40):
        check.add(0.05 * number, np.array([0.7]))
    assert len(check._ratios) == 20 and check.wrong and check.ratio == pytest.approx(0.7)
