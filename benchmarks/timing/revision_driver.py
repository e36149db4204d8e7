"""One revision's side of benchmarks/against.py: runs requests from standard input, and answers with processor times.

The script runs with the revision's tree as import path, whichever layout of modules the tree has. It imports nothing of
this tree. A request is a line of JSON, {"figure": NAME, "count": N}; the answer is a line with a list of seconds.
"""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO
from typing import Any

import numpy as np

NOISE_PX = 2.0
FRAME_ID = "camera_optical_frame"


def first_of(*places: str) -> Any:
    """The first of several `module:name` that this revision has."""
    for place in places:
        module, _, name = place.partition(":")
        try:
            return getattr(import_module(module), name)
        except (ImportError, AttributeError):
            continue
    raise ImportError(f"this revision has none of: {', '.join(places)}")


Tracker = first_of("lassokin_ros.core.tracker:Tracker")
TrackerConfig = first_of("lassokin_ros.core.config:TrackerConfig")
Observation = first_of("lassokin_ros.core.observation:Observation", "lassokin_ros.core.estimate:Observation")


class Side:
    """The figures of this revision on given keypoints. Each continues where it stopped."""

    def __init__(self, data: Any, body: str, layout: str, recording: str = "") -> None:
        """data: arrays of benchmarks/against.py. body, layout: files of the skeleton with joints55.

        recording: folder of the recording for `replay`.
        """
        self._recording = recording
        self._focal, self._fps, self._pixels = float(data["focal"]), float(data["fps"]), data["pixels"]
        self._points = data["points"]  # (people, f, 17, 2)
        config = {"height": float(data["height"]), "noise_px": NOISE_PX}
        self._one = [Tracker(TrackerConfig(**config))]
        self._crowd = [Tracker(TrackerConfig(**config)) for _ in self._points]
        self._hands = [Tracker(TrackerConfig(**config, skeleton=body, landmarks=layout))]
        self._hand_points = data["hand_points"][None]
        self._first = Tracker(TrackerConfig(**config))
        self._places: dict[str, int] = {}
        self._nodes: dict[str, tuple[Any, list[float]]] = {}
        self.figures: dict[str, Callable[[int], float]] = {
            "step": lambda frame: self._step(self._one, self._points[:1], frame),
            "people16": lambda frame: self._step(self._crowd, self._points, frame),
            "joints55": lambda frame: self._step(self._hands, self._hand_points, frame),
            "first_upright": lambda frame: self._start(self._points[0], frame),
            "first_lying": lambda frame: self._start(self._points[0] @ np.array([[0.0, 1.0], [-1.0, 0.0]]), frame),
            "callback_idle": lambda frame: self._callback("nobody", frame),
            "callback_all": lambda frame: self._callback("all", frame),
            "replay": lambda frame: self._replay(),
        }

    def run(self, figure: str, count: int) -> list[float]:
        """Seconds of the processor for each of the next frames."""
        begin = self._places.get(figure, 0)
        self._places[figure] = begin + count
        return [self.figures[figure](frame) for frame in range(begin, begin + count)]

    def _observation(self, points: np.ndarray, frame: int) -> Any:
        """The keypoints of a frame. After the last frame, the motion starts again."""
        at = points[frame % len(points)]
        return Observation((frame + 1) / self._fps, at, np.ones(len(at)), self._focal)

    def _step(self, trackers: list[Any], points: np.ndarray, frame: int) -> float:
        if frame % points.shape[1] == 0:
            for tracker in trackers:
                tracker.reset()
        seen = [self._observation(person, frame) for person in points]
        batch = getattr(Tracker, "track_batch", None) or getattr(Tracker, "track_together", None)
        begin = time.thread_time()
        if len(trackers) == 1 or batch is None:
            for tracker, observation in zip(trackers, seen):
                tracker.track(observation)
        else:  # earlier revisions track people together
            batch(trackers, seen)
        return time.thread_time() - begin

    def _start(self, points: np.ndarray, frame: int) -> float:
        seen = self._observation(points, 37 * frame)
        self._first.reset()
        begin = time.thread_time()
        self._first.track(seen)
        return time.thread_time() - begin

    def _replay(self) -> float:
        """Seconds per frame of the command `replay`, which writes a recording with sqlite3."""
        main = first_of("lassokin_ros.cli.replay:main", "lassokin_ros.replay.command:main", "lassokin_ros.replay:main")
        with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()) as summary:
            begin = time.process_time()
            failed = main([self._recording, "--output", f"{folder}/out", "--storage", "sqlite3", "-p", "height:=1.75"])
            seconds = time.process_time() - begin
        assert not failed, "replay has failed; its error message is printed above"
        return seconds / int(re.search(r"^frames +(\d+) in", summary.getvalue(), re.MULTILINE)[1])

    def _callback(self, audience: str, frame: int) -> float:
        """Seconds of the node's callback without the tracker's step."""
        if audience not in self._nodes:
            self._nodes[audience] = node_with(audience == "all", float(self._focal))
        node, steps = self._nodes[audience]
        message = cloud(self._pixels[frame % len(self._pixels)], round((frame + 1) * 1e9 / self._fps))
        steps.clear()
        begin = time.thread_time()
        node.work_on(message)
        return time.thread_time() - begin - sum(steps)


