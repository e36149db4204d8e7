"""The monitor: limbs that no keypoint shows; doubts that are evaluated when they are read."""

import numpy as np
import pytest

from lassokin_ros.doubt.doubt import Signs, reasons
from lassokin_ros.doubt.monitor import LIMBS, MOST_WAITING, UNSEEN_S, DoubtMonitor, Judgement, UnseenLimbs

LANDMARKS = ("left_hip", "right_hip", "left_shoulder", "right_shoulder")
JOINTS = (*LANDMARKS, "left_elbow", "left_wrist", "left_hand")
FPS, COUNT = 30.0, 70
TRUNK = np.array([[0.1, 0, 3], [-0.1, 0, 3], [0.2, -0.5, 3], [-0.2, -0.5, 3]])
ARM = np.array([[0.3, 0, 3], [0.3, 0.2, 3], [0.3, 0.3, 3]])


def observe(visible):
    return np.append(visible, [False] * len(ARM))


def frames():
    """The sides are exchanged from frame 12 on, frame 40 is costly, and the left arm is hidden."""
    for frame in range(COUNT):
        trunk = TRUNK * (-1, 1, 1) if frame >= 12 else TRUNK
        figures = {"cost": 11.0 if frame == 40 else 1.0, "prior_cost": 6.0, "network_distance": 0.05}
        places = np.concatenate([trunk, ARM])
        yield Signs(frame / FPS, trunk[:, :2] / 3, places, visible=np.ones(len(trunk), bool), **figures)


def one_by_one():
    monitor = DoubtMonitor(LANDMARKS, JOINTS, observe)
    for signs in frames():
        doubt = monitor.update(signs)
        yield Judgement(doubt, tuple(reasons(monitor.recent)), monitor.seconds)


@pytest.mark.parametrize("read_every", [1, 7, COUNT])
def test_the_time_of_reading_does_not_matter(read_every):
    doubts, found = DoubtMonitor(LANDMARKS, JOINTS, observe), []
    for number, signs in enumerate(frames(), 1):
        found.append(doubts.add(signs))
        if number % read_every == 0:
            found[-1].read()
    expected = list(one_by_one())
    assert repr([judge.read() for judge in found]) == repr(expected)  # NaN is not equal to NaN
    assert sum(one.doubt.likely_wrong for one in expected) > 30 and expected[-1].doubt.unseen == ("left arm",)


def test_few_frames_wait():
    doubts = DoubtMonitor(LANDMARKS, JOINTS, observe)
    waiting = [(doubts.add(signs), len(doubts._waiting))[1] for signs in frames()]
    assert max(waiting) == MOST_WAITING - 1


def test_frames_before_a_reset_can_be_read_after_it():
    doubts = DoubtMonitor(LANDMARKS, JOINTS, observe)
    judges = [doubts.add(signs) for signs, _ in zip(frames(), range(14))]
    doubts.reset()
    assert judges[-1].read().reasons and judges[0].read() == judges[0].read()
    begun = [doubts.add(signs) for signs, _ in zip(frames(), range(5))]
    assert not any(judge.read().reasons for judge in begun)


LIMB_JOINTS = ("pelvis", *(joint for chain in LIMBS.values() for joint in chain))


def seen(*joints):
    return np.isin(LIMB_JOINTS, joints)


def test_a_limb_is_reported_after_a_while_without_any_joint():
    limbs, arms = UnseenLimbs(LIMB_JOINTS), ("left_elbow", "right_wrist")
    assert limbs.update(0.0, seen(*arms)) == () and limbs.update(UNSEEN_S - 0.01, seen(*arms)) == ()
    assert limbs.update(UNSEEN_S, seen(*arms)) == ("left leg", "right leg")
    assert limbs.update(UNSEEN_S + 0.1, seen(*arms, "right_ankle")) == ("left leg",)
    limbs.reset()
    assert limbs.update(UNSEEN_S + 0.2, seen(*arms)) == ()


def test_limbs_that_the_skeleton_lacks_and_unknown_joints_are_not_reported():
    limbs = UnseenLimbs(("pelvis", "left_knee", "left_ankle"))
    none = np.zeros(3, dtype=bool)
    assert limbs.update(0.0, none) == () and limbs.update(1.0, none) == ("left leg",) and limbs.update(2.0, None) == ()
