"""Flexion and abduction in degrees, of poses whose angles are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from lassokin_ros.core.body.kinematics import BodyState, Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.rotations import exponential  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.replay.exports.named_angles import named_angles  # noqa: E402
from lassokin_ros.replay.motion import Motion, Scene  # noqa: E402

SKELETON = Skeleton.load("anthropometric", 1.75)
KINEMATICS = Kinematics(SKELETON, Layout.load("coco17", SKELETON))
UPRIGHT = np.array([np.pi, 0.0, 0.0])  # of the root, in a camera frame with y down: facing the camera


def angles(root=UPRIGHT, level=np.eye(3), **joints):
    """The named angles of one pose. joints: rotation vectors, degrees, at rest x left, y up, z front."""
    vectors = np.zeros((24, 3))
    for name, vector in joints.items():
        vectors[SKELETON.index(name)] = np.radians(vector)
    vectors[0] = root
    pose = KINEMATICS.pose(BodyState(exponential(vectors), np.array([0.3, 0.2, 3.0])))
    motion = Motion("", "camera", SKELETON, {"joint_positions": pose.positions[None]}, Scene(level=level))
    return {name: float(value[0]) for name, value in named_angles(motion).items()}


def test_the_t_pose_is_zero_but_for_the_arms():
    found = angles()
    assert len(found) == 13
    for name, value in found.items():
        expected = 90 if "shoulder abduction" in name else 0
        if "shoulder flexion" not in name:  # an arm that points sideways has none
            assert abs(value - expected) < 4.0, name  # the rest pose is a person's: knees lie a little behind


@pytest.mark.parametrize("root", [UPRIGHT, np.array([0.0, np.pi, 0.0]), np.array([1.0, -2.0, 0.7])])
def test_a_bent_limb_has_its_angle_whatever_way_the_person_faces(root):
    found = angles(root, left_knee=(60, 0, 0), right_elbow=(0, 45, 0), right_hip=(-30, 0, 0), left_hip=(0, 0, 20))
    assert abs(found["left_knee flexion"] - 60) < 1 and abs(found["right_elbow flexion"] - 45) < 1
    assert found["right_knee flexion"] < 1 and found["left_elbow flexion"] < 1
    assert abs(found["right_hip flexion"] - 30) < 4 and abs(found["left_hip abduction"] - 20) < 4


def test_signs():
    arms_down = {"left_shoulder": (0, 0, -90), "right_shoulder": (0, 0, 90)}
    assert abs(angles(**arms_down)["left_shoulder abduction"]) < 4
    assert abs(angles(**arms_down)["right_shoulder abduction"]) < 4
    assert angles(left_hip=(25, 0, 0))["left_hip flexion"] < -20  # extension
    assert angles(right_hip=(0, 0, 15))["right_hip abduction"] < -10  # across the middle
    forward = angles(left_shoulder=(0, -90, 0))
    assert abs(forward["left_shoulder flexion"] - 90) < 6  # and no abduction


@pytest.mark.parametrize("raised", [-30, 45, 110, 158, 182, 200])
def test_a_raised_arm_has_its_angle_up_to_overhead_and_beyond(raised):
    aside = angles(left_shoulder=(0, 0, raised - 90), right_shoulder=(0, 0, 90 - raised))
    assert abs(aside["left_shoulder abduction"] - raised) < 4 and abs(aside["right_shoulder abduction"] - raised) < 4
    vectors = Rotation.from_euler("zx", [[-90, -raised], [90, -raised]], degrees=True).as_rotvec(degrees=True)
    ahead = angles(left_shoulder=vectors[0], right_shoulder=vectors[1])
    assert abs(ahead["left_shoulder flexion"] - raised) < 4 and abs(ahead["right_shoulder flexion"] - raised) < 4


def test_the_lean_of_the_trunk_is_that_in_a_level_world():
    tilt = exponential(np.array([[0.3, 0.0, 0.0]]))[0]
    assert angles()["trunk lean"] < 2
    assert abs(angles(level=tilt)["trunk lean"] - np.degrees(0.3)) < 2
