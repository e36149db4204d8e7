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
from pathlib import Path
from typing import Any, NamedTuple

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
TYPES = {topic.name: topic.message_type for topic in OUTPUTS}
UNIT = " [messages]"
"""End of the keys of /diagnostics that count messages."""


class PlaybackError(LassokinError, RuntimeError):
    """The node did not start, did not answer in time, or ended with an error."""


class Received(NamedTuple):
    """One serialised output message, its arrival time (s, monotonic) and the time at which it was published (ns)."""

    arrival: float
    published: int
    data: bytes


class LiveNode:
    """The node as a child process, and a DDS peer in this process. Use it in a `with` statement."""

    def __init__(self, parameters: Mapping[str, Any] | None = None, namespace: str = "/playback") -> None:
        """parameters: parameters of the node. namespace: namespace of the node and the topics."""
        self._namespace, self._types = namespace, typestore()
        self._got: dict[str, list[Received]] = {topic.name: [] for topic in OUTPUTS}
        self.sent: dict[int, float] = {}
        """Stamp of each played keypoint message, ns -> time of sending (s, monotonic)."""
        self._before: Counter[str] = Counter()
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
        self._node = Node("player", namespace=self._namespace, context=self._context)
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
            if self._process is not None:
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
        collected, own = self._got[topic.name], f"{self._namespace.strip('/')}/{NODE_NAME}:".encode()

        def collect(data: Any, info: Any) -> None:
            if topic.name != topics.DIAGNOSTICS or own in data:  # every node publishes on /diagnostics
                collected.append(Received(time.monotonic(), info["source_timestamp"], data))

        qos, kind = QoSProfile(depth=100, durability=durability), message_class(topic.message_type)
        name = topic.name.replace("~", NODE_NAME)
        self._node.create_subscription(kind, name, collect, qos, raw=True)  # type: ignore[arg-type]

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
        self._epoch = started, first, rate or 1.0
        for is_keypoints, time_ns, data in frames:
            moment = started + (time_ns - first) * 1e-9 / rate if rate is not None else -math.inf
            for _ in OUTPUTS if time.monotonic() > moment else ():  # too late: take one message of each topic
                self._executor.spin_once(timeout_sec=0)
            while (left := moment - time.monotonic()) > 0:
                self._executor.spin_once(timeout_sec=left)
            if is_keypoints and ahead is not None:
                self._spin_while(lambda: len(self.sent) - len(self._got[topics.JOINT_STATES]) > ahead, "an answer")
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
        from std_srvs.srv import Trigger

        camera, keypoints = (next(data for kind, _, data in frames if kind is wanted) for wanted in (False, True))
        stamp, next_try = _stamp(keypoints) - 1000 * 1_000_000_000, 0.0

        def silent() -> bool:
            nonlocal stamp, next_try
            if time.monotonic() >= next_try:
                next_try, stamp = time.monotonic() + 0.1, stamp + 100_000_000
                copy = bytearray(keypoints)
                struct.pack_into("<iI", copy, 4, *divmod(stamp, 1_000_000_000))
                self._publishers[0].publish(camera)
                self._publishers[1].publish(bytes(copy))
            return not all(self._got[name] for name in FRAME_NAMES)

        def moving() -> bool:
            """Whether the last two diagnostics have other counts of messages."""
            return len(reports) < 2 or self._counts(reports[-2])["received"] != self._counts()["received"]

        self._spin_while(silent, "the node's first answer")
        reports = self._got[topics.DIAGNOSTICS]
        reports.clear()
        self._spin_while(moving, "a quiet second")
        client = self._node.create_client(Trigger, f"{NODE_NAME}/reset")
        self._spin_while(lambda: not client.service_is_ready(), "the service reset")
        future = client.call_async(Trigger.Request())
        self._spin_while(lambda: not future.done(), "the answer of the service reset")
        self._before = self._counts()
        for name in FRAME_NAMES:
            self._got[name].clear()

    def _finish(self) -> None:
        """Wait until the node has counted every frame and its outputs have arrived, or nothing new arrives."""
        reports = self._got[topics.DIAGNOSTICS]
        begun = len(reports)

        def uncounted() -> bool:
            new = self._new_counts()
            return len(reports) == begun or new["received"] + new[LOST] < len(self.sent)

        self._spin_while(uncounted, progress=lambda: self._counts()["received"])
        accepted = self._new_counts()["accepted"]

        def arrived() -> int:
            return sum(min(len(self._got[name]), accepted) for name in FRAME_NAMES)

        self._spin_while(lambda: arrived() < accepted * len(FRAME_NAMES), progress=arrived)

    def _spin_while(
        self, condition: Callable[[], bool], what: str = "", progress: Callable[[], int] | None = None
    ) -> None:
        """Spin while a condition holds; with `progress` also until that has not changed for QUIET_S.

        Raises PlaybackError if the node has exited, and without `progress` at the deadline.
        """
        before, end = None, time.monotonic() + DEADLINE_S
        while condition():
            if self._process.poll() is not None:
                raise PlaybackError(f"the node has exited: {(self._process.stderr or sys.stdin).read().strip()}")
            if progress is not None and (now := progress()) != before:
                before, end = now, time.monotonic() + QUIET_S
            if time.monotonic() > end:
                if progress is None:
                    raise PlaybackError(f"{what} did not arrive within {DEADLINE_S:g} s")
                return
            self._executor.spin_once(timeout_sec=0.05)

    def _counts(self, report: Received | None = None) -> Counter[str]:
        """Return the node's counts of messages by key, by default those of its last diagnostics."""
        data = (report or self._got[topics.DIAGNOSTICS][-1]).data
        pairs = self._types.deserialize_cdr(data, TYPES[topics.DIAGNOSTICS]).status[0].values
        return Counter({pair.key.removesuffix(UNIT): int(pair.value) for pair in pairs if UNIT in pair.key})

    def _new_counts(self) -> Counter[str]:
        """Return the counts since the playback started: in the warm-up, keypoints may precede the first camera_info."""
        return Counter({key: n - self._before[key] for key, n in self._counts().items()})

    def messages(self, topic: str) -> list[Any]:
        """Return the messages of one output since the playback started, deserialised by rosbags."""
        return [self._types.deserialize_cdr(message.data, TYPES[topic]) for message in self._got[topic]]

    def latencies_ms(self) -> list[float]:
        """Return the time from sending keypoints to the arrival of their joint states, ms, for each answer."""
        arrivals = ((_stamp(message.data), message.arrival) for message in self._got[topics.JOINT_STATES])
        return [1e3 * (arrival - self.sent[stamp]) for stamp, arrival in arrivals if stamp in self.sent]

    def rejected(self) -> int:
        """Return the number of rejected messages of the recording."""
        return sum(n for key, n in self._new_counts().items() if key.startswith("rejected: "))

    def overtaken(self) -> int:
        """Return the number of messages of the recording that the node or DDS dropped for newer ones."""
        return self._new_counts()[OVERTAKEN] + self._new_counts()[LOST]

    def state(self) -> str:
        """Return the last `~/state` before the last answer. A later one may be `lost`: no more keypoints arrive."""
        last = max((message.published for name in FRAME_NAMES for message in self._got[name][-1:]), default=math.inf)
        states = [message for message in self._got[topics.STATE] if message.published <= last]
        return str(self._types.deserialize_cdr(states[-1].data, TYPES[topics.STATE]).data) if states else ""

    def record(self, path: Path, storage: str = "mcap", replace: bool = False) -> None:
        """Write all received messages to a recording, with times relative to the playback. Raises BagError."""
        started, first, rate = self._epoch
        with BagWriter(path, storage, self._types, replace) as writer:
            everything = [(max(m.arrival, started), topic, m.data) for topic in OUTPUTS for m in self._got[topic.name]]
            for arrival, topic, data in sorted(everything, key=lambda item: item[0]):
                name = topic.name.replace("~", NODE_NAME).strip("/")
                time_ns = first + round((arrival - started) * rate * 1e9)
                writer.write_raw(f"/{name}", topic.message_type, time_ns, data, topic.latched)


def _stamp(data: bytes) -> int:
    """Return the stamp of a serialised message that starts with a header, ns."""
    seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
    return int(seconds * 1_000_000_000 + nanoseconds)
