"""The skeletons with fingers: SMPL-H's tree, published lengths, locked axes, and what the core makes of them."""

import numpy as np
import pytest

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.roles import FINGER_JOINTS, FINGERS, SIDES, body_joints, missing_roles, sided
from lassokin_ros.core.body.rotations import exponential, logarithm
from lassokin_ros.core.body.skeleton import Skeleton, has_built_in_proportions
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.kernel import kernel
from lassokin_ros.pipeline.outputs.saved_files import skeleton_text

BODY, LEFT = Skeleton.load("body_hands", 1.75), Skeleton.load("left_hand", 1.75)
PHALANGES = {"index": (39.78, 22.38), "middle": (44.63, 26.33), "pinky": (32.74, 18.11), "ring": (41.37, 25.65),
             "thumb": (46.22, 31.57)}  # fmt: skip
"""mm, Buryanov and Kotiuk 2010: of a finger the proximal and middle phalanx, of the thumb metacarpal and phalanx."""
FREE = {"thumb1": (0, 1, 2), "thumb2": (1,), "thumb3": (1,)}


def layout_of(skeleton):
    return Layout.load({"body_hands": "mediapipe75", "left_hand": "left_hand21"}.get(skeleton.name, "smpl24"), skeleton)


def model_of(skeleton):
    return FrameModel(Kinematics(skeleton, layout_of(skeleton)), PoseDistribution.load(skeleton))


def free_axes(name):
    """The axes about which a finger's joint turns, by its name without the side."""
    return FREE.get(name, (1, 2) if name.endswith("1") else (2,))


def test_the_body_with_hands_is_smpls_and_smpl_hs():
    body = Skeleton.load("anthropometric", 1.75)
    assert BODY.joint_names == (*body.joint_names, *sided(*FINGER_JOINTS)) and BODY.joint_count == 54
    assert np.allclose(BODY.offsets[:24], body.offsets, rtol=0, atol=1e-12) and BODY.axes[:24] == body.axes
    assert np.array_equal(BODY.parents[:24], body.parents)
    assert FINGER_JOINTS[:4] == ("index1", "index2", "index3", "middle1") and FINGERS[-1] == "thumb"
    for joint, name in enumerate(BODY.joint_names[24:], 24):
        side, finger = name.split("_")
        parent = f"{side}_wrist" if finger.endswith("1") else f"{side}_{finger[:-1]}{int(finger[-1]) - 1}"
        assert BODY.joint_names[BODY.parents[joint]] == parent
    assert has_built_in_proportions(BODY) and not has_built_in_proportions(LEFT)


@pytest.mark.parametrize("side", SIDES)
def test_a_hand_alone_is_that_of_the_body(side):
    alone = Skeleton.load(f"{side}_hand", 1.75)
    assert alone.joint_names == (f"{side}_wrist", *(f"{side}_{name}" for name in FINGER_JOINTS))
    for joint, name in enumerate(alone.joint_names[1:], 1):
        same = BODY.index(name)
        assert np.allclose(alone.offsets[joint], BODY.offsets[same], rtol=0, atol=1e-12)
        assert alone.axes[joint] == BODY.axes[same]
        assert [3 * joint + axis in alone.locked for axis in range(3)] == [
            3 * same + axis in BODY.locked for axis in range(3)
        ]
    mirrored = np.array([Skeleton.load("left_hand", 1.75).offsets, Skeleton.load("right_hand", 1.75).offsets])
    assert np.allclose(mirrored[0], mirrored[1] * [-1, 1, 1], rtol=0, atol=1e-12)
    assert missing_roles(alone.joint_names) == ""


def test_segments_have_the_published_lengths():
    tall = Skeleton.load("left_hand", 1.69)  # m: of the mean of the radiographs, see the file
    for finger, lengths in PHALANGES.items():
        for number, length in enumerate(lengths, 2):
            found = np.linalg.norm(tall.offsets[tall.index(f"left_{finger}{number}")])
            assert found == pytest.approx(1e-3 * length, abs=2e-4), finger


def test_fingers_are_hinges_and_knuckles_have_two_axes():
    kinematics = Kinematics(BODY, layout_of(BODY))
    for side in SIDES:
        for name in FINGER_JOINTS:
            joint = BODY.index(f"{side}_{name}")
            assert tuple(np.flatnonzero(kinematics.live[3 * joint : 3 * joint + 3])) == free_axes(name)
    assert np.count_nonzero(kinematics.live_index >= 3 * 24) == 2 * 21


