"""The pose of a hand alone by the network: the start of the first frame."""

import numpy as np
import pytest
from cases import one_view
from simulated.hands import BODY, hand_tracker, kinematics_of, scene, seen

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential, logarithm
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.network_pose import HandPose
from lassokin_ros.core.kernel import kernel
from lassokin_ros.core.network.hand_network import HandEstimator
from lassokin_ros.core.observation import HERE


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


def test_kernel_and_python_give_the_same_hand():
    _, points = scene("right", 4.0)
    found = []
    for active in (False, kernel.active):
        with kernel.switched(active):
            tracker = hand_tracker("right")
            found.append([tracker.track(seen(frame, points[frame])).pose.positions for frame in range(20)])
    assert np.abs(np.array(found[0]) - found[1]).max() < 1e-6
