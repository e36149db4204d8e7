"""The prior of hands: mirrored, with wrists that move, and as the script writes it."""

import numpy as np
import pytest
from simulated.hands import BODY, LEFT, RIGHT

from lassokin_ros.core.body.roles import FINGER_JOINTS
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.pose_prior import HAND_MOTION, OTHER_DEVIATION, WRIST_DEVIATION, PoseDistribution
from lassokin_ros.core.yaml_files import shipped_mapping
from training.hand_prior import prior


def test_the_shipped_file_is_that_of_the_script():
    names, mean, covariance, motion = prior()
    data = shipped_mapping("lassokin_ros.core.evidence", "priors/hands.yaml")
    assert data["angles"] == names and len(names) == 21
    assert np.allclose(data["mean"], mean, atol=5e-4) and np.allclose(data["motion"], motion, atol=5e-4)
    assert np.allclose(np.concatenate(data["covariance"]), covariance[np.tril_indices(21)], rtol=1e-4)
    assert np.linalg.eigvalsh(covariance).min() > 1e-3


def test_the_right_hand_is_the_mirror_image_of_the_left_one():
    left, right = PoseDistribution.load(LEFT), PoseDistribution.load(RIGHT)
    mirror = np.array([1.0, -1.0, -1.0])
    assert np.allclose(left.mean * mirror, right.mean)
    signs = np.tile(mirror, LEFT.joint_count)
    assert np.allclose(left.covariance * np.outer(signs, signs), right.covariance)
    assert left.mean[LEFT.index("left_index2"), 2] < -0.5  # bent to the palm
    assert left.motion[:3] == pytest.approx(HAND_MOTION)


def test_in_the_body_wrists_move_and_the_rest_is_as_without_hands():
    plain, hands = PoseDistribution.load(Skeleton.load("anthropometric", 1.75)), PoseDistribution.load(BODY)
    for side in ("left", "right"):
        own = slice(3 * BODY.index(f"{side}_wrist"), 3 * BODY.index(f"{side}_wrist") + 3)
        assert np.allclose(np.sqrt(np.diagonal(hands.covariance)[own]), WRIST_DEVIATION)
        assert np.abs(np.delete(hands.covariance[own], np.r_[own], axis=1)).max() == 0
    wrists = np.r_[60:66]
    others = np.delete(np.arange(72), wrists)
    assert np.array_equal(hands.covariance[np.ix_(others, others)], plain.covariance[np.ix_(others, others)])
    assert np.array_equal(hands.motion[others], plain.motion[others])
    fingers = BODY.index("left_index1")
    alone = PoseDistribution.load(LEFT)
    assert np.array_equal(hands.covariance[3 * fingers : 3 * fingers + 45, 3 * fingers : 3 * fingers + 45],
                          alone.covariance[3:, 3:])  # fmt: skip


def test_ball_joints_of_a_users_skeleton_hardly_turn_about_other_axes():
    joints = [{"name": "left_wrist", "parent": None, "position": [0, 0, 0]}]
    for name in FINGER_JOINTS:
        parent = "left_wrist" if name.endswith("1") else f"left_{name[:-1]}{int(name[-1]) - 1}"
        joints.append({"name": f"left_{name}", "parent": parent, "position": [0.01 * len(joints), 0, 0]})
    prior = PoseDistribution.load(Skeleton.from_mapping({"joints": joints}, 1.75))
    deviation = np.sqrt(np.diagonal(prior.covariance)).reshape(-1, 3)
    assert deviation[2, :2] == pytest.approx(OTHER_DEVIATION) and deviation[2, 2] > 0.5
