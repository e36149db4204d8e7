"""The roles of joints: what is off without some of them, and that the tables name joints that exist."""

from dataclasses import replace

import pytest

from lassokin_ros.core.body import roles
from lassokin_ros.core.body.roles import missing_roles
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.tracker import Tracker

NAMES = Skeleton.load("anthropometric", 1.75).joint_names


def test_the_built_in_body_and_one_with_more_joints_lack_nothing():
    assert missing_roles(NAMES) == "" == missing_roles((*NAMES, "tail"))


@pytest.mark.parametrize(
    ("without", "off"),
    [
        ("left_wrist", "depth network, balance, pose prior of these joints"),
        ("left_foot", "balance"),
        ("spine2", "pose prior of these joints"),
        ("pelvis", "balance"),
        ("head", "depth network, balance, pose prior of these joints"),
    ],
)
def test_a_missing_joint_is_named_with_what_is_off(without, off):
    text = missing_roles([name for name in NAMES if name != without])
    assert text == f"the skeleton has no joint {without}; off: {off}. Name joints as SMPL does to use them"


def test_several_missing_joints_are_named_once():
    text = missing_roles([name for name in NAMES if "knee" not in name and name != "spine1"])
    assert text.startswith("the skeleton has no joint left_knee, right_knee, spine1; off: depth network, balance, pose")
    assert "\n" not in text and text.count("left_knee") == 1
    assert "off: depth network, balance, pose prior of these joints" in missing_roles(["wrist", "thumb"])


def test_the_tables_name_joints_of_the_built_in_body():
    named = {joint for bone in roles.BONES for joint in (bone.first, bone.last)}
    named |= {joint for joints, _ in roles.LENGTHS.values() for joint in joints}
    named |= {joint for limb in roles.LIMBS for joint in limb} | set(roles.FEET)
    named |= roles.BALANCE_JOINTS | roles.NETWORK_JOINTS | roles.PRIOR_JOINTS
    assert named <= set(Skeleton.load("body_hands", 1.75).joint_names)
    assert {roles.without_side(name) for name in named} <= {*roles.THICKNESS, "collar"}


def test_the_masses_of_the_parts_are_the_body():
    assert sum(bone.mass for bone in roles.BONES) == pytest.approx(1.0, abs=0.001)


def test_the_tracker_says_what_is_off():
    assert Tracker(TrackerConfig(height=1.75)).limitations == ""
    names = tuple(name.replace("_foot", "_toes") for name in NAMES)
    renamed = replace(Skeleton.load("anthropometric", 1.75), joint_names=names)
    assert "no joint left_foot, right_foot; off: balance" in Tracker(TrackerConfig(height=1.75), renamed).limitations
