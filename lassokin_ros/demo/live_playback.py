"""Play a recording into the real node in a child process, on real DDS, and collect the node's outputs.

    with LiveNode({"height": 1.8}) as live:
        live.play(recording)
    live.messages("~/joints")

Messages stay serialised, so that work in this process does not distort the latencies. Set ROS_DOMAIN_ID and
ROS_AUTOMATIC_DISCOVERY_RANGE before: both processes read them from the environment.
"""

from __future__ import annotations

import math
import signal
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lassokin_ros.common.interruption import uninterrupted
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.node.executable import first_sentence
from lassokin_ros.node.message_types import message_class
from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.parameter_files import NODE_NAME
from lassokin_ros.replay.bag_writer import BagWriter
from lassokin_ros.replay.bags import BagReader, typestore

DEADLINE_S = 60.0
GRACE_S = 30.0
QUIET_S = 10.0
"""s: after the last frame, the playback has ended when nothing new arrives for this time."""
OUTPUTS = (*topics.FRAME_OUTPUTS, *topics.OTHER_OUTPUTS)
FRAME_NAMES = tuple(topic.name for topic in topics.FRAME_OUTPUTS)


class PlaybackError(LassokinError, RuntimeError):
    """The node did not start, did not answer in time, or ended with an error."""


@dataclass(frozen=True)
class Received:
    """One serialised output message, its arrival time (s, monotonic) and the time at which it was published (ns)."""

    arrival: float
    published: int
    data: bytes


