"""Limbs mirrored in depth: the image, the lengths and the other limbs are unchanged, the lean in depth is reversed."""

import numpy as np
import pytest
from cases import FACING, body, random_body
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution, PosePrior
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.core.hypotheses.initialisation import Initialiser
from lassokin_ros.core.hypotheses.mirroring import LIMBS, Mirroring, redirected
from lassokin_ros.core.image.frame_data import FrameData


def state(seed):
    random = np.random.default_rng(seed)
    rotations = Rotation.from_rotvec(0.5 * random.normal(size=(24, 3))).as_matrix()
    rotations[0] = FACING @ rotations[0]
    return BodyState(rotations, np.array([0.4, -0.2, 4.0]))


@pytest.mark.parametrize("variant", range(3 * len(LIMBS)))
def test_each_mirrored_bone_changes_its_sign_along_the_line_of_sight(variant):
    kinematics = body()
    mirroring = Mirroring(kinematics)
    chain, bones = mirroring.variants[variant]
    before = state(variant)
    after = mirroring.mirrored(before, variant)
    old, new = kinematics.pose(before).positions, kinematics.pose(after).positions
    sight = old[chain[0]] / np.linalg.norm(old[chain[0]])
    for joint, child, mirrored in zip(chain, chain[1:], bones):
        was, is_now = old[child] - old[joint], new[child] - new[joint]
        assert np.linalg.norm(is_now) == pytest.approx(np.linalg.norm(was))
        assert is_now @ sight == pytest.approx(-was @ sight if mirrored else was @ sight, abs=1e-9)
        assert np.allclose(is_now - sight * (is_now @ sight), was - sight * (was @ sight))
    carried = kinematics.skeleton.ancestors[:, chain[0]].astype(bool)
    assert np.allclose(new[~carried], old[~carried])
    products = np.swapaxes(after.rotations, -1, -2) @ after.rotations
    assert np.abs(products - np.eye(3)).max() < 1e-12 and np.linalg.det(after.rotations).min() > 0


def test_mirroring_twice_restores_the_state():
    kinematics = body()
    mirroring = Mirroring(kinematics)
    before = state(3)
    for variant in range(len(mirroring.variants)):
        back = mirroring.mirrored(mirroring.mirrored(before, variant), variant)
        assert np.allclose(kinematics.pose(back).positions, kinematics.pose(before).positions)


def test_each_limb_has_each_choice_of_mirrored_bones_once():
    mirroring = Mirroring(body())
    choices = {(tuple(chain), bones) for chain, bones in mirroring.variants}
    assert len(choices) == len(mirroring.variants) == 3 * len(LIMBS) and all(any(bones) for _, bones in choices)


def test_pairs_are_both_legs_in_each_way():
    kinematics = body()
    mirroring = Mirroring(kinematics)
    names = kinematics.skeleton.joint_names
    for pair in mirroring.pairs:
        (left, its), (right, other) = (mirroring.variants[variant] for variant in pair)
        assert (names[left[0]], names[right[0]]) == ("left_hip", "right_hip") and its == other
    assert len(mirroring.pairs) == 3
    one, two = mirroring.pairs[0]
    both = kinematics.pose(mirroring.both(state(4), mirroring.pairs[0])).positions
    for variant in (one, two):
        chain, _ = mirroring.variants[variant]
        alone = kinematics.pose(mirroring.mirrored(state(4), variant)).positions
        assert np.allclose(both[chain], alone[chain])


def test_all_returns_every_variant():
    mirroring = Mirroring(body())
    together = mirroring.all(state(5))
    assert together.rotations.shape == (12, 24, 3, 3) and together.translation.shape == (12, 3)
    assert np.array_equal(together.rotations[6], mirroring.mirrored(state(5), 6).rotations)


