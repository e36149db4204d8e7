"""The node's callback on real messages, and its stages: decode, undistort, track, angles, encode, publish.

With rclpy the callback of the real node is called, with real publishers on real DDS: without subscribers, with a
subscription on every output of a recording, and with subscriptions on the live visualisation too. Without rclpy the
messages are those of rosbags and are serialised instead of published.
"""

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any, Callable, Iterator, Sequence

import numpy as np

from benchmarks.common.report import Record
from benchmarks.data.motion import FOCAL, FPS, HEIGHT
from benchmarks.timing.stages import Clock, percentiles
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.backends import Backend, RclpyBackend, RosbagsBackend
from msg_adapters.detectors.registry import keypoint_adapter
from msg_adapters.inputs import camera_info, point_cloud

SIZE = (1280, 720)
CENTRE = np.array([640.0, 360.0])
K = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1.0]])
DISTORTION = np.array([-0.11, 0.06, 0.0008, -0.0006, 0.0])
FRAME_ID = "camera_optical_frame"
DISCOVERY_S = 10.0
OUTPUTS = (*topics.FRAME_OUTPUTS, *topics.LIVE_OUTPUTS)
AUDIENCES = {
    "nobody listens": (),
    "all outputs of a recording subscribed": topics.FRAME_OUTPUTS,
    "all outputs subscribed, those for the eye too": OUTPUTS,
}
"""Name of an audience -> outputs with a subscriber."""


def measure_callback(observations: Sequence[Observation], distorted: bool = False) -> tuple[str, list[Record]]:
    """(transport of the messages, one record per stage and for the whole callback)."""
    if find_spec("rclpy") is None:
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_JAZZY)
        return "rosbags (no rclpy here: serialised, not published)", _stages(
            observations, distorted, RosbagsBackend(store), lambda topic, m: store.serialize_cdr(m, m.__msgtype__), {}
        )
    with _nodes() as nodes:
        callbacks = {
            who: (node._inputs.camera_info.take, node.work_on, _clock(node)) for who, node in zip(AUDIENCES, nodes)
        }
        publish = {topic.name: nodes[-1]._outputs.person.outs[topic.name].publish for topic in OUTPUTS}
        records = _stages(observations, distorted, RclpyBackend(), lambda topic, m: publish[topic](m), callbacks)
    return "rclpy, real publishers", records


@contextmanager
def _nodes() -> Iterator[list[Any]]:
    """A tracker node for each of AUDIENCES, with a subscription on each output in it."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(30 + os.getpid() % 60))
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from lassokin_ros.node.node import TrackerNode

    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    height = rclpy.parameter.Parameter("height", value=HEIGHT)
    options = {"context": context, "parameter_overrides": [height], "use_global_arguments": False}
    nodes = [TrackerNode(namespace=f"/latency_{number}", **options) for number in range(len(AUDIENCES))]
    listener = rclpy.create_node("listener", context=context)
    wanted = [node._outputs.person.outs[t.name] for node, outputs in zip(nodes, AUDIENCES.values()) for t in outputs]
    for publisher in wanted:
        listener.create_subscription(publisher.msg_type, publisher.topic_name, lambda message: None, 1)
    try:
        deadline = time.monotonic() + DISCOVERY_S
        while not all(publisher.get_subscription_count() for publisher in wanted):
            if time.monotonic() > deadline:
                raise SystemExit(f"the outputs' subscriptions were not discovered within {DISCOVERY_S:g} s")
            time.sleep(0.01)
        yield nodes
    finally:
        for node in (listener, *nodes):
            node.destroy_node()
        rclpy.try_shutdown(context=context)


def _clock(node: Any) -> Clock:
    """On the step of a node's tracker."""
    clock, tracker = Clock(), node._session.tracker
    tracker.track = clock.around(tracker.track)
    return clock


def _stages(
    observations: Sequence[Observation],
    distorted: bool,
    backend: Backend,
    publish: Callable[[str, Any], Any],
    callbacks: dict[str, tuple[Callable[[Any], None], Callable[[Any], None], Clock]],
) -> list[Record]:
    """Measure every stage, and the whole callback, on each frame in turn."""
    info = camera_info(backend, 0, FRAME_ID, K, DISTORTION if distorted else np.zeros(0), SIZE)
    session = Session(TrackerConfig(height=HEIGHT), NodeSettings())
    session.set_camera(info)
    for on_camera_info, *_ in callbacks.values():
        on_camera_info(info)
    ready = bool(callbacks)  # as in the node
    messages = FrameMessages(backend, session.tracker.skeleton, serialised=ready)
    adapter = keypoint_adapter("sensor_msgs/PointCloud2")
    lens = session.first.camera.view.lens
    assert lens is not None
    samples: dict[str, list[float]] = {}

    def timed(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        start = time.perf_counter()
        result = function(*arguments)
        samples.setdefault(name, []).append(time.perf_counter() - start)
        return result

    for number, observation in enumerate(observations):
        pixels = lens.distort(observation.points) if distorted else observation.points * FOCAL + CENTRE
        message = point_cloud(backend, round((number + 1) * 1e9 / FPS), FRAME_ID, pixels, observation.confidence)
        count = len(pixels)
        decoded, _ = timed("decode", lambda: adapter.decode(message, SIZE).as_landmarks(count, None))
        timed("undistort", lens.normalise, decoded)
        frame = timed("decode, undistort, track, angles", session.process, message, 0)
        for topic in OUTPUTS if frame.accepted else ():
            name = topic.name.removeprefix("~/")
            built = timed(f"encode {name}", lambda: list(messages.build(frame, [topic.name])))
            timed(f"publish {name}", publish, topic.name, built[0][1])
        for who, (_, on_keypoints, step) in callbacks.items():
            timed(f"whole callback, {who}", on_keypoints, message)
            beyond = samples[f"whole callback, {who}"][-1] - step.take()[0]
            samples.setdefault(f"beyond the tracker's step, {who}", []).append(beyond)
    return [
        {"part": "callback", "what": name, "calls": 1.0, **percentiles(values[1:])} for name, values in samples.items()
    ]
