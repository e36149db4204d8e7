"""The examples as processes on real DDS, with and without a person."""

import importlib.util
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from geometry_msgs.msg import PointStamped, Pose, PoseArray, TransformStamped  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from rclpy.signals import SignalHandlerOptions  # noqa: E402

from msg_adapters.backends import RclpyBackend  # noqa: E402
from msg_adapters.output_messages.skeleton_cloud import SkeletonCloudBuilder  # noqa: E402

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
def example(name, robot, act=lambda: None):
    """The process of an example; at SIGINT, while `act` is repeated, it must end with exit code 0."""
    with script(f"examples/{name}.py") as process:
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


def test_a_raised_hand_is_logged_once(robot):
    tracker = robot.node.create_publisher(PoseArray, "/tracker/joints", 10)
    up, lines = joints(joint_15=(0.0, -0.6, 3.0), joint_20=(0.2, -0.9, 3.0)), []
    with example("raised_hand", robot) as process:
        reader = threading.Thread(target=lambda: [lines.append(line) for line in process.stdout])
        reader.start()
        robot.spin_until(lambda: lines, "the line", lambda: tracker.publish(up))  # the first ones may be lost
        for _ in range(3):
            tracker.publish(up)
        robot.spin_until(lambda: tracker.wait_for_all_acked(), "the acknowledgement")
    reader.join(DEADLINE_S)
    assert sum("left hand raised" in line for line in lines) == 1


def test_a_hand_is_published_while_it_is_visible_and_certain(robot):
    from sensor_msgs.msg import PointCloud2

    robot.listen(PointStamped, "hand")
    tracker = robot.node.create_publisher(PointCloud2, "/tracker/skeleton", 10)
    cloud = SkeletonCloudBuilder(RclpyBackend(), 24)

    def message(stamp_s, seen, deviation):
        places = np.full((24, 3), 1.0) + np.arange(24)[:, None]
        doubt = np.tile(deviation**2 * np.eye(3), (24, 1, 1))
        return cloud.fill(
            stamp_s * 10**9, "camera", places, np.zeros((24, 3)), doubt, np.full(24, seen), np.zeros(24), np.ones(24)
        )

    def send(stamp_s=3, seen=True, deviation=0.05):
        tracker.publish(message(stamp_s, seen, deviation))

    with example("hand_over", robot, send):  # it is publishing at SIGINT
        robot.spin_until(lambda: robot.got, "a hand", send)
        send(1, seen=False)
        send(2, deviation=0.2)
        send(4)
        robot.spin_until(lambda: robot.got[-1].header.stamp.sec == 4, "the last hand")
    assert {point.header.stamp.sec for point in robot.got} == {3, 4}
    assert {(point.header.frame_id, point.point.x) for point in robot.got} == {("camera", 22.0)}


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
