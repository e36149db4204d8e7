"""Observed joints and the probability of a failure."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, observations
from test_uncertainty import followed, replace_points

from benchmarks.accuracy_run.failure_probability import area
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.output.uncertainty import ObservedJoints, failure_probability
from lassokin_ros.core.tracker import Tracker

SKELETON = Skeleton.load("anthropometric", 1.75)
LIMB_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
LIMBS = {f"{side}_{joint}" for side in ("left", "right") for joint in LIMB_JOINTS}


def names_by(method, visible, layout="coco17"):
    landmarks = Layout.load(layout, SKELETON)
    seen = np.isin(landmarks.names, list(visible))
    assert np.count_nonzero(seen) == len(set(visible))
    found = method(ObservedJoints(SKELETON, landmarks.joints), seen)
    return {SKELETON.joint_names[i] for i in np.flatnonzero(found)}


def observed(visible, layout="coco17"):
    return names_by(ObservedJoints.from_visible, visible, layout)


def test_all_joints_between_cocos_landmarks_are_observed():
    assert observed(Layout.load("coco17", SKELETON).names) == LIMBS | {"head", "pelvis"}


@pytest.mark.parametrize(
    "visible, expected",
    [
        ((), set()),
        (("nose",), {"head"}),
        (("left_shoulder", "left_wrist"), {"left_shoulder", "left_wrist", "left_elbow"}),
        (("left_shoulder", "left_elbow"), {"left_shoulder", "left_elbow"}),
        (("left_hip", "right_hip"), {"left_hip", "right_hip", "pelvis"}),
        (("left_hip", "left_ankle", "right_knee"), {"left_hip", "left_ankle", "left_knee", "right_knee"}),
    ],
)
def test_a_joint_between_two_visible_ones_is_observed(visible, expected):
    assert observed(visible) == expected


def test_landmarks_at_trunk_and_feet_make_more_joints_observed():
    assert observed(("neck", "mid_hip"), "body25") == {"spine3", "pelvis"}
    assert observed(("left_big_toe",), "body25") == {"left_ankle"}


def test_a_tracked_frame_has_its_observed_joints():
    tracker, estimate = followed(("left_wrist",))
    names = [tracker.skeleton.joint_names[i] for i in np.flatnonzero(~tracker.observed(estimate))]
    assert {"left_wrist", "left_hand", "right_hand"} <= set(names) and "right_wrist" not in names
    refused = tracker.track(replace_points(tracker, estimate))
    with pytest.raises(ValueError, match="rejected"):
        tracker.observed(refused)


ENDS = {f"{side}_{joint}" for side in ("left", "right") for joint in ("foot", "hand")}


@pytest.mark.parametrize(
    "hidden, expected",
    [
        ((), set()),
        (("left_wrist",), {"left_wrist"}),
        (("left_elbow",), set()),
        (("right_knee", "right_ankle"), {"right_knee", "right_ankle"}),
        (("right_knee",), set()),
        (("nose", "left_eye", "right_eye", "left_ear", "right_ear"), {"neck", "head"}),
    ],
)
def test_joints_below_the_last_visible_keypoint(hidden, expected):
    visible = set(Layout.load("coco17", SKELETON).names) - set(hidden)
    assert names_by(ObservedJoints.below_last_keypoint, visible) == expected | ENDS


def test_without_keypoints_all_joints_are_below_the_last_one():
    assert names_by(ObservedJoints.below_last_keypoint, ()) == set(SKELETON.joint_names)


@pytest.mark.parametrize(
    "hidden, expected",
    [
        ((), set()),
        (("left_wrist",), {"left_elbow"}),
        (("left_elbow", "left_wrist"), {"left_elbow", "left_shoulder"}),
        (("left_elbow",), set()),
        (("right_knee", "right_ankle"), {"right_knee", "right_hip"}),
        (("nose", "left_eye", "right_eye", "left_ear", "right_ear"), {"neck", "head"}),
    ],
)
def test_joints_of_which_no_visible_keypoint_shows_the_rotation(hidden, expected):
    visible = set(Layout.load("coco17", SKELETON).names) - set(hidden)
    turned = {f"{side}_{joint}" for side in ("left", "right") for joint in ("ankle", "wrist")}
    assert names_by(ObservedJoints.beyond_last_keypoint, visible) == expected | turned | ENDS


def test_the_probability_grows_with_deviation_and_learned_error():
    values = [failure_probability(deviation, 3.0, 1.5) for deviation in (0.0, 0.03, 0.06, 0.12, 0.35, 1.0, 1e6)]
    assert values == sorted(values) and values[0] >= 0 and values[1] < 0.02 and 0.9 < values[4] < values[-1] <= 1
    assert np.isnan(failure_probability(float("nan"), 1.0, 1.0))
    for figures in ([(0.08, ratio, 1.5) for ratio in (1, 2, 8)], [(0.08, 3.0, cost) for cost in (0, 1.0, 30.0)]):
        least, more, most = (failure_probability(*f) for f in figures)
        assert 0 < least < more < most < 1


def test_a_person_has_a_lower_probability_than_shuffled_keypoints():
    tracker, shuffled = Tracker(CONFIG), Tracker(CONFIG)
    order = np.random.default_rng(0).permutation(17)
    good, bad = [], []

    def stated(tracker, observation):
        return tracker.uncertainty(tracker.track(observation)).failure_probability

    for _, observation in observations(tracker, 1.0):
        good.append(stated(tracker, observation))
        bad.append(stated(shuffled, replace(observation, points=observation.points[order])))
    assert np.median(good) < 0.1 and np.nanmedian(bad) > 0.5


def test_the_area_under_the_curve_ranks_wrong_poses():
    score, positive = np.array([1.0, 2.0, 3.0, 4.0]), np.array([False, False, True, True])
    assert area(score, positive) == 1 and area(-score, positive) == 0 and area(0 * score, positive) == 0.5
    assert area(np.array([1.0, 3.0, 2.0, 4.0]), positive) == 0.75