class LiveNode:
    """The node as a child process, and a DDS peer in this process. Use it in a `with` statement."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, namespace: str = "/playback") -> None:
        """parameters: parameters of the node. namespace: namespace of the node and the topics."""
        self.namespace = namespace
        self.types = typestore()
        self.got: dict[str, list[Received]] = {topic.name: [] for topic in OUTPUTS}
        self.sent: dict[int, float] = {}
        """Stamp of each played keypoint message, ns -> time of sending (s, monotonic)."""
        self._before: dict[str, int] = {}
        self._process: Any = None
        assignments = [text for item in (parameters or {}).items() for text in ("-p", f"{item[0]}:={item[1]}")]
        arguments = ["--ros-args", "-r", f"__ns:={namespace}", *assignments]
        self._command = [sys.executable, "-m", "lassokin_ros.node.command", *arguments]

    def __enter__(self) -> LiveNode:
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node
        from rclpy.signals import SignalHandlerOptions

        self._context = Context()
        # rclpy's signal handlers outlive the context and would block SIGTERM in the processes of a pool.
        try:
            rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        except RuntimeError as error:  # RCLError, such as for a folder of logs that cannot be written
            raise PlaybackError(first_sentence(error)) from None
        self._node = Node("player", namespace=self.namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        for topic in OUTPUTS:
            self._listen(topic)
        try:
            with uninterrupted():
                self._process = subprocess.Popen(self._command, stderr=subprocess.PIPE, text=True)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._executor.shutdown()
            self._node.destroy_node()
            self._context.try_shutdown()
        finally:  # stop the node even if the peer fails
            self._end()

    def _end(self) -> None:
        if self._process is None:
            return
        self._process.send_signal(signal.SIGINT)
        try:
            self.stderr = self._process.communicate(timeout=GRACE_S)[1]
        except subprocess.TimeoutExpired:
            self._process.kill()
            self.stderr = self._process.communicate()[1]
        self.exit_code = self._process.returncode

    def _listen(self, topic: topics.OutputTopic) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile

        durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
        collected = self.got[topic.name]

        own = f"{self.namespace.strip('/')}/{NODE_NAME}:".encode()

        def collect(data: Any, info: Any) -> None:
            if topic.name != topics.DIAGNOSTICS or own in data:  # every node publishes on /diagnostics
                collected.append(Received(time.monotonic(), info["source_timestamp"], data))

        qos = QoSProfile(depth=100, durability=durability)
        name = topic.name.replace("~", NODE_NAME)
        sort = message_class(topic.message_type)
        self._node.create_subscription(sort, name, collect, qos, raw=True)  # type: ignore[arg-type]

    def play(
        self,
        recording: Path,
        rate: float | None = 1.0,
        ahead: int | None = None,
        on_frame: Callable[[], None] = lambda: None,
    ) -> None:
        """Play keypoints and camera_info of a recording and wait for the last answer.

        rate: playback speed, 1 = real time, None = as fast as possible. ahead: maximum number of unanswered frames (for
        recordings without rejected frames). on_frame: called after each keypoint message. Raises PlaybackError at a
        deadline, BagError for a recording that cannot be used.
        """
        frames = self._load(recording)
        self._warm_up(frames)
        started, first = time.monotonic(), frames[0][1]
        self.epoch = started, first, rate or 1.0
        for is_keypoints, time_ns, data in frames:
            self._spin_to(started + (time_ns - first) * 1e-9 / rate if rate is not None else -math.inf)
            if is_keypoints and ahead is not None:
                self._spin_while(lambda: len(self.sent) - len(self.got[topics.JOINT_STATES]) > ahead, "an answer")
            if is_keypoints:
                self.sent[_stamp(data)] = time.monotonic()
                on_frame()
            self._publishers[is_keypoints].publish(data)
        self._finish()

    def _load(self, recording: Path) -> list[tuple[bool, int, bytes]]:
        """Create the publishers; return (is keypoints, recording time in ns, serialised message) of all inputs."""
        from rclpy.qos import QoSProfile

        with BagReader(recording) as bag:
            camera = bag.find(topics.CAMERA_INFO_TYPE, None, topics.CAMERA_INFO, "its name")
            keypoints = bag.find("sensor_msgs/msg/PointCloud2", None, topics.KEYPOINTS, "its name")
            frames = [(name == keypoints.name, time_ns, data) for name, time_ns, data in bag.raw([camera, keypoints])]
        self._publishers = [
            self._node.create_publisher(message_class(topic.message_type), name, QoSProfile(depth=10))
            for topic, name in ((camera, topics.CAMERA_INFO), (keypoints, topics.KEYPOINTS))
        ]
        return frames

    def _warm_up(self, frames: list[tuple[bool, int, bytes]]) -> None:
        """Send the first frame with earlier stamps until a message of every output arrives; then reset the node.

        Only an answer on every topic proves that both processes have found each other in both directions.
        """
        camera = next(data for is_keypoints, _, data in frames if not is_keypoints)
        keypoints = next(data for is_keypoints, _, data in frames if is_keypoints)
        stamp = _stamp(keypoints) - 1000 * 1_000_000_000
        next_try = 0.0

        def silent() -> bool:
            nonlocal stamp, next_try
            if time.monotonic() >= next_try:
                next_try, stamp = time.monotonic() + 0.1, stamp + 100_000_000
                self._publishers[0].publish(camera)
                self._publishers[1].publish(_restamped(keypoints, stamp))
            return not all(self.got[name] for name in FRAME_NAMES)

        self._spin_while(silent, "the node's first answer")
        self._settle()
        self._reset()
        self._before = self._counts()
        for name in FRAME_NAMES:
            self.got[name].clear()

    def _reset(self) -> None:
        from std_srvs.srv import Trigger

        client = self._node.create_client(Trigger, f"{NODE_NAME}/reset")
        self._spin_while(lambda: not client.service_is_ready(), "the service reset")
        future = client.call_async(Trigger.Request())
        self._spin_while(lambda: not future.done(), "the answer of the service reset")

    def _settle(self) -> None:
        """Wait until two successive diagnostics have the same message count."""
        self.got[topics.DIAGNOSTICS].clear()

        def moving() -> bool:
            counts = [self._count(message) for message in self.got[topics.DIAGNOSTICS][-2:]]
            return len(counts) < 2 or counts[0] != counts[1]

        self._spin_while(moving, "a quiet second")

    def _finish(self) -> None:
        """Wait until the node has counted every frame and its outputs have arrived.

        Give up when nothing new arrives for QUIET_S: the figures show what is missing.
        """
        begun = len(self.got[topics.DIAGNOSTICS])

        def counted() -> bool:
            new = self._new_counts()
            return len(self.got[topics.DIAGNOSTICS]) > begun and new["received"] + new[LOST] >= len(self.sent)

        self._spin_while_new(lambda: not counted(), lambda: self._counts()["received"])
        accepted = self._new_counts()["accepted"]
        arrived = lambda: sum(min(len(self.got[name]), accepted) for name in FRAME_NAMES)  # noqa: E731
        self._spin_while_new(lambda: arrived() < accepted * len(FRAME_NAMES), arrived)

    def _spin_while_new(self, condition: Callable[[], bool], progress: Callable[[], int]) -> None:
        """Spin while a condition holds and `progress` has changed within QUIET_S."""
        before, end = progress(), time.monotonic() + QUIET_S
        while condition() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.05)
            if progress() != before:
                before, end = progress(), time.monotonic() + QUIET_S

    def _count(self, message: Received) -> int:
        return int(self._values(message)["received [messages]"])

    def _counts(self) -> Counter[str]:
        """Return the node's counts of messages, from its last diagnostics."""
        unit = " [messages]"
        return Counter({key.removesuffix(unit): int(n) for key, n in self.last_diagnostics().items() if unit in key})

    def _new_counts(self) -> Counter[str]:
        """Return the counts since the playback started.

        Rejections during warm-up do not count: keypoints may arrive before the first camera_info.
        """
        return Counter({key: n - self._before.get(key, 0) for key, n in self._counts().items()})

    def _values(self, message: Received) -> dict[str, str]:
        status = self.types.deserialize_cdr(message.data, "diagnostic_msgs/msg/DiagnosticArray").status[0]
        return {pair.key: pair.value for pair in status.values}

    def _spin_to(self, moment: float) -> None:
        """Spin until a moment; if it has passed, long enough to take one message of each topic."""
        for _ in OUTPUTS if time.monotonic() > moment else ():
            self._executor.spin_once(timeout_sec=0)
        while (left := moment - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def _spin_while(self, condition: Callable[[], bool], what: str) -> None:
        """Spin while a condition holds. Raises PlaybackError at the deadline, or if the node has exited."""
        end = time.monotonic() + DEADLINE_S
        while condition():
            if self._process.poll() is not None:
                raise PlaybackError(f"the node has exited: {(self._process.stderr or sys.stdin).read().strip()}")
            if time.monotonic() > end:
                raise PlaybackError(f"{what} did not arrive within {DEADLINE_S:g} s")
            self._executor.spin_once(timeout_sec=0.05)

    def messages(self, topic: str) -> list[Any]:
        """Return the messages of one output since the playback started, deserialised by rosbags."""
        kind = next(t.message_type for t in OUTPUTS if t.name == topic)
        return [self.types.deserialize_cdr(message.data, kind) for message in self.got[topic]]

    def latencies_ms(self) -> list[float]:
        """Return the time from sending keypoints to the arrival of their joint states, ms, for each answer."""
        arrivals = ((_stamp(message.data), message.arrival) for message in self.got[topics.JOINT_STATES])
        return [1e3 * (arrival - self.sent[stamp]) for stamp, arrival in arrivals if stamp in self.sent]

    def rejected(self) -> int:
        """Return the number of rejected messages of the recording."""
        return sum(n for key, n in self._new_counts().items() if key.startswith("rejected: "))

    def overtaken(self) -> int:
        """Return the number of messages of the recording that the node or DDS dropped for newer ones."""
        return self._new_counts()[OVERTAKEN] + self._new_counts()[LOST]

    def last_diagnostics(self) -> dict[str, str]:
        """Return the values of the node's last diagnostics, by key."""
        return self._values(self.got[topics.DIAGNOSTICS][-1])

    def state(self) -> str:
        """Return the last `~/state` before the last answer.

        A later one may be `lost`, since no more keypoints arrive.
        """
        last = max((message.published for name in FRAME_NAMES for message in self.got[name][-1:]), default=math.inf)
        states = [message for message in self.got[topics.STATE] if message.published <= last]
        return str(self.types.deserialize_cdr(states[-1].data, topics.STATE.message_type).data) if states else ""

    def record(self, path: Path, storage: str = "mcap", replace: bool = False) -> None:
        """Write all received messages to a recording, with times relative to the playback. Raises BagError."""
        started, first, rate = self.epoch
        with BagWriter(path, storage, self.types, replace) as writer:
            everything = [(max(m.arrival, started), topic, m.data) for topic in OUTPUTS for m in self.got[topic.name]]
            for arrival, topic, data in sorted(everything, key=lambda item: item[0]):
                name = topic.name.replace("~", NODE_NAME).strip("/")
                time_ns = first + round((arrival - started) * rate * 1e9)
                writer.write_raw(f"/{name}", topic.message_type, time_ns, data, topic.latched)


def _stamp(data: bytes) -> int:
    """Return the stamp of a serialised message that starts with a header, ns."""
    seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
    return int(seconds * 1_000_000_000 + nanoseconds)


def _restamped(data: bytes, stamp_ns: int) -> bytes:
    copy = bytearray(data)
    struct.pack_into("<iI", copy, 4, *divmod(stamp_ns, 1_000_000_000))
    return bytes(copy)
