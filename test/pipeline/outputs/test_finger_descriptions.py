"""The URDF of a body with fingers: its kinematics and limits."""

from types import SimpleNamespace

import numpy as np
import pytest
from description_check import DescribedBody

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.pipeline.outputs.urdf import joint_names, range_of, urdf
from lassokin_ros.pipeline.people.joint_angles import JointAngleReader
from lassokin_ros.skeleton_readers import urdf as urdf_reader

SKELETON = Skeleton.load("body_hands", 1.75)
BENT = {"index1": (0, 0.2, -1.2), "index2": (0, 0, -1.6), "ring3": (0, 0, -1.0), "thumb1": (0.5, 0.4, 0.1)}
BENT |= {"thumb3": (0, 1.0, 0), "wrist": (0, 0.2, -0.8)}


@pytest.fixture(scope="module")
def pose():
    """Rotations (54, 3, 3) and positions (54, 3) of a body with bent fingers, and its angles (54, 3)."""
    vectors = np.zeros((54, 3))
    for part, vector in BENT.items():
        vectors[SKELETON.index(f"left_{part}")] = vector
        vectors[SKELETON.index(f"right_{part}")] = np.array(vector) * [1, -1, -1]
    vectors[0] = np.pi, 0, 0
    rotations = exponential(vectors)
    body = Kinematics(SKELETON, Layout.load("mediapipe75", SKELETON))
    positions = body.pose(BodyState(rotations, np.array([0.1, 0.2, 2.5]))).positions
    return positions, JointAngleReader(SKELETON.axes).read(rotations)


def test_the_urdf_is_read_back_as_the_same_tree():
    again = urdf_reader.parse(urdf(SKELETON, "camera", "person/"), "robot_description", height=1.75)
    assert again.joint_names == SKELETON.joint_names and again.axes == SKELETON.axes
    assert np.allclose(again.offsets, SKELETON.offsets, atol=1e-9)


def test_the_urdf_is_driven_by_the_joint_states(pose):
    positions, angles = pose
    state = SimpleNamespace(
        name=joint_names(SKELETON),
        position=np.array([0.1, 0.2, 2.5, *angles.reshape(-1)]),
    )
    assert np.allclose(DescribedBody(urdf(SKELETON, "camera", "person/")).positions(state), positions, atol=1e-6)


def test_locked_axes_have_a_range_about_zero_and_bends_lie_inside(pose):
    for joint, name in enumerate(SKELETON.joint_names[24:], 24):
        for axis, letter in enumerate("xyz"):
            low, high = range_of(name, letter)
            if 3 * joint + axis in SKELETON.locked:
                assert high == pytest.approx(-low) and high < 0.2
            assert low <= pose[1][joint, axis] <= high, (name, letter)
