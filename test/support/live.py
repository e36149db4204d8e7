"""The real node in a process, and a peer in this process, on real DDS."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from forked import Forked
from messages import FRAME, camera_info, cloud
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from lassokin_ros.node.message_types import message_class
from lassokin_ros.pipeline.outputs import topics
from msg_adapters.backends import RclpyBackend

DEADLINE_S = 60.0
"""s: after this time a condition counts as never met. A node starts in 2 s, on a very busy machine in 20 s."""
PAST_S = 1800
"""s between a peer's first stamp and its creation. Stamps an hour in the past would cause a warning."""
NO_HANDLERS = SignalHandlerOptions.NO
"""rclpy's handlers would remain after the context has ended, and SIGTERM would not end the processes of other tests."""
SIMULATED_NS = 10**18
"""Stamps before this are not from the system clock."""
BACKEND = RclpyBackend()
ROOT = Path(__file__).resolve().parents[2]
TRACKER = [sys.executable, "-m", "lassokin_ros.node.command"]


class NodeProcess:
    """`tracker`, or another command, with ROS arguments; killed if it does not end by itself.

    own: whether it is a child of this process, which Python starts, instead of one that is forked.
    """

    def __init__(self, namespace, *ros_arguments, command=TRACKER, folder=ROOT, own=False, **options):
        arguments = [*command, "--ros-args", "-r", f"__ns:={namespace}", *ros_arguments]
        self.said = ""
        if own or command[0] != sys.executable:
            # It may survive the tests' process, if that is killed, and must not keep that process's output open.
            options = {"stdout": subprocess.DEVNULL, **options}
            self.process = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, cwd=folder, **options)
        else:
            self.process = Forked(arguments, folder, **options)

    def stop(self, *signals, grace_s=DEADLINE_S):
        """Send signals, wait, and return (exit code, stderr)."""
        for number in signals:
            self.process.send_signal(number)
        try:
            self.said += self.process.communicate(timeout=grace_s)[1]
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.said += self.process.communicate()[1]
        return self.process.returncode, self.said

    def __enter__(self):
        return self

    def __exit__(self, error, *_):
        if self.process.poll() is None:
            self.stop(signal.SIGINT)
        if error is not None:  # pytest shows it below the failure
            print(self.said, file=sys.stderr)


@contextmanager
def node_in_this_process(namespace, evidence=(), **settings):
    """(node, function that runs its next callback): the node does nothing while it is not called."""
    from lassokin_ros.node.node import TrackerNode

    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=NO_HANDLERS)
    overrides = [Parameter(name, value=value) for name, value in settings.items()]
    node = TrackerNode(evidence=evidence, context=context, namespace=namespace, parameter_overrides=overrides)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield node, lambda: executor.spin_once(timeout_sec=0.05)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


