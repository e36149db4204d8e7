"""The pose that the networks of body and hand see, as a state."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import body, one_view, random_state
from sequences import CONFIG, observations
from simulated.hands import BODY, hand_tracker, kinematics_of, scene, seen

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.roles import LIMB_BONES, NETWORK_JOINTS
from lassokin_ros.core.body.rotations import exponential, logarithm
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.initialisation import SAME_POSE, HandPose, NetworkPose, state_at, trunk_orientation
from lassokin_ros.core.network.depth_network import PLACES
from lassokin_ros.core.network.hand_network import HandEstimator
from lassokin_ros.core.observation import HERE
from lassokin_ros.core.tracker import Tracker

KINEMATICS = body()
MEAN = exponential(PoseDistribution.load(KINEMATICS.skeleton).mean)


def positions_of(pose):
    """The joints of a pose relative to the middle of the hips, by name, as the network gives them."""
    index = KINEMATICS.skeleton.index
    hips = 0.5 * (pose.positions[index("left_hip")] + pose.positions[index("right_hip")])
    return {name: pose.positions[index(name)] - hips for name in sorted(NETWORK_JOINTS)}


def distance(positions, pose, kinematics=KINEMATICS):
    """The distance of a pose from positions that a network gives."""
    return NetworkPose(lambda: places_of(positions), kinematics, MEAN).distance(pose)


def places_of(positions):
    """The array that a network gives, from positions by name. The nose, which is no joint, is not needed."""
    return np.array([positions.get(name, [np.nan] * 3) for name in PLACES])


def pose_of(seed, spread=0.3):
    return KINEMATICS.pose(random_state(np.random.default_rng(seed), KINEMATICS, spread))


@pytest.mark.parametrize("seed", range(4))
def test_the_bones_of_the_limbs_point_along_the_networks_positions(seed):
    pose, index = pose_of(seed), KINEMATICS.skeleton.index
    state = state_at(positions_of(pose), KINEMATICS.skeleton, MEAN)
    found = KINEMATICS.pose(state).positions
    assert np.array_equal(state.translation, np.zeros(3))
    for joint, end in LIMB_BONES:
        one, other = (p[index(end)] - p[index(joint)] for p in (found, pose.positions))
        assert np.allclose(one / np.linalg.norm(one), other / np.linalg.norm(other), atol=1e-9)
    orthogonal = state.rotations.swapaxes(1, 2) @ state.rotations
    assert np.abs(orthogonal - np.eye(3)).max() < 1e-7 and np.linalg.det(state.rotations).min() > 0
    others = np.setdiff1d(np.arange(1, 24), [index(joint) for joint, _ in LIMB_BONES])
    assert np.array_equal(state.rotations[others], MEAN[others])


def test_the_trunk_is_that_of_hips_and_shoulders():
    positions = positions_of(KINEMATICS.pose(BodyState(np.tile(np.eye(3), (24, 1, 1)), np.zeros(3))))
    turn = exponential(np.array([0.3, -0.9, 0.4]))
    rest = trunk_orientation(positions)
    assert np.degrees(np.arccos(np.diag(rest).min())) < 5  # x left, y up, z to the front
    turned = trunk_orientation({name: turn @ place for name, place in positions.items()})
    assert np.allclose(turned, turn @ rest, atol=1e-6)


def test_the_distance_is_the_mean_of_the_joints_with_the_hips_aligned():
    pose = pose_of(1)
    positions = positions_of(pose)
    assert distance(positions, pose) < 1e-12
    moved = replace(pose, positions=pose.positions + [1.0, -2.0, 0.5])
    assert distance(positions, moved) < 1e-12
    positions["left_wrist"] = positions["left_wrist"] + [0.0, 0.0, 0.3 * len(positions)]
    assert distance(positions, pose) == pytest.approx(0.3)


def test_wrists_that_hands_turn_do_not_count():
    hands = Kinematics(BODY, Layout.load("mediapipe75", BODY))
    pose = hands.pose(random_state(np.random.default_rng(4), hands, 0.3))
    positions = positions_of(pose)
    positions["left_wrist"] = positions["left_wrist"] + [0.0, 0.0, 0.3]
    assert distance(positions, pose, hands) < 1e-9
    assert distance(positions, pose) == pytest.approx(0.3 / len(positions))


@pytest.mark.parametrize("apart, proposed", [(0.9 * SAME_POSE, False), (1.1 * SAME_POSE, True)])
def test_a_pose_is_proposed_if_it_is_far_from_the_tracked_one(apart, proposed):
    pose = pose_of(2)
    positions = positions_of(pose)
    positions["head"] = positions["head"] + [0.0, 0.0, apart * len(positions)]
    network_pose = NetworkPose(lambda: places_of(positions), KINEMATICS, MEAN)
    found = network_pose.propose(SimpleNamespace(pose=pose), None, 0)
    assert (found is not None) == proposed
    assert not proposed or (found.rotations.shape == (1, 24, 3, 3) and found.translation.shape == (1, 3))


def test_the_networks_pose_is_near_the_person():
    """Also the right hip, whose position is the opposite of the left one's."""
    tracker = Tracker(CONFIG)
    for truth, observation in observations(tracker, 1.0):
        estimate = tracker.track(observation)
    positions, skeleton = dict(zip(PLACES, tracker._cameras[0].network.places)), tracker.skeleton
    assert tracker._starts.network_pose.distance(replace(estimate.pose, positions=truth)) < 0.1
    left, right = truth[skeleton.index("left_hip")], truth[skeleton.index("right_hip")]
    assert np.abs(positions["right_hip"] - 0.5 * (right - left)).max() < 0.06 < np.abs(right - left).max()
    found = tracker.kinematics.pose(tracker._starts.network_pose.state()).positions
    assert np.linalg.norm((found - found[0]) - (truth - truth[0]), axis=1).mean() < 0.12


def frame_of(side, points):
    hands = HandEstimator(kinematics_of(side)).estimate(points, np.ones(21, dtype=bool), HERE)
    return one_view(points, np.full(21, 300.0), hands=hands)


def hand_pose(side):
    kinematics = kinematics_of(side)
    return HandPose(kinematics, exponential(PoseDistribution.load(kinematics.skeleton).mean))


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_palm_is_where_the_network_places_it(side):
    motion, points = scene(side, 4.0)
    angles = []
    for frame in range(0, 120, 10):
        state = hand_pose(side).state(frame_of(side, points[frame]))
        turn = state.rotations[0].T @ motion.orientations[frame]
        angles.append(np.degrees(np.linalg.norm(logarithm(turn))))
    assert np.median(angles) < 15 and max(angles) < 40


def test_without_the_network_there_is_no_pose():
    _, points = scene("left", 4.0)
    assert hand_pose("left").state(one_view(points[0], np.full(21, 300.0))) is None


def test_it_is_of_a_hand_alone():
    assert HandPose.fits(kinematics_of("right"))
    assert not HandPose.fits(Kinematics(BODY, Layout.load("mediapipe75", BODY)))


def test_the_first_frame_needs_no_search(monkeypatch):
    motion, points = scene("left", 4.0)
    tracker = hand_tracker("left")
    assert tracker.limitations == ""
    monkeypatch.setattr(tracker._starts.initialiser, "fit", lambda frame: pytest.fail("searched"))
    for number in range(0, 120, 15):
        tracker.reset()
        found = tracker.track(seen(number, points[number]))
        places, true = found.pose.landmarks, motion.points[number]
        assert found.initialised and np.linalg.norm((places - places[0]) - (true - true[0]), axis=1).mean() < 0.05
