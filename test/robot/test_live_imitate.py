"""The node `imitate` as a process on real DDS: off at the start, it follows a person, and holds if the tracker dies.

What else makes it hold is tested without processes, in test_imitate_safety.py.
"""

import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import toy_robot

pytest.importorskip("pink", reason="needs the extra robot: pip install lassokin_ros[robot]")
rclpy = pytest.importorskip("rclpy")

from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from rclpy.signals import SignalHandlerOptions  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402
from simulated.imitated_person import BENT, DOWN, PersonMessages  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEADLINE_S, PERIOD_S = 90.0, 1 / 30


class Tracker:
    """Sends ~/people and ~/skeleton of a person at 30 Hz while it spins, and collects what imitate says."""

    def __init__(self, namespace):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("peer", context=self.context, namespace=namespace)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.people = self.node.create_publisher(PointCloud2, "tracker/people", 10)
        self.skeleton = self.node.create_publisher(PointCloud2, "tracker/skeleton", 10)
        self.state = self.node.create_publisher(String, "tracker/state", LATCHED)
        self.description = self.node.create_publisher(String, "robot_description", LATCHED)
        self.commands, self.said = [], []
        self.node.create_subscription(JointState, "joint_commands", self.commands.append, 1000)
        self.node.create_subscription(String, "imitating", lambda message: self.said.append(message.data), LATCHED)
        self.enable = self.node.create_client(SetBool, "enable")
        self.messages, self.view, self.next_s, self.sent_s = PersonMessages(), None, 0.0, 0.0
        self.state.publish(String(data="tracking"))

    def send(self):
        share = 0.5 - 0.5 * np.cos(2 * np.pi * 0.3 * time.monotonic())  # to and fro, never faster than people
        moved = replace(self.view, places=self.view.places + share * (BENT.places - self.view.places))
        people, skeleton = self.messages.of(time.time_ns(), moved)
        self.people.publish(people)
        self.skeleton.publish(skeleton)
        self.sent_s = time.time()

    def spin_until(self, condition, what):
        end = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < end, f"{what} did not come; the node said {self.said}"
            if self.view is not None and time.monotonic() > self.next_s:
                self.next_s = time.monotonic() + PERIOD_S
                self.send()
            self.executor.spin_once(timeout_sec=0.005)

    def until_said(self, words):
        self.spin_until(lambda: self.said and words in self.said[-1], f"'{words}'")

    def call(self, on):
        self.spin_until(self.enable.service_is_ready, "the service enable")
        future = self.enable.call_async(SetBool.Request(data=on))
        self.spin_until(future.done, "an answer")
        return future.result()

    def until_follows(self):
        self.until_said("following")
        self.commands.clear()
        self.spin_until(lambda: moving(self.commands), "motion")


def moving(commands):
    """The commands with a speed."""
    return [command for command in commands if np.abs(command.velocity).max() > 1e-6]


@pytest.fixture
def live(tmp_path, request):
    namespace = f"/imitate_{request.node.name.removeprefix('test_')[:20]}"
    robot = tmp_path / "toy.yaml"
    robot.write_text(toy_robot.as_yaml(toy_robot.robot()))
    command = [sys.executable, "-m", "lassokin_ros.cli.lassokin", "imitate", "--ros-args", "-r", f"__ns:={namespace}"]
    process = subprocess.Popen(
        [*command, "-p", f"robot:={robot}"], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    tracker = Tracker(namespace)
    yield tracker, process
    process.kill()
    process.communicate()
    tracker.executor.shutdown()
    tracker.node.destroy_node()
    tracker.context.try_shutdown()


def test_a_robot_follows_a_person_and_stops_in_half_a_second_if_the_tracker_is_killed(live):
    tracker, process = live
    tracker.until_said("not enabled")
    assert not tracker.call(True).success  # without a robot
    tracker.description.publish(String(data=toy_robot.urdf().replace("left_hand_link", "hand")))
    tracker.until_said("no link 'left_hand_link'")
    tracker.description.publish(String(data=toy_robot.urdf()))
    tracker.until_said("not enabled")
    tracker.view = DOWN
    assert not tracker.commands  # off: no command
    answer = tracker.call(True)
    assert answer.success and "joint_states were not received" in answer.message
    tracker.until_follows()
    names = tracker.commands[-1].name
    assert set(names) == {"waist"} | {f"{s}_{j}" for s in ("left", "right") for j, *_ in toy_robot.ARM}
    elbow = names.index("left_elbow")
    tracker.spin_until(lambda: tracker.commands[-1].position[elbow] < -1.0, "the bent elbow")

    tracker.until_follows()
    tracker.commands.clear()
    tracker.spin_until(lambda: len(tracker.commands) > 5, "commands")
    last_s, tracker.view = tracker.sent_s, None  # the tracker is killed
    tracker.until_said("nobody certain was seen for 0.3 s")
    tracker.spin_until(lambda: not moving(tracker.commands[-20:]), "a still robot")
    stamps = [command.header.stamp.sec + 1e-9 * command.header.stamp.nanosec for command in tracker.commands]
    ends = [stamp for stamp, command in zip(stamps, tracker.commands) if command in moving([command])]
    longest = max(np.diff(stamps))  # s, between two ticks: 0.01, more on a busy machine
    assert ends[-1] - last_s < 0.5 + 10 * (longest - 0.01)

    assert tracker.call(False).success
    tracker.until_said("not enabled")
    process.send_signal(signal.SIGINT)
    tracker.spin_until(lambda: process.poll() is not None, "the end")
    assert process.returncode == 0, process.stderr.read()
