"""The real process `tracker` under load on real DDS: fed at a constant rate, its latencies and figures measured."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import threading
import time
from array import array
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.common.report import Record
from benchmarks.data.people_in_view import HEIGHT, LANDMARKS, depth_images, view
from benchmarks.timing.usage import Limits, Usage, latency_rows, row, usage_rows
from lassokin_ros.common.progress import Progress
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.demo.synthetic import WEBCAM
from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Seen, Sight
from msg_adapters.backends import RclpyBackend
from msg_adapters.inputs import camera_info, people_cloud

NAMESPACE, FRAME_ID = "/soak", "camera_optical_frame"
CYCLE_S, WARM_UP_S, DEADLINE_S = 24.0, 5.0, 30.0
DETECTION_S = 0.01
"""Delay of keypoints after the camera_info of their image; at most a third of the period."""
STEPS = 500
DEPTH_CYCLE = 90
"""Number of different depth images; the motion goes there and back with them."""
MOST_MEMORY_MB, MOST_CPU, MOST_CORE_CPU, PROMISED_PEOPLE, PROMISED_HZ = 150.0, 8.0, 4.0, 1, 30.0
CPU, CORE_CPU = "process, % of a core", "of it the core's steps, % of a core"


def soak_live(
    seconds: float, people: int, hz: float, clock_hz: float = 0.0, depth: bool = False, limits: Limits = Limits()
) -> list[Record]:
    """Rows of the table of benchmarks/soak.py.

    clock_hz: 0 for the system's time. depth: with depth images. limits: of the node's process.
    """
    messages = _messages(people, hz)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(30 + os.getpid() % 60))
    with Load(people, clock_hz, depth, limits) as load:
        load.feed(messages, hz, WARM_UP_S)
        before = load.counts()
        load.forget()
        begin, started = load.usage(), time.monotonic()
        sent = load.feed(messages, hz, seconds)
        end, spent = load.usage(), time.monotonic() - started
        counts = {key: number - before.get(key, 0) for key, number in load.counts().items()}
        latencies = np.array(load.latencies_ms)
        exit_code, stderr = load.end()
    lost = sent - counts["received"] - counts[LOST]
    return [
        *usage_rows(begin, end),
        *_promises(people, hz, end.memory_mb, 100 * (end.cpu_s - begin.cpu_s) / spent, depth),
        *latency_rows("sent to joint_states", latencies),
        row("messages sent", "", sent),
        *(row(f"messages {key}", "", number) for key, number in counts.items() if number),
        row("messages neither received nor counted", "", lost, lost == 0),
        row("messages answered for everybody", "", len(latencies)),
        row("exit code at SIGINT, lines on stderr", "", f"{exit_code}, {len(stderr)}", exit_code == 0),
    ]


def _promises(people: int, hz: float, memory_mb: float, cpu: float, depth: bool) -> list[Record]:
    """Rows for memory and processor time. Their limits hold for one person at 30 Hz without depth images."""
    core = _core_share(people, hz)
    if people > PROMISED_PEOPLE or hz > PROMISED_HZ or depth:
        return [row(CPU, "", f"{cpu:.1f}"), row(CORE_CPU, "", f"{core:.1f}")]
    return [
        row(f"memory below {MOST_MEMORY_MB:g} MB", "", "", memory_mb < MOST_MEMORY_MB),
        row(f"{CPU}, below {MOST_CPU:g}", "", f"{cpu:.1f}", cpu < MOST_CPU),
        row(f"{CORE_CPU}, below {MOST_CORE_CPU:g}", "", f"{core:.1f}", core < MOST_CORE_CPU),
    ]


def _core_share(people: int, hz: float) -> float:
    """Share of a processor core for the tracker's steps alone, %: processor time per message, times the rate."""
    config = TrackerConfig(height=HEIGHT, landmarks=LANDMARKS)
    bodies = {f"p{person}": TrackedPerson(config) for person in range(people)}
    lens, times, seen = WEBCAM.lens, [], view(0, STEPS, hz, people)
    for number, message in enumerate(zip(seen.pixels, seen.confidence)):
        found = [Seen(lens.normalise(pixels), confidence) for pixels, confidence in zip(*message)]
        start = time.thread_time()
        for (person, body), one in zip(bodies.items(), found):
            body.track([Sight(round(number * 1e9 / hz), one, lens)], "", person)
        times.append(time.thread_time() - start)
    return 100 * float(np.mean(times[1:])) * hz


