"""Limbs that no keypoint shows."""

import numpy as np

from lassokin_ros.doubt.unseen_limbs import LIMBS, UNSEEN_S, UnseenLimbs

JOINTS = ("pelvis", *(joint for chain in LIMBS.values() for joint in chain))


def seen(*joints):
    return np.isin(JOINTS, joints)


def test_a_limb_is_reported_after_a_while_without_any_joint():
    limbs, arms = UnseenLimbs(JOINTS), ("left_elbow", "right_wrist")
    assert limbs.update(0.0, seen(*arms)) == () and limbs.update(UNSEEN_S - 0.01, seen(*arms)) == ()
    assert limbs.update(UNSEEN_S, seen(*arms)) == ("left leg", "right leg")
    assert limbs.update(UNSEEN_S + 0.1, seen(*arms, "right_ankle")) == ("left leg",)
    limbs.reset()
    assert limbs.update(UNSEEN_S + 0.2, seen(*arms)) == ()


def test_limbs_that_the_skeleton_lacks_and_unknown_joints_are_not_reported():
    limbs = UnseenLimbs(("pelvis", "left_knee", "left_ankle"))
    none = np.zeros(3, dtype=bool)
    assert limbs.update(0.0, none) == () and limbs.update(1.0, none) == ("left leg",) and limbs.update(2.0, None) == ()
