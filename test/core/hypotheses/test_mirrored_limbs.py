"""Limbs mirrored in depth: image, lengths and other limbs stay, the component along the line of sight is reversed."""

import numpy as np
import pytest
from cases import body, random_body, random_state
from sequences import WITHOUT_NETWORK, observations

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.roles import LIMBS
from lassokin_ros.core.body.rotations import exponential, least_turn
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.mirrored_limbs import BONES, MirroredLimbs
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.observation import HERE, CameraPose
from lassokin_ros.core.tracker import Tracker

CASES = [(limb, turn) for limb in range(len(LIMBS)) for turn in range(len(BONES))]


def evaluated(kinematics, state):
    return FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton)).evaluate(state)


def seen_from(camera):
    return FrameData(np.zeros((17, 2)), np.zeros(17), camera=camera)


def mirrored(kinematics, tracked, turn, camera=HERE):
    """The states of the turn-th proposal, one per limb."""
    return MirroredLimbs(kinematics).propose(tracked, seen_from(camera), turn)


@pytest.mark.parametrize("limb, turn", CASES)
def test_each_mirrored_bone_changes_its_sign_along_the_line_of_sight(limb, turn):
    kinematics = body()
    before = random_state(np.random.default_rng([limb, turn]), kinematics)
    tracked = evaluated(kinematics, before)
    states = mirrored(kinematics, tracked, turn)
    assert states.rotations.shape == (len(LIMBS), 24, 3, 3)
    assert np.array_equal(states.translation, np.tile(before.translation, (len(LIMBS), 1)))
    after = BodyState(states.rotations[limb], states.translation[limb])
    chain = [kinematics.skeleton.index(joint) for joint in LIMBS[limb]]
    old, new = tracked.pose.positions, kinematics.pose(after).positions
    sight = old[chain[0]] / np.linalg.norm(old[chain[0]])
    across = np.eye(3) - np.outer(sight, sight)  # what the image shows, in weak perspective
    for joint, child, is_mirrored in zip(chain, chain[1:], BONES[turn]):
        was, is_now = old[child] - old[joint], new[child] - new[joint]
        assert abs(was @ sight) > 1e-3  # else a bone that stays would pass
        assert np.linalg.norm(is_now) == pytest.approx(np.linalg.norm(was))
        assert is_now @ sight == pytest.approx(-was @ sight if is_mirrored else was @ sight, abs=1e-9)
        assert np.allclose(across @ is_now, across @ was, atol=1e-12)
    carried = kinematics.skeleton.ancestors[:, chain[0]].astype(bool)
    assert np.allclose(new[~carried], old[~carried], atol=1e-12)
    changed = np.abs(after.rotations - before.rotations).max(axis=(1, 2)) > 1e-9
    assert 1 <= changed.sum() <= 2 and set(np.flatnonzero(changed)) <= set(chain[:2])
    products = np.swapaxes(after.rotations, -1, -2) @ after.rotations
    assert np.abs(products - np.eye(3)).max() < 1e-12 and np.linalg.det(after.rotations).min() > 0


def test_in_a_fixed_frame_the_line_of_sight_begins_at_the_camera():
    """The mirrored limbs of a body and a camera that are moved together are those of the body before, moved."""
    kinematics = body()
    before = random_state(np.random.default_rng(5), kinematics)
    turn, place = exponential(np.array([0.3, -1.0, 0.2])), np.array([2.0, -1.0, 4.0])
    rotations = before.rotations.copy()
    rotations[0] = turn @ rotations[0]
    moved = BodyState(rotations, turn @ before.translation + place)
    camera = CameraPose("side", turn.T, -turn.T @ place)
    for number in range(len(BONES)):
        here = mirrored(kinematics, evaluated(kinematics, before), number)
        there = mirrored(kinematics, evaluated(kinematics, moved), number, camera)
        assert np.allclose(there.rotations[:, 1:], here.rotations[:, 1:], atol=1e-9)


def test_mirroring_twice_restores_the_joints():
    kinematics = body()
    tracked = evaluated(kinematics, random_state(np.random.default_rng(3), kinematics))
    for limb, turn in CASES:
        once = mirrored(kinematics, tracked, turn)
        again = evaluated(kinematics, BodyState(once.rotations[limb], once.translation[limb]))
        back = mirrored(kinematics, again, turn)
        found = kinematics.pose(BodyState(back.rotations[limb], back.translation[limb])).positions
        assert np.allclose(found, tracked.pose.positions, atol=1e-9)


