"""A robot beside the examples: its node on real DDS, the examples as processes, and messages of the tracker."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import rclpy
from forked import Forked
from geometry_msgs.msg import TransformStamped
from live import BACKEND, NO_HANDLERS
from messages import FRAME
from rclpy.executors import SingleThreadedExecutor

from msg_adapters.output_messages.clouds import JointsReport, SkeletonCloudBuilder
from msg_adapters.output_messages.people import PersonReport, people_builder

ROOT = Path(__file__).resolve().parents[2]
LATE_TF = ROOT / "test" / "support" / "late_tf"
EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))
DEADLINE_S = 60.0
CLOUD = SkeletonCloudBuilder(BACKEND, 24)


class Robot:
    """A node that publishes what the tracker would, and receives what an example publishes."""

    def __init__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=NO_HANDLERS)
        self.node = rclpy.create_node("robot", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self.published = {}  # topic: [(time of publication in ns, message)]
        self.got = []  # messages of the topic that is listened to last

    def listen(self, message_type, topic):
        got, self.got = self.published.setdefault(topic, []), []
        messages = self.got

        def take(message, info):
            got.append((info["source_timestamp"], message))
            messages.append(message)

        self.node.create_subscription(message_type, topic, take, 100)

    def publisher(self, message_type, topic):
        return self.node.create_publisher(message_type, topic, 10)

    def spin_until(self, condition, what, act=lambda: None):
        """Spin, and repeat `act`, until the condition holds."""
        end = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < end, f"{what} did not come"
            act()
            self._executor.spin_once(timeout_sec=0.05)

    def spin_for(self, seconds):
        end = time.monotonic() + seconds
        self.spin_until(lambda: time.monotonic() > end, "the time")

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@contextmanager
def running(name, *arguments, script=()):
    """The process of an example, or of the words of a script; ended by SIGKILL if it has not ended. TF may be late."""
    path = [str(LATE_TF), str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, path))}
    command = [sys.executable, *(script or [f"examples/{name}.py"]), *arguments]
    process = Forked(command, ROOT, environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    try:
        yield process
    finally:
        alive = process.poll() is None
        process.kill()
        said = process.communicate()[0]
    assert (alive or process.returncode == 0) and "Traceback" not in said, said


@contextmanager
def example(name, robot, act=lambda: None, arguments=()):
    """The same; at SIGINT, while `act` is repeated, it must end with exit code 0."""
    with running(name, *arguments) as process:
        yield process
        process.send_signal(signal.SIGINT)
        robot.spin_until(lambda: process.poll() is not None, "the end", act)


def load(name):
    """The module of an example."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def transform(stamp_ns, parent, child, place=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0, 1.0)):
    """A TransformStamped of a place (3,) m and a quaternion x, y, z, w."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    for name, value in zip("xyz", place):
        setattr(message.transform.translation, name, value)
    for name, value in zip("xyzw", turn):
        setattr(message.transform.rotation, name, value)
    return message


def base_to_camera(stamp_ns):
    """base_link to the camera, which looks forward from 1 m."""
    return transform(stamp_ns, "base_link", FRAME, (0.0, 0.0, 1.0), (-0.5, 0.5, -0.5, 0.5))


def skeleton(places, deviation=(0.05, 0.05, 0.05), seen=True, late_s=0.0, frame_id="camera"):
    """A ~/skeleton of now. places: (24, 3) m; deviation: (3,) m, along x, y and z; late_s: s, age of its stamp."""
    stamp_ns, doubt = time.time_ns() - round(1e9 * late_s), np.tile(np.diag(np.square(deviation)), (24, 1, 1))
    flags, rest = (np.full(24, seen), np.zeros(24), np.zeros(24)), (np.ones(24), np.ones(24))
    report = JointsReport(1, places, np.zeros((24, 3)), doubt, *flags, *rest, np.zeros((24, 4)), np.ones(3))
    return CLOUD.fill(stamp_ns, frame_id, report)


def report(place=(0.0, 0.0, 3.0), deviation_m=0.1, **fields):
    """A PersonReport of one person who is tracked."""
    place, turn, spread = np.array(place), np.array([0, 0, 0, 1.0]), deviation_m**2 * np.eye(6)
    one = PersonReport("p1", True, 0.9, place, turn, np.zeros(3), spread, place[None])
    return replace(one, **fields)


def people(stamp_ns, frame, *reports, untracked=0):
    """A ~/people of these people."""
    builder = people_builder(BACKEND, "sensor_msgs/msg/PointCloud2")  # it fills the same message each time
    return builder.fill(stamp_ns, frame, list(reports), untracked)


def person_of(message, flag=""):
    """A ~/people with the person of an image. flag: "guessed" or "doubtful" for such a person."""
    stamp = message.header.stamp
    fields = {flag: True} if flag else {}
    return people(stamp.sec * 10**9 + stamp.nanosec, message.header.frame_id, report((1.0, 1.0, 1.0), **fields))
