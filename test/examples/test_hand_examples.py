"""The examples with hands as processes on real DDS."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseWithCovarianceStamped  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402
from simulated.hands import posture  # noqa: E402
from test_examples_live import example, person_of, robot  # noqa: E402, F401

from lassokin_ros.core.body.rotations import to_quaternion  # noqa: E402
from lassokin_ros.core.output.hand_points import hand_axes  # noqa: E402
from lassokin_ros.gestures import GESTURES  # noqa: E402
from msg_adapters.backends import RclpyBackend  # noqa: E402
from msg_adapters.output_messages.clouds import HandCloudBuilder, HandReport  # noqa: E402

CLOUD = HandCloudBuilder(RclpyBackend(), 2)
TO_MANO = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]])


def hands(places, gesture="other", ray=(0.0, 0.6, -0.8), seen=True):
    """A ~/hands of now with two hands at the same places (21, 3) m."""
    axes = hand_axes(places)
    along, quaternion = (places - places[0]) @ axes, to_quaternion(axes)
    shared = np.tile(1e-6 * np.eye(3), (21, 1, 1)), np.full(21, seen), places[0], quaternion, np.array(ray), 0.05
    shared += GESTURES.index(gesture), 0.9
    return CLOUD.fill(time.time_ns(), "map", [HandReport(side, 1, along, *shared) for side in (0, 1)])


class Sender:
    def __init__(self, robot):  # noqa: F811
        self.hands = robot.node.create_publisher(PointCloud2, "/tracker/hands", 10)
        self.people = robot.node.create_publisher(PointCloud2, "/tracker/people", 10)

    def __call__(self, message, flag=""):
        self.hands.publish(message)
        self.people.publish(person_of(message, flag))


def test_the_place_on_the_floor_is_published_while_a_hand_points(robot):  # noqa: F811
    robot.listen(PoseWithCovarianceStamped, "pointed_at")
    send = Sender(robot)
    pointing, fist = posture("pointing") + [0, 0, 1.2], posture("fist") + [0, 0, 1.2]
    with example("pointing", robot, lambda: send(hands(pointing, "pointing"))):
        robot.spin_until(lambda: robot.got, "a place", lambda: send(hands(pointing, "pointing")))
        for _ in range(3):
            send(hands(fist, "fist"))
            send(hands(fist, "pointing"), "doubtful")
            send(hands(fist, "pointing", seen=False))
    tip = pointing[8]
    place, covariance = robot.got[0].pose.pose.position, robot.got[0].pose.covariance.reshape(6, 6)
    assert robot.got[0].header.frame_id == "map" and place.z == 0
    assert (place.x, place.y) == pytest.approx((tip[0], tip[1] + 0.75 * tip[2]), abs=1e-4)
    assert {target.pose.pose.position.y for target in robot.got} == {place.y}
    across = 0.05 * tip[2] / 0.8
    assert np.allclose(covariance[:2, :2], np.diag([across**2, (across / 0.8) ** 2]), rtol=1e-3)


HAND = """<robot name="hand"><link name="palm"/>{}</robot>"""
TURNS = '<axis xyz="{axis}"/><limit lower="-1.6" upper="1.6" effort="1" velocity="1"/>'
FINGER = (
    '<link name="{n}1"/><joint name="{n}a" type="revolute"><parent link="palm"/><child link="{n}1"/>'
    f'<origin xyz="{{xyz}}"/>{TURNS}</joint>'
    '<link name="{n}2"/><joint name="{n}b" type="revolute"><parent link="{n}1"/><child link="{n}2"/>'
    f'<origin xyz="{{first}}"/>{TURNS}</joint>'
    '<link name="{n}_tip"/><joint name="{n}c" type="fixed"><parent link="{n}2"/><child link="{n}_tip"/>'
    '<origin xyz="{second}"/></joint>'
)


def urdf_of(places):
    """A hand of two fingers with the person's lengths, straight at rest, in the axes of `retarget_hand`."""
    along = (places - places[0]) @ hand_axes(places) @ TO_MANO
    fingers = ""
    for name, (root, middle, tip) in {"index": (5, 6, 8), "middle": (9, 10, 12)}.items():
        direction = along[root] / np.linalg.norm(along[root])
        axis = np.cross(direction, np.cross(along[5], along[9]))
        lengths = np.linalg.norm(along[middle] - along[root]), np.linalg.norm(along[tip] - along[middle])
        numbers = dict(xyz=along[root], axis=axis / np.linalg.norm(axis))
        numbers |= dict(first=lengths[0] * direction, second=lengths[1] * direction)
        fingers += FINGER.format(n=name, **{key: " ".join(f"{v:.9g}" for v in value) for key, value in numbers.items()})
    return HAND.format(fingers)


def test_the_fingertips_of_a_robots_hand_follow(robot, tmp_path):  # noqa: F811
    pin = pytest.importorskip("pinocchio", reason="pinocchio (pip install pin) is needed")
    robot.listen(JointState, "hand_joints")
    send, bent = Sender(robot), posture("grasp")
    file = tmp_path / "hand.urdf"
    file.write_text(urdf_of(posture("open palm")))
    with example("retarget_hand", robot, lambda: send(hands(bent)), (str(file), "index_tip", "8", "middle_tip", "12")):
        robot.spin_until(lambda: robot.got, "a posture", lambda: send(hands(bent)))
        count = len(robot.got)
        robot.spin_until(lambda: len(robot.got) > count + 1, "more", lambda: send(hands(bent)))
    state = SimpleNamespace(**dict(zip(robot.got[-1].name, robot.got[-1].position)))
    assert vars(state).keys() == {"indexa", "indexb", "middlea", "middleb"}
    model = pin.buildModelFromUrdf(str(file))
    data, wanted = model.createData(), (bent - bent[0]) @ hand_axes(bent) @ TO_MANO
    found = np.array([getattr(state, name) for name in list(model.names)[1:]])

    def apart(angles, tip, point):
        pin.framesForwardKinematics(model, data, angles)
        return data.oMf[model.getFrameId(tip)].translation - wanted[point]

    for tip, point in (("index_tip", 8), ("middle_tip", 12)):  # as near as two parallel axes allow
        nearest = least_squares(apart, found, bounds=(-1.6, 1.6), args=(tip, point))
        assert np.linalg.norm(nearest.fun) < 0.03
        assert np.linalg.norm(apart(found, tip, point)) < np.linalg.norm(nearest.fun) + 0.002
