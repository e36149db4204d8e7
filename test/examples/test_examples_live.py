"""The examples as processes on real DDS, beside a tracker's outputs that the test sends."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

pytest.importorskip("rclpy")

from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped  # noqa: E402
from rcl_interfaces.msg import Log  # noqa: E402
from robots import BACKEND, DEADLINE_S, Robot, example, person_of, running, skeleton  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402
from simulated.hands import posture  # noqa: E402

from lassokin_ros import joints as indices  # noqa: E402
from lassokin_ros.core.body.rotations import to_quaternion  # noqa: E402
from lassokin_ros.core.output.hand_points import hand_axes  # noqa: E402
from lassokin_ros.gestures import GESTURES  # noqa: E402
from msg_adapters.output_messages.clouds import HandCloudBuilder, HandReport, LimbCloudBuilder  # noqa: E402

HANDS = HandCloudBuilder(BACKEND, 2)
TO_MANO = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]])


@pytest.fixture
def robot():
    result = Robot()
    yield result
    result.close()


class Sender:
    """Sends an output of the tracker, and ~/people with its person."""

    def __init__(self, robot, output, tracker="/tracker"):
        self.output = robot.publisher(PointCloud2, f"{tracker}/{output}")
        self.people = robot.publisher(PointCloud2, f"{tracker}/people")

    def __call__(self, message, flag=""):
        self.output.publish(message)
        self.people.publish(person_of(message, flag))


OPTICAL = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""From axes x front, y left, z up to the optical frame's x right, y down, z forward."""


@pytest.mark.parametrize("axes", [OPTICAL, np.eye(3)], ids=["optical", "fixed"])
def test_a_raised_hand_is_logged_once(robot, axes):
    robot.listen(Log, "/rosout")
    send = Sender(robot, "skeleton")
    places = np.tile([6.0, 4.0, 1.0], (24, 1))
    places[indices.HEAD, 2] = 1.6
    hanging, raised = places.copy(), places.copy()
    hanging[indices.LEFT_WRIST] = 6.3, 4.2, 0.7
    raised[indices.LEFT_WRIST] = 6.3, 4.2, 1.9

    def body(places, **options):
        return skeleton(places @ axes.T, frame_id="any", **options)

    def logged():
        return sum(log.name == "raised_hand" and "left hand raised" in log.msg for log in robot.got)

    with example("raised_hand", robot):
        robot.spin_until(send.output.get_subscription_count, "the example")
        for _ in range(5):
            send(body(hanging))
            send(body(raised, late_s=1.5))
            send(body(raised), "doubtful")
        robot.spin_until(send.output.wait_for_all_acked, "the acknowledgement")
        robot.spin_for(0.2)
        assert not logged()
        robot.spin_until(logged, "the line", lambda: send(body(raised)))  # the first ones may be lost
        for _ in range(3):
            send(body(raised))
        for _ in range(3):
            send(body(hanging))
            send(body(raised, seen=False))
        robot.spin_until(send.output.wait_for_all_acked, "the acknowledgement")
        robot.spin_for(0.2)
    assert logged() == 1


def test_a_hand_is_published_while_it_is_visible_certain_still_and_new(robot):
    """The least certain direction may be any one: in a fixed frame it is not z."""
    robot.listen(PointStamped, "/robot/hand")
    sent = Sender(robot, "skeleton", "/robot/tracker")

    def send(mark=0.0, flag="", **options):
        """A hand that holds still within 0.01 m; mark: whose offset in mm tells which message it was."""
        places = np.full((24, 3), 3.0 + mark / 1000) + np.arange(24)[:, None]
        sent(skeleton(places, **options), flag)

    with example("hand_over", robot, send, ("--ros-args", "-r", "__ns:=/robot")):  # it is publishing at SIGINT
        robot.spin_until(lambda: robot.got, "a hand", send)
        send(1.0, seen=False)
        send(2.0, deviation=(0.2, 0.05, 0.2))
        send(5.0, deviation=(0.05, 0.4, 0.05))
        send(6.0, late_s=1.5)
        send(7.0, late_s=-1.5)
        send(8.0, "doubtful")
        send(9.0, "guessed")
        send(500.0)
        began = len(robot.got)
        robot.spin_until(lambda: len(robot.got) > began, "a hand after the motion", lambda: send(504.0))
        robot.spin_until(
            lambda: robot.got[-1].point.x == pytest.approx(24.505, abs=1e-4),
            "the last hand",
            lambda: send(505.0, deviation=(0.25, 0.05, 0.05)),
        )
    marks = {round(1000 * (point.point.x - 24.0)) for point in robot.got}
    assert marks == {0, 504, 505}
    assert {point.header.frame_id for point in robot.got} == {"camera"}


