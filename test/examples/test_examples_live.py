"""The examples as processes on real DDS, with and without a person."""

import importlib.util
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from geometry_msgs.msg import (  # noqa: E402
    PointStamped,
    Pose,
    PoseArray,
    PoseWithCovarianceStamped,
    TransformStamped,
)
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from rclpy.signals import SignalHandlerOptions  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402

from lassokin_ros import joints as indices  # noqa: E402
from msg_adapters.backends import RclpyBackend  # noqa: E402
from msg_adapters.output_messages.clouds import (  # noqa: E402
    JointsReport,
    LimbCloudBuilder,  # noqa: E402
    SkeletonCloudBuilder,
)
from msg_adapters.output_messages.people import PersonReport, people_builder  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
DEADLINE_S = 60.0


class Robot:
    """Publishes the tracker's outputs, and receives those of an example."""

    def __init__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("robot", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self.got = []

    def listen(self, message_type, topic):
        self.node.create_subscription(message_type, topic, self.got.append, 10)

    def spin_until(self, condition, what, act=lambda: None):
        """Spin, and repeat `act`, until the condition holds."""
        end = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < end, f"{what} did not come"
            act()
            self._executor.spin_once(timeout_sec=0.05)

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def robot():
    result = Robot()
    yield result
    result.close()


@contextmanager
def script(*command):
    """The process of a Python script, killed if it has not ended."""
    process = subprocess.Popen(
        [sys.executable, *command], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def example(name, robot, act=lambda: None, arguments=()):
    """The process of an example; at SIGINT, while `act` is repeated, it must end with exit code 0."""
    with script(f"examples/{name}.py", *arguments) as process:
        yield process
        process.send_signal(signal.SIGINT)
        robot.spin_until(lambda: process.poll() is not None, "the end", act)
        assert process.returncode == 0, process.stdout.read()


def joints(frame_id="camera", **places):
    """A PoseArray of 24 joints; places: index=(x, y, z) by name joint_<index>."""
    message = PoseArray(poses=[Pose() for _ in range(24)])
    message.header.frame_id = frame_id
    for name, (x, y, z) in places.items():
        position = message.poses[int(name.removeprefix("joint_"))].position
        position.x, position.y, position.z = x, y, z
    return message


CLOUD = SkeletonCloudBuilder(RclpyBackend(), 24)
PEOPLE = people_builder(RclpyBackend(), "sensor_msgs/msg/PointCloud2")


def skeleton(places, deviation=(0.05, 0.05, 0.05), seen=True, late_s=0.0, frame_id="camera"):
    """A ~/skeleton of now. places: (24, 3) m; deviation: (3,) m, along x, y and z; late_s: s, age of its stamp."""
    stamp_ns, doubt = time.time_ns() - round(1e9 * late_s), np.tile(np.diag(np.square(deviation)), (24, 1, 1))
    flags, rest = (np.full(24, seen), np.zeros(24), np.zeros(24)), (np.ones(24), np.ones(24))
    report = JointsReport(1, places, np.zeros((24, 3)), doubt, *flags, *rest, np.zeros((24, 4)), np.ones(3))
    return CLOUD.fill(stamp_ns, frame_id, report)


def person_of(message, flag=""):
    """A ~/people with the person of an image. flag: "guessed" or "doubtful" for such a person."""
    person = PersonReport(
        "p1", True, 0.9, np.ones(3), np.array([0, 0, 0, 1.0]), np.zeros(3), np.eye(6), np.ones((1, 3))
    )
    stamp = message.header.stamp
    return PEOPLE.fill(
        stamp.sec * 10**9 + stamp.nanosec,
        message.header.frame_id,
        [replace(person, **{flag: True}) if flag else person],
    )


OPTICAL = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""From axes x front, y left, z up to the optical frame's x right, y down, z forward."""


@pytest.mark.parametrize("axes", [OPTICAL, np.eye(3)], ids=["optical", "fixed"])
def test_a_raised_hand_is_logged_once(robot, axes):
    tracker = robot.node.create_publisher(PointCloud2, "/tracker/skeleton", 10)
    people = robot.node.create_publisher(PointCloud2, "/tracker/people", 10)
    places, lines = np.tile([6.0, 4.0, 1.0], (24, 1)), []
    places[indices.HEAD, 2] = 1.6
    hanging, raised, late = places.copy(), places.copy(), places.copy()
    hanging[indices.LEFT_WRIST] = 6.3, 4.2, 0.7
    raised[indices.LEFT_WRIST] = late[indices.LEFT_WRIST] = 6.3, 4.2, 1.9

    def send(body, flag="", **options):
        tracker.publish(message := skeleton(body @ axes.T, frame_id="any", **options))
        people.publish(person_of(message, flag))

    with example("raised_hand", robot) as process:
        reader = threading.Thread(target=lambda: [lines.append(line) for line in process.stdout])
        reader.start()
        robot.spin_until(lambda: tracker.get_subscription_count(), "the example")
        for _ in range(5):
            send(hanging)
            send(raised, late_s=1.5)
            send(raised, "doubtful")
        robot.spin_until(lambda: tracker.wait_for_all_acked(), "the acknowledgement")
        assert not any("raised" in line for line in lines)
        # the first ones may be lost
        robot.spin_until(lambda: any("raised" in line for line in lines), "the line", lambda: send(raised))
        for _ in range(3):
            send(raised)
        for _ in range(3):
            send(hanging)
            send(raised, seen=False)
        robot.spin_until(lambda: tracker.wait_for_all_acked(), "the acknowledgement")
    reader.join(DEADLINE_S)
    assert sum("left hand raised" in line for line in lines) == 1


def test_a_hand_is_published_while_it_is_visible_certain_still_and_new(robot):
    """The least certain direction may be any one: in a fixed frame it is not z."""
    robot.listen(PointStamped, "/robot/hand")
    tracker = robot.node.create_publisher(PointCloud2, "/robot/tracker/skeleton", 10)
    people = robot.node.create_publisher(PointCloud2, "/robot/tracker/people", 10)

    def send(mark=0.0, flag="", **options):
        """A hand that holds still within 0.01 m; mark: whose offset in mm tells which message it was."""
        places = np.full((24, 3), 3.0 + mark / 1000) + np.arange(24)[:, None]
        tracker.publish(message := skeleton(places, **options))
        people.publish(person_of(message, flag))

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
    tracker = robot.node.create_publisher(PointCloud2, "/tracker/limbs", 10)
    people = robot.node.create_publisher(PointCloud2, "/tracker/people", 10)
    cloud = LimbCloudBuilder(RclpyBackend(), [indices.RIGHT_WRIST], [indices.RIGHT_SHOULDER])

    def send():
        place, doubt, seen = np.array([[1.0, 0.2, -0.4]]), 1e-4 * np.eye(3)[None], np.array([True])
        for count, flag in enumerate(("doubtful", "guessed", "")):
            tracker.publish(message := cloud.fill(time.time_ns(), "camera", (1.0 - count / 4) * place, doubt, seen))
            people.publish(person_of(message, flag))

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
    with script("-c", SIGNALLED) as process:
        said = process.communicate(timeout=2 * DEADLINE_S)[0]
    assert (process.returncode, said) == (0, "published\n")


@pytest.mark.skipif(
    not all(importlib.util.find_spec(name) for name in ("tf2_ros", "tf2_geometry_msgs")),
    reason="tf2_ros and tf2_geometry_msgs are not installed",
)
def test_the_wrist_is_published_in_base_link(robot):
    from tf2_msgs.msg import TFMessage

    robot.listen(PointStamped, "right_wrist")
    tracker = robot.node.create_publisher(PoseArray, "/tracker/joints", 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    tf = robot.node.create_publisher(TFMessage, "/tf_static", latched)

    def send():
        message = joints(joint_21=(0.1, 0.2, 3.0))
        message.header.stamp = robot.node.get_clock().now().to_msg()
        tracker.publish(message)

    with example("wrist_in_base", robot):
        robot.spin_until(lambda: tracker.get_subscription_count(), "the example")
        send()  # without TF: no point
        mount = TransformStamped(child_frame_id="camera")
        mount.header.frame_id, mount.transform.translation.z, mount.transform.rotation.w = "base_link", 1.0, 1.0
        tf.publish(TFMessage(transforms=[mount]))
        robot.spin_until(lambda: robot.got, "a point", send)
        assert robot.got[-1].header.frame_id == "base_link" and robot.got[-1].point.z == pytest.approx(4.0)