def node_with(listened_to: bool, focal: float) -> tuple[Any, list[float]]:
    """A node with a subscription on each output or on none, and the list of the times of its tracker's steps."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import CameraInfo

    make = first_of("lassokin_ros.node.node:TrackerNode", "lassokin_ros.node:TrackerNode")
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = make(context=context, namespace=f"/against_{os.getpid()}_{int(listened_to)}", use_global_arguments=False)
    if listened_to:
        listener = node.listener = rclpy.create_node("listener", context=context)
        has_outputs = hasattr(node, "_outputs")  # earlier revisions have those of one person in the node
        outputs = list((node._outputs.person.outs if has_outputs else node._person._out).values())
        for publisher in outputs:
            listener.create_subscription(publisher.msg_type, publisher.topic_name, lambda message: None, 1)
        end = time.monotonic() + 10.0
        while not all(publisher.get_subscription_count() for publisher in outputs) and time.monotonic() < end:
            time.sleep(0.01)
        assert all(publisher.get_subscription_count() for publisher in outputs), "the listener was not discovered"
    info = CameraInfo(width=1280, height=720)
    info.header.frame_id = FRAME_ID
    info.k = [focal, 0.0, 640.0, 0.0, focal, 360.0, 0.0, 0.0, 1.0]
    info.p = [focal, 0.0, 640.0, 0.0, 0.0, focal, 360.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    inputs = getattr(node, "_inputs", None)  # earlier revisions have the subscription in the node
    (node._camera_info if inputs is None else inputs.camera_info).take(info)
    session = node._session if hasattr(node, "_session") else node._pipeline  # its name in earlier revisions
    return node, timed_steps(session.tracker)


def timed_steps(tracker: Any) -> list[float]:
    """A list to which the time of each of the tracker's steps will be added, s of the processor."""
    times: list[float] = []

    def timed(step: Callable[[Any], Any], observation: Any) -> Any:
        begin = time.thread_time()
        estimate = step(observation)
        times.append(time.thread_time() - begin)
        return estimate

    original = getattr(tracker, "steps", None)
    if original is None:
        track = tracker.track
        tracker.track = lambda observation: timed(track, observation)
        return times
    run_single = first_of("lassokin_ros.core.batch:run_single", "lassokin_ros.core.together:alone")

    def steps(observation: Any) -> Any:  # earlier revisions: a generator of the parts of a step
        return timed(lambda seen: run_single(original(seen)), observation)
        yield

    tracker.steps = steps
    return times


def cloud(pixels: np.ndarray, stamp_ns: int) -> Any:
    """The keypoints (17, 2) px as the node's message."""
    from sensor_msgs.msg import PointCloud2, PointField

    points = np.zeros(len(pixels), [("x", "<f4"), ("y", "<f4"), ("confidence", "<f4"), ("id", "<i4")])
    points["x"], points["y"], points["confidence"], points["id"] = *pixels.T, 0.9, np.arange(len(pixels))
    kinds = {"x": 7, "y": 7, "confidence": 7, "id": 5}
    fields = [PointField(name=n, offset=4 * i, datatype=k, count=1) for i, (n, k) in enumerate(kinds.items())]
    message = PointCloud2(height=1, width=len(pixels), fields=fields, point_step=16, row_step=16 * len(pixels))
    message.data, message.is_dense, message.header.frame_id = points.tobytes(), True, FRAME_ID
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return message


def main() -> None:
    """Arguments: file of arrays, skeleton file, layout file, recording."""
    side = Side(np.load(sys.argv[1]), *sys.argv[2:5])
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # other output must not disturb the answers
    print(json.dumps(sorted(side.figures)), file=answers, flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        print(json.dumps(side.run(request["figure"], request["count"])), file=answers, flush=True)


if __name__ == "__main__":
    main()
