"""Left and right by name, and the symmetry of lengths, with values computed by hand."""

from dataclasses import replace

import numpy as np
import pytest

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.body.symmetry import (
    LARGEST_ASYMMETRY,
    asymmetry,
    limb_groups,
    other_side,
    partners,
    symmetric_skeleton,
    symmetrised,
)

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