def test_both_bones_the_outer_and_the_inner_one_come_in_turn():
    kinematics = body()
    tracked = evaluated(kinematics, random_state(np.random.default_rng(4), kinematics))
    limbs = MirroredLimbs(kinematics)
    proposed = [limbs.propose(tracked, seen_from(HERE), turn).rotations for turn in range(2 * len(BONES))]
    assert set(BONES) == {(True, True), (True, False), (False, True)}
    for turn in range(len(BONES)):
        assert np.array_equal(proposed[turn], proposed[turn + len(BONES)])
        assert not np.allclose(proposed[turn], proposed[(turn + 1) % len(BONES)])


def test_a_bone_along_the_line_of_sight_is_reversed():
    kinematics = body()
    state = random_state(np.random.default_rng(7), kinematics)
    hip, knee, _ = (kinematics.skeleton.index(joint) for joint in LIMBS[0])
    pose = kinematics.pose(state)
    sight = pose.positions[hip] / np.linalg.norm(pose.positions[hip])
    bone = pose.positions[knee] - pose.positions[hip]
    parent = pose.orientations[hip] @ state.rotations[hip].T
    state.rotations[hip] = parent.T @ least_turn(bone, sight) @ pose.orientations[hip]
    tracked = evaluated(kinematics, state)
    states = mirrored(kinematics, tracked, 0)
    after = kinematics.pose(BodyState(states.rotations[0], states.translation[0])).positions
    along = (after[knee] - after[hip]) @ sight
    assert along == pytest.approx(-np.linalg.norm(bone), rel=1e-6)


def test_a_skeleton_without_limbs_has_no_proposals():
    kinematics = random_body(np.random.default_rng(0))
    state = BodyState(np.tile(np.eye(3), (kinematics.joint_count, 1, 1)), np.array([0.0, 0.0, 3.0]))
    assert MirroredLimbs(kinematics).propose(evaluated(kinematics, state), seen_from(HERE), 0) is None


def test_a_limb_that_moves_no_landmark_is_not_mirrored():
    skeleton = body().skeleton
    points = [
        {"name": joint, "joint": joint, "offset": [0.0, 0.0, 0.0]}
        for joint in ("left_hip", "right_hip", "left_knee", "left_ankle", "left_shoulder", "right_shoulder", "head")
    ]
    kinematics = Kinematics(skeleton, Layout.from_mapping({"landmarks": points}, skeleton))
    tracked = evaluated(kinematics, random_state(np.random.default_rng(0), kinematics))
    states = mirrored(kinematics, tracked, 0)
    assert len(states.rotations) == 1
    changed = np.abs(states.rotations[0] - tracked.state.rotations).max(axis=(1, 2)) > 1e-9
    names = {skeleton.joint_names[joint] for joint in np.flatnonzero(changed)}
    assert names <= {"left_hip", "left_knee"} and names


def test_a_tracker_without_the_network_leaves_a_limb_that_is_mirrored_in_depth():
    """The tracked state is replaced by one with a limb mirrored; some frames later the right one is back."""
    tracker = Tracker(WITHOUT_NETWORK)
    frames = observations(tracker, 3.0, noise_px=1.0)
    kinematics, model = tracker.kinematics, tracker.frame_model
    for _, observation in frames[:30]:
        tracker.track(observation)
    solved = tracker._solved
    states = mirrored(kinematics, solved, 0)
    moved = [np.abs(kinematics.pose(BodyState(r, solved.state.translation)).positions - solved.pose.positions).max()
             for r in states.rotations]  # fmt: skip
    limb = int(np.argmax(moved))
    chain = [kinematics.skeleton.index(joint) for joint in LIMBS[limb]]

    def wrong(truth):
        joints = tracker._solved.pose.positions[chain]
        return np.linalg.norm((joints - joints[0]) - (truth[chain] - truth[chain[0]]), axis=-1).max()

    before = wrong(frames[29][0])
    tracker._solved = model.evaluate(BodyState(states.rotations[limb], states.translation[limb]))
    spoiled = wrong(frames[29][0])
    for _, observation in frames[30:]:
        tracker.track(observation)
    assert max(before, wrong(frames[-1][0])) + 0.1 < spoiled