def _messages(people: int, hz: float) -> list[bytes]:
    """A cycle of serialised keypoint messages; the stamps are written when they are sent."""
    from rclpy.serialization import serialize_message

    backend, seen = RclpyBackend(), view(0, round(CYCLE_S * hz), hz, people)
    return [
        serialize_message(people_cloud(backend, 0, FRAME_ID, list(zip(range(people), pixels, confidence))))
        for pixels, confidence in zip(seen.pixels, seen.confidence)
    ]


def _depth_messages(hz: float) -> list[bytearray]:
    """Serialised depth images of the first frames of one person; the stamps are written when they are sent."""
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import Image
    from std_msgs.msg import Header

    result = []
    for image in depth_images(DEPTH_CYCLE, hz):
        height, width = image.shape
        result.append(bytearray(serialize_message(Image(
            header=Header(frame_id=FRAME_ID), height=height, width=width, encoding="16UC1", step=2 * width,
            data=array("B", image.tobytes())))))  # fmt: skip
    return result


def _order(count: int, frames: int, there_and_back: bool) -> np.ndarray:
    """(count,) index of the frame of each message: round and round, or there and back, which has no jumps."""
    number = np.arange(count)
    return np.abs((number + frames - 1) % (2 * frames - 2) - (frames - 1)) if there_and_back else number % frames