def test_a_locked_axis_does_not_turn():
    """Steps about y and z of a knuckle add up to a turn about x, which is removed after each step."""
    kinematics, random = Kinematics(LEFT, layout_of(LEFT)), np.random.default_rng(0)
    free, kept = BodyState(np.tile(np.eye(3), (16, 1, 1)), np.zeros(3)), None
    kept = free
    for _ in range(100):
        omega = np.zeros(48)
        omega[kinematics.live_index] = 0.05 * random.normal(size=len(kinematics.live_index))
        free, moved = free.retract(omega, np.zeros(3)), kept.retract(omega, np.zeros(3))
        kept = BodyState(kinematics.on_axes(moved.rotations), moved.translation)
        assert np.abs(logarithm(kept.rotations @ moved.rotations.swapaxes(-1, -2))).max() < 0.05  # a small correction
    locked = list(LEFT.locked)
    assert np.abs(logarithm(kept.rotations).reshape(-1)[locked]).max() < 1e-9
    assert np.abs(logarithm(free.rotations).reshape(-1)[locked]).max() > 0.02
    body = Kinematics(
        Skeleton.load("anthropometric", 1.75), Layout.load("coco17", Skeleton.load("anthropometric", 1.75))
    )
    assert body.on_axes(free.rotations) is free.rotations


def test_the_prior_has_no_rows_for_locked_axes():
    model = model_of(BODY)
    prior, root = model.prior, 3
    assert prior.count == 3 * len(prior.joints) - len(BODY.locked) < len(prior.mean)
    assert np.abs(np.tril(prior.W, -1)).max() == 0
    free = np.flatnonzero(np.diagonal(prior.covariance) > 0)
    W = prior.W[:, free]
    assert np.allclose(W.T @ W @ prior.covariance[np.ix_(free, free)], np.eye(len(free)), atol=1e-8)
    assert len(prior.live) == len(model.live) - root
    random = np.random.default_rng(1)
    rotations = exponential(0.3 * random.normal(size=(54, 3)))
    answers = []
    for active in (False, kernel.active):
        with kernel.switched(active):
            answers.append(prior.posture(rotations))
    assert np.allclose(answers[0].residual, answers[1].residual, atol=1e-10)
    assert np.allclose(answers[0].theta, answers[1].theta, atol=1e-12)


def test_one_length_scales_both_hands():
    assert Proportions(Kinematics(LEFT, layout_of(LEFT))).names == ("hand",)
    proportions = Proportions(Kinematics(BODY, layout_of(BODY)))
    assert set(proportions.names) >= {"hand", "forearm"} and len(proportions.names) <= 13
    longer = proportions.skeleton(0.1 * (np.array(proportions.names) == "hand"))
    ratio = np.linalg.norm(longer.offsets[24:], axis=1) / np.linalg.norm(BODY.offsets[24:], axis=1)
    assert np.allclose(ratio, np.exp(0.1))


def test_a_hand_alone_has_no_upright_rows():
    """A hand may point anywhere; the body with hands stands upright."""
    assert model_of(BODY).upright.deviation < 1 and np.isinf(model_of(LEFT).upright.deviation)


def test_locked_axes_are_saved(tmp_path):
    file = tmp_path / "hand.yaml"
    file.write_text(skeleton_text(LEFT))
    assert Skeleton.load(str(file), 1.75).locked == LEFT.locked and "free" in file.read_text()


def test_figures_of_the_whole_body_leave_out_the_fingers():
    assert body_joints(BODY.joint_names).tolist() == list(range(24))
    assert body_joints(LEFT.joint_names).tolist() == list(range(16))
    prior, plain = model_of(BODY).prior, model_of(Skeleton.load("anthropometric", 1.75)).prior
    joints = prior.joints[np.flatnonzero(np.diagonal(prior.covariance) > 0)[prior.body_rows] // 3]
    assert set(joints) == {j for j in prior.joints if j < 24} - {BODY.index("left_wrist"), BODY.index("right_wrist")}
    assert plain.body_rows == slice(None) == model_of(LEFT).prior.body_rows