def test_mirroring_reverses_a_bone_along_the_line_of_sight():
    kinematics = body()
    mirroring = Mirroring(kinematics)
    (shoulder, elbow, _), _ = mirroring.variants[0]
    before = state(7)
    pose = kinematics.pose(before)
    sight = pose.positions[shoulder] / np.linalg.norm(pose.positions[shoulder])
    bone = pose.positions[elbow] - pose.positions[shoulder]
    along, _ = Rotation.align_vectors(sight[None], bone[None])
    parent = pose.orientations[shoulder] @ before.rotations[shoulder].T
    before.rotations[shoulder] = parent.T @ along.as_matrix() @ pose.orientations[shoulder]
    after = mirroring.mirrored(before, 0)
    assert np.isfinite(after.rotations).all()
    products = np.swapaxes(after.rotations, -1, -2) @ after.rotations
    assert np.abs(products - np.eye(3)).max() < 1e-9


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 2.0, np.pi - 1e-4, np.pi - 1e-8])
def test_a_bone_is_redirected_by_the_smallest_rotation(angle):
    for seed in range(20):
        rotation, about = Rotation.random(2, random_state=seed)
        bone = 0.3 * about.apply([0.0, 1.0, 0.0])
        a = rotation.apply(bone)
        across = np.cross(a, about.apply([1.0, 0.0, 0.0]))
        b = Rotation.from_rotvec(angle * across / np.linalg.norm(across)).apply(a)
        after = redirected(rotation.as_matrix(), bone, a, b)
        assert np.allclose(after @ bone, b, atol=1e-12)
        assert np.allclose(after.T @ after, np.eye(3), atol=1e-12)
        digits_left = 1e-15 / (np.pi - angle)
        assert np.allclose(after, least_turn(a, b) @ rotation.as_matrix(), atol=1e-12 + 4 * digits_left)


def test_a_skeleton_without_limbs_has_no_variants():
    kinematics = random_body(np.random.default_rng(0))
    mirroring = Mirroring(kinematics)
    n = kinematics.joint_count
    none = mirroring.all(BodyState(np.tile(np.eye(3), (n, 1, 1)), np.array([0.0, 0.0, 3.0])))
    prior = PoseDistribution.load(kinematics.skeleton)
    initialiser = Initialiser(kinematics, prior, FrameModel(kinematics, PosePrior(prior, kinematics), Upright()))
    points = 0.1 * np.random.default_rng(1).normal(size=(kinematics.landmark_count, 2))
    assert np.isfinite(initialiser.fit(FrameData(points, np.full(len(points), 300.0))).costs).all()
    assert mirroring.variants == mirroring.pairs == []
    assert none.rotations.shape == (0, n, 3, 3) and none.translation.shape == (0, 3)


def of_body(change):
    """Mirroring for the built-in body with changed joints (names, parents, positions)."""
    skeleton = body().skeleton
    joints = []
    for name, parent, place in zip(skeleton.joint_names, skeleton.parents, skeleton.rest_positions.tolist()):
        above = None if parent < 0 else skeleton.joint_names[parent]
        joints += change({"name": name, "parent": above, "position": place})
    skeleton = Skeleton.from_mapping({"height_unit": "metre", "joints": joints}, 1.75)
    return Mirroring(Kinematics(skeleton, Layout.load("coco17", skeleton)))


def test_a_limb_with_another_number_of_joints_is_not_mirrored():
    def with_roll(joint):
        if joint["name"] != "left_elbow":
            return [joint]
        return [{**joint, "name": "roll", "position": [0.3, 0.5, 0.0]}, {**joint, "parent": "roll"}]

    places = dict(zip(body().skeleton.joint_names, body().skeleton.rest_positions.tolist()))

    def without_shin(joint):
        return [{**joint, "position": places["left_knee"]} if joint["name"] == "left_ankle" else joint]

    whole, arm, leg = (of_body(change) for change in (lambda joint: [joint], with_roll, without_shin))
    names = [mirroring._kinematics.skeleton.joint_names for mirroring in (whole, arm, leg)]
    first = [{n[chain[0]] for chain, _ in m.variants} for m, n in zip((whole, arm, leg), names)]
    assert len(first[0]) == 4 and len(whole.pairs) == 3
    assert first[0] - first[1] == {"left_shoulder"} and len(arm.pairs) == 3
    assert first[0] - first[2] == {"left_hip"} and leg.pairs == []