class Load:
    """The node as a child process and a peer in this one. Use it in a `with` statement."""

    def __init__(self, people: int, clock_hz: float = 0.0, depth: bool = False, limits: Limits = Limits()) -> None:
        self._people, self._clock_hz, self._depth, self._limits = people, clock_hz, depth, limits
        self._arrived: dict[int, int] = {}
        self._status: dict[str, str] = {}
        self._statuses = 0
        self.latencies_ms: list[float] = []
        """Latency from the sending of each message to the last person's joint states."""

    def __enter__(self) -> Load:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.executors import SingleThreadedExecutor
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import CameraInfo, Image, JointState, PointCloud2

        arguments = ["-r", f"__ns:={NAMESPACE}", "-p", f"height:={HEIGHT}", "-p", f"max_people:={self._people}"]
        if self._depth:
            arguments += ["-p", f"depth:={topics.DEPTH_IMAGE}"]
        if self._clock_hz:
            arguments += ["-p", "use_sim_time:=true", "-r", "/clock:=clock"]
        command = [sys.executable, "-m", "lassokin_ros.node.command", "--ros-args", *arguments]
        self._process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=self._limits.apply)
        rclpy.init()
        self._node = rclpy.create_node("load", namespace=NAMESPACE)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._camera_info = camera_info(RclpyBackend(), 0, FRAME_ID, WEBCAM.K, WEBCAM.D, WEBCAM.size)
        self._camera = self._node.create_publisher(CameraInfo, topics.CAMERA_INFO, 1)
        self._keypoints = self._node.create_publisher(PointCloud2, topics.KEYPOINTS, 10)
        self._clock = self._node.create_publisher(Clock, "clock", 10) if self._clock_hz else None
        self._depths = self._node.create_publisher(Image, topics.DEPTH_IMAGE, 5) if self._depth else None
        for person in [""] if self._people == 1 else [f"p{number}" for number in range(self._people)]:
            name = topics.of_person(topics.JOINT_STATES, person).replace("~", "tracker")
            self._node.create_subscription(JointState, name, self._on_answer, 100, raw=True)
        self._node.create_subscription(DiagnosticArray, topics.DIAGNOSTICS, self._on_diagnostics, 10)
        self._spin_until(lambda: self._statuses and self._keypoints.get_subscription_count(), "the node")
        return self

    def _on_answer(self, data: bytes) -> None:
        seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
        stamp_ns = seconds * 1_000_000_000 + nanoseconds
        answers = self._arrived.pop(stamp_ns, 0) + 1
        if answers == self._people:
            self.latencies_ms.append(1e-6 * (time.time_ns() - stamp_ns))
        else:
            self._arrived[stamp_ns] = answers

    def _on_diagnostics(self, message: Any) -> None:
        if message.status[0].name.startswith(NAMESPACE[1:]):
            self._status = {pair.key: pair.value for pair in message.status[0].values}
            self._statuses += 1

    def feed(self, messages: list[bytes], hz: float, seconds: float) -> int:
        """Publish keypoints and camera_info at a constant rate from a thread; return the number sent."""
        count, sent = round(seconds * hz), 0
        images = _depth_messages(hz) if self._depth else []
        order = _order(count, len(images) or len(messages), there_and_back=self._depth)
        progress = Progress(count, "messages")

        def send() -> None:
            nonlocal sent
            due = time.monotonic()
            for number in range(count):
                time.sleep(max(due - time.monotonic(), 0))
                due = max(due + 1 / hz, time.monotonic())  # a delayed sender does not send the missed messages
                self._camera.publish(self._camera_info)
                time.sleep(min(DETECTION_S, 1 / (3 * hz)))
                data, stamp = bytearray(messages[order[number]]), divmod(time.time_ns(), 1_000_000_000)
                struct.pack_into("<iI", data, 4, *stamp)
                if self._depths is not None:
                    image = images[order[number]]
                    struct.pack_into("<iI", image, 4, *stamp)
                    self._depths.publish(bytes(image))
                self._keypoints.publish(bytes(data))
                sent += 1
                progress.advance()

        threads = [threading.Thread(target=send)]
        if self._clock is not None:
            threads.append(threading.Thread(target=self._tick, args=(threads[0],)))
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads):
            self._executor.spin_once(timeout_sec=0.05)
        progress.close()
        return sent

    def _tick(self, thread: threading.Thread) -> None:
        """Publish the time on /clock while a thread runs."""
        from rosgraph_msgs.msg import Clock

        message, due = Clock(), time.monotonic()
        while thread.is_alive():
            message.clock.sec, message.clock.nanosec = divmod(time.time_ns(), 1_000_000_000)
            self._clock.publish(message)
            due = max(due + 1 / self._clock_hz, time.monotonic())
            time.sleep(max(due - time.monotonic(), 0))

    def counts(self) -> dict[str, int]:
        """The node's counters in the first diagnostics after this call."""
        wanted = self._statuses + 2
        self._spin_until(lambda: self._statuses >= wanted, "the diagnostics")
        names = {key.removesuffix(" [messages]"): v for key, v in self._status.items() if key.endswith(" [messages]")}
        first = ("received", "accepted", OVERTAKEN, LOST)
        return {key: int(names[key]) for key in (*first, *(k for k in names if k not in first))}

    def forget(self) -> None:
        """Forget the latencies so far."""
        self.latencies_ms.clear()
        self._arrived.clear()

    def usage(self) -> Usage:
        """The present resources of the node's process."""
        return Usage.of(self._process.pid)

    def end(self) -> tuple[int, list[str]]:
        """Stop the node as a user would. Returns its exit code and stderr."""
        self._process.send_signal(signal.SIGINT)
        stderr = self._process.communicate(timeout=DEADLINE_S)[1]
        return self._process.returncode, stderr.splitlines()

    def __exit__(self, *_: object) -> None:
        import rclpy

        if self._process.poll() is None:
            self._process.kill()
        self._process.communicate()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def _spin_until(self, condition: Callable[[], Any], what: str) -> None:
        end = time.monotonic() + DEADLINE_S
        while not condition():
            if time.monotonic() > end or self._process.poll() is not None:
                raise SystemExit(f"{what} did not come within {DEADLINE_S:g} s, or the node has ended")
            self._executor.spin_once(timeout_sec=0.05)
