"""Proportions and the symmetry of lengths."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body, central_difference, posed, random_state, relative_error

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.proportions import (
    LARGEST_ASYMMETRY,
    Proportions,
    asymmetry,
    limb_groups,
    other_side,
    partners,
    symmetric_skeleton,
    symmetrised,
)
from lassokin_ros.core.body.roles import LENGTHS
from lassokin_ros.core.body.skeleton import Skeleton


@pytest.fixture(scope="module")
def all_lengths():
    """Proportions of the built-in body with all joints visible."""
    return Proportions(body("smpl24"))


def chain(*joints, seen):
    """A body of (name, parent, position), and landmarks at the joints `seen`."""
    rows = [{"name": name, "parent": parent, "position": list(place)} for name, parent, place in joints]
    skeleton = Skeleton.from_mapping({"height_unit": "metre", "joints": rows}, 1.7)
    layout = Layout.from_mapping({"landmarks": [{"name": name, "joint": name} for name in seen]}, skeleton)
    return Proportions(Kinematics(skeleton, layout))


def test_each_length_scales_its_own_bones_only(all_lengths):
    assert set(all_lengths.names) == set(LENGTHS) and all_lengths.count == 13
    given = all_lengths.given
    assert np.allclose(all_lengths.parts.sum(axis=0), given.offsets)  # each component belongs to one length
    for length, part in zip(all_lengths.names, all_lengths.parts):
        joints, axes = LENGTHS[length]
        for joint, name in enumerate(given.joint_names):
            belongs = name in joints
            expected = [offset if belongs and axis in axes else 0 for axis, offset in zip("xyz", given.offsets[joint])]
            assert np.array_equal(part[joint], expected), (length, name)


def test_log_lengths_scale_by_their_exponential(all_lengths):
    lengths = np.zeros(all_lengths.count)
    thigh = all_lengths.names.index("thigh")
    lengths[thigh] = np.log(1.25)
    given, taller = all_lengths.given, all_lengths.skeleton(lengths)
    ratios = np.linalg.norm(taller.offsets[1:], axis=1) / np.linalg.norm(given.offsets[1:], axis=1)
    knees = np.isin(given.joint_names[1:], ["left_knee", "right_knee"])
    assert ratios == pytest.approx(np.where(knees, 1.25, 1.0))
    assert all_lengths.offsets(np.stack([lengths, 0 * lengths]))[1] == pytest.approx(given.offsets)


def test_the_shares_of_the_stature_are_its_derivative(all_lengths):
    """Stature at rest: from the lowest joint to the highest one, along the tree."""

    def log_stature(lengths):
        height = all_lengths.skeleton(lengths).rest_positions[:, 1]
        return np.log(np.ptp(height)).reshape(1)

    expected = central_difference(log_stature, all_lengths.count)[0]
    assert all_lengths.stature_shares == pytest.approx(expected, abs=1e-8)
    # Lengths across the body have no share. The built-in foot points forward and down, so it has one.
    assert all_lengths.stature_shares[all_lengths.names.index("hip width")] == 0
    assert all_lengths.stature_shares[all_lengths.names.index("thigh")] > 0.2


def test_the_joints_jacobian_is_the_derivative_of_their_centres(all_lengths):
    kinematics = body("smpl24")
    state = random_state(np.random.default_rng(4), kinematics)
    expected = central_difference(
        lambda lengths: posed(kinematics, state, all_lengths.offsets(lengths)).positions, all_lengths.count
    )
    actual = all_lengths.motion(kinematics.pose(state), np.zeros(13)).joints
    assert actual.shape == (24, 3, 13)
    assert relative_error(actual.reshape(-1, 13), expected) < 1e-8


def test_unknown_joints_have_a_length_by_kind_and_invisible_ones_none():
    tail = ("tail", "pelvis", (0, -0.2, -0.3))
    wings = [(f"{side}_wing", "pelvis", (x, 0.4, 0)) for side, x in (("left", 0.5), ("right", -0.5))]
    antenna = ("antenna", "left_wing", (0.5, 0.6, 0))
    proportions = chain(("pelvis", None, (0, 0, 0)), tail, *wings, antenna, seen=["left_wing", "right_wing", "tail"])
    assert proportions.names == ("tail", "wing")
    wing = proportions.parts[1]
    assert np.array_equal(wing, [[0, 0, 0], [0, 0, 0], [0.5, 0.4, 0], [-0.5, 0.4, 0], [0, 0, 0]])
    # From the tail, 0.2 m below the root, to the antenna's end, 0.6 m above it by a wing of 0.4 m.
    assert proportions.stature_shares == pytest.approx([0.2 / 0.8, 0.4 / 0.8])


def test_a_body_without_height_has_finite_shares():
    flat = chain(("a", None, (0, 0, 0)), ("b", "a", (1, 0, 0)), seen=["b"])
    assert flat.names == ("b",) and flat.stature_shares.tolist() == [0.0]


def test_a_body_without_any_length_stays_as_it_is():
    """Two joints at one place, as the gimbals of a URDF are."""
    gimbal = chain(("base", None, (0, 0, 0)), ("gimbal", "base", (0, 0, 0)), seen=["gimbal"])
    assert gimbal.names == () and np.array_equal(gimbal.skeleton(np.zeros(0)).offsets, np.zeros((2, 3)))
    assert gimbal.offsets(np.zeros((5, 0))).shape == (5, 2, 3)


def test_another_given_body_has_lengths_of_its_own(all_lengths):
    """The log-lengths of a taller body refer to it; those of the old one are not changed."""
    kinematics = body("smpl24")
    proportions, lengths = Proportions(kinematics), np.linspace(-0.1, 0.1, 13)
    taller = kinematics.skeleton.scaled(1.2)
    proportions.use(taller)
    assert proportions.given is taller and proportions.names == all_lengths.names
    assert np.allclose(proportions.offsets(lengths), 1.2 * all_lengths.offsets(lengths))
    assert np.allclose(proportions.parts, 1.2 * all_lengths.parts)
    assert np.array_equal(proportions.stature_shares, all_lengths.stature_shares)
    state = random_state(np.random.default_rng(5), kinematics)
    kinematics.set_skeleton(taller)
    expected = central_difference(lambda log: posed(kinematics, state, proportions.offsets(log)).positions, 13)
    actual = proportions.motion(kinematics.pose(state), np.zeros(13)).joints
    assert relative_error(actual.reshape(-1, 13), expected) < 1e-8
    moved = proportions.motion(posed(kinematics, state, proportions.offsets(lengths)), lengths)
    expected = central_difference(
        lambda log: posed(kinematics, state, proportions.offsets(lengths + log)).landmarks, 13
    )
    assert relative_error(moved.landmarks.reshape(-1, 13), expected) < 1e-8


NAMES = ("pelvis", "left_hip", "right_hip", "left_knee", "right_knee", "head", "wing_left", "wing_right", "left_ear")
PARENTS = (-1, 0, 0, 1, 2, 0, 5, 5, 5)


def creature(**lengths):
    """Bones of 0.4 m, each along the axis of its kind, except the named ones."""
    offsets = np.zeros((9, 3))
    for joint, name in enumerate(NAMES[1:], 1):
        offsets[joint, joint % 3] = lengths.get(name, 0.4)
    return Skeleton("creature", NAMES, np.array(PARENTS), offsets, ("xzy",) * 9, 1.7)


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("left_knee", "right_knee"),
        ("right_knee", "left_knee"),
        ("mouth_left", "mouth_right"),
        ("mouth_right", "mouth_left"),
        ("left_left_toe", "right_left_toe"),
        ("pelvis", "pelvis"),
        ("lefty", "lefty"),
        ("upright", "upright"),
    ],
)
def test_the_other_side_of_a_name_is_found(name, other):
    assert other_side(name) == other


def test_partners_are_the_other_side():
    assert partners(NAMES).tolist() == [0, 2, 1, 4, 3, 5, 7, 6, 8]


def test_both_limbs_of_a_pair_form_a_group_and_the_trunk_does_not():
    # A limb's group is the number of the first joint of the pair; what hangs on a limb belongs to it.
    assert limb_groups(creature()).tolist() == [-1, 1, 1, 1, 1, -1, 6, 6, -1]


def test_the_built_in_body_has_arms_and_legs():
    skeleton = Skeleton.load("anthropometric", 1.75)
    groups = limb_groups(skeleton)
    legs, arms = groups[skeleton.index("left_hip")], groups[skeleton.index("right_collar")]
    assert {legs, arms, -1} == set(groups.tolist()) and legs != arms
    for name, group in zip(skeleton.joint_names, groups):
        leg, trunk = any(part in name for part in ("hip", "knee", "ankle", "foot")), "_" not in name
        assert group == (-1 if trunk else legs if leg else arms), name


def test_asymmetry_is_the_root_mean_square_of_the_log_ratios():
    # Of three pairs one has the ratio 2 to 1; the ear, which has no partner, does not count.
    assert asymmetry(creature(left_hip=0.8)) == pytest.approx(np.log(2) / np.sqrt(3))
    assert asymmetry(creature(left_hip=0.8, right_knee=0.8)) == pytest.approx(np.log(2) * np.sqrt(2 / 3))
    assert asymmetry(creature(left_ear=0.8)) == 0


@pytest.mark.parametrize("missing", ["left_hip", "right_hip"])
def test_a_bone_without_length_has_no_partner(missing):
    assert asymmetry(creature(**{missing: 0.0}, left_knee=0.8)) == pytest.approx(np.log(2) / np.sqrt(2))
    assert np.array_equal(symmetrised(creature(**{missing: 0.0})).offsets, creature(**{missing: 0.0}).offsets)


def test_symmetrised_bones_have_their_geometric_mean():
    given = creature(left_hip=0.9, right_hip=0.4, left_ear=0.7)
    lengths = np.linalg.norm(symmetrised(given).offsets, axis=1)
    assert lengths == pytest.approx([0, 0.6, 0.6, 0.4, 0.4, 0.4, 0.4, 0.4, 0.7])
    assert symmetrised(given).height == given.height and symmetrised(given).joint_names == NAMES


def test_a_name_whose_other_side_is_missing_is_no_limb():
    lone = replace(creature(), joint_names=("pelvis", "left_hip", *(f"part{i}" for i in range(7))))
    assert limb_groups(lone).tolist() == [-1] * 9 and asymmetry(lone) == 0


def test_sides_that_differ_too_much_are_averaged_if_they_may_be():
    little, much = (creature(left_hip=0.4 * (1 + LARGEST_ASYMMETRY * share)) for share in (1.5, 2.0))
    assert asymmetry(little) < LARGEST_ASYMMETRY < asymmetry(much)
    assert symmetric_skeleton(little, average=True) == (little, 0.0)
    assert symmetric_skeleton(much, average=False) == (much, 0.0)
    averaged, difference = symmetric_skeleton(much, average=True)
    assert difference == asymmetry(much) and asymmetry(averaged) == pytest.approx(0)