class Peer:
    """Publishes inputs, collects outputs, calls services. It never sleeps; it spins until a condition holds."""

    def __init__(self, namespace, keypoints_type="sensor_msgs/msg/PointCloud2", reliable=True, outputs=True):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]), signal_handler_options=NO_HANDLERS)
        self.node = Node("peer", namespace=namespace, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=10, reliability=reliability)
        self.keypoints = self.node.create_publisher(message_class(keypoints_type), topics.KEYPOINTS, qos)
        self.camera = self.node.create_publisher(message_class(topics.CAMERA_INFO_TYPE), topics.CAMERA_INFO, qos)
        self.got = {topic.name: [] for topic in (*topics.FRAME_OUTPUTS, *topics.OTHER_OUTPUTS)}
        self.namespace, self.per_frame = namespace, set()
        self.start_ns = (time.time_ns() // 1_000_000_000 - PAST_S) * 1_000_000_000  # ns: the first stamp of a test
        if outputs:
            for topic in topics.FRAME_OUTPUTS:
                self.listen(topic)
        self.node.create_subscription(DiagnosticArray, topics.DIAGNOSTICS, self._on_diagnostics, 10)

    def listen(self, topic):
        """Collect a topic's messages in `got`."""
        if topic in (*topics.FRAME_OUTPUTS, *topics.LIVE_OUTPUTS):
            self.per_frame.add(topic.name)
        durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=1000, durability=durability)
        name = topic.name.replace("~", "tracker")
        self.node.create_subscription(message_class(topic.message_type), name, self.got[topic.name].append, qos)

    def _on_diagnostics(self, message):
        if message.status[0].name.startswith(f"{self.namespace[1:]}/tracker:"):
            self.got[topics.DIAGNOSTICS].append(message)

    def spin_until(self, condition, deadline_s=DEADLINE_S, what="the condition"):
        """Spin until `condition()` holds; AssertionError with `what`, words or a function of them, at the deadline."""
        end = time.monotonic() + deadline_s
        while not condition():
            assert time.monotonic() < end, f"{what() if callable(what) else what} did not come within {deadline_s} s"
            self.executor.spin_once(timeout_sec=0.05)

    def send(self, stamp_ns, xy, **options):
        """One PointCloud2 of keypoints."""
        self.keypoints.publish(cloud(BACKEND, stamp_ns, xy, **options))

    def send_camera(self, **options):
        """One camera_info."""
        self.camera.publish(camera_info(BACKEND, **options))

    def start(self, xy, frame_id=FRAME):
        """Send camera_info and a frame repeatedly until the newest one is answered on every topic."""
        stamp_ns, next_at, pause = self.start_ns - 1_000_000_000, 0.0, 0.1

        def answered():
            nonlocal stamp_ns, next_at, pause
            newest = [messages and stamp_of(messages[-1]) for messages in map(self.got.get, names)]
            if newest == [stamp_ns] * len(names):
                return True
            if time.monotonic() > next_at:
                stamp_ns, next_at, pause = stamp_ns + 5_000_000, time.monotonic() + pause, 1.1 * pause
                self.send_camera(frame_id=frame_id)
                self.send(stamp_ns, xy, frame_id=frame_id)
            return False

        names = sorted(self.per_frame)
        self.spin_until(answered, what="the first output of every topic")

    def settle(self):
        """Wait until no more messages arrive: two diagnostics in a row with the same number of received messages."""

        def still():
            recent = [values_of(m)["received [messages]"] for m in self.got[topics.DIAGNOSTICS][-2:]]
            return len(recent) == 2 and recent[0] == recent[1]

        self.got[topics.DIAGNOSTICS].clear()
        self.spin_until(still, what="a quiet second")

    def clear(self):
        """Forget all collected messages."""
        for messages in self.got.values():
            messages.clear()

    def next_diagnostics(self, condition=lambda status: True, since_ns=None):
        """The first status for which the condition holds of those sent after `since_ns`, by default after this call.

        Some words are in one status only. What causes them is done after `since_ns = time.time_ns()`, so that this
        status is found however late the call is.
        """
        messages = self.got[topics.DIAGNOSTICS]
        if since_ns is None:
            since_ns = time.time_ns()
            messages.clear()

        def sent_since():
            # Earlier messages may still be in the queue. (In simulated time this cannot be determined.)
            return [m.status[0] for m in messages if not SIMULATED_NS < stamp_of(m) < since_ns]

        def seen():
            return f"the diagnostics, after {sorted({status.message for status in sent_since()})},"

        found = []
        self.spin_until(lambda: found.extend(filter(condition, sent_since())) or found, what=seen)
        return found[0]

    def call(self, service_type, name, request):
        """The response of a service of the node."""
        client = self.node.create_client(service_type, f"tracker/{name}")
        self.spin_until(client.service_is_ready, what=f"service {name}")
        future = client.call_async(request)
        self.spin_until(future.done, what=f"an answer of {name}")
        self.node.destroy_client(client)
        return future.result()

    def close(self):
        """End this peer's context."""
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def complaints(said):
    """Lines on stderr, without the expected ones: start, missing inputs, tracking, and the rate of messages that are
    sent as fast as they are answered.
    """
    usual = (
        "lassokin_ros ",
        "waiting for ",
        "received the first message on ",
        "tracking",
        "lost: ",
        "nobody is tracked",
        "keypoints rejected (no_camera_info)",
        "reset: ",
        "by their stamps the keypoints have ",
    )
    return [line for line in said.splitlines() if not any(f"]: {words}" in line for words in usual)]


def values_of(message):
    """Key -> value of the first status of a DiagnosticArray, or of a DiagnosticStatus."""
    status = message.status[0] if hasattr(message, "status") else message
    return {pair.key: pair.value for pair in status.values}


def stamp_of(message):
    """Stamp of a message, ns; for a MarkerArray that of its first marker."""
    header = message.markers[0].header if hasattr(message, "markers") else message.header
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def frame_of(message):
    """frame_id of a message; for a MarkerArray that of its first marker."""
    return (message.markers[0].header if hasattr(message, "markers") else message.header).frame_id