@pytest.mark.parametrize("frame", ["", "right_arm_base"])
def test_the_target_of_an_arm_is_in_a_frame_of_the_robot_or_in_none(robot, frame):
    """~/limbs has the frame_id of the camera, and the person's right_shoulder has other axes than the trunk."""
    robot.listen(PoseWithCovarianceStamped, "arm_target")
    sent, cloud = Sender(robot, "limbs"), LimbCloudBuilder(BACKEND, [indices.RIGHT_WRIST], [indices.RIGHT_SHOULDER])

    def send():
        place, doubt, seen = np.array([[1.0, 0.2, -0.4]]), 1e-4 * np.eye(3)[None], np.array([True])
        for count, flag in enumerate(("doubtful", "guessed", "")):
            sent(cloud.fill(time.time_ns(), "camera", (1.0 - count / 4) * place, doubt, seen), flag)

    arguments = ("--ros-args", "-p", f"shoulder_frame:={frame}") if frame else ()
    with example("imitate_arm", robot, send, arguments):
        robot.spin_until(lambda: robot.got, "a target", send)
    assert {target.header.frame_id for target in robot.got} == {frame}
    for place in [target.pose.pose.position for target in robot.got]:
        assert [place.x, place.y, place.z] == pytest.approx([0.4, 0.08, -0.16])


SIGNALLED = """
import os, signal, time
from rclpy.node import Node
from std_msgs.msg import String
from lassokin_ros.node.executable import run

class Signalled(Node):
    def __init__(self):
        super().__init__("signalled")
        self.publisher = self.create_publisher(String, "text", 10)
        self.create_timer(0.01, self.on_timer)

    def on_timer(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.2)
        self.publisher.publish(String())
        print("published")

run(Signalled)
"""


def test_a_signal_does_not_interrupt_a_callback():
    """With rclpy's own handler the context would end at once, and the callback could not publish."""
    with running("", script=("-c", SIGNALLED)) as process:
        said = process.communicate(timeout=2 * DEADLINE_S)[0]
    assert (process.returncode, said) == (0, "published\n")


def hands(places, gesture="other", ray=(0.0, 0.6, -0.8), seen=True):
    """A ~/hands of now with two hands at the same places (21, 3) m."""
    axes = hand_axes(places)
    along, quaternion = (places - places[0]) @ axes, to_quaternion(axes)
    shared = np.tile(1e-6 * np.eye(3), (21, 1, 1)), np.full(21, seen), places[0], quaternion, np.array(ray), 0.05
    shared += GESTURES.index(gesture), 0.9
    return HANDS.fill(time.time_ns(), "map", [HandReport(side, 1, along, *shared) for side in (0, 1)])


def test_the_place_on_the_floor_is_published_while_a_hand_points(robot):
    robot.listen(PoseWithCovarianceStamped, "pointed_at")
    send = Sender(robot, "hands")
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


def test_the_fingertips_of_a_robots_hand_follow(robot, tmp_path):
    pin = pytest.importorskip("pinocchio", reason="pinocchio (pip install pin) is needed")
    robot.listen(JointState, "hand_joints")
    send, bent = Sender(robot, "hands"), posture("grasp")
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
