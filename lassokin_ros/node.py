"""The node: a callback converts, tracks and publishes; what it does stands in pipeline.py and the core."""

from __future__ import annotations

import time
from functools import partial
from importlib import import_module
from typing import Any

from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_srvs.srv import Trigger

from lassokin_ros import topics
from lassokin_ros.core.errors import ConfigurationError, LassokinError
from lassokin_ros.diagnostics import Diagnostics
from lassokin_ros.frame_messages import FrameMessages
from lassokin_ros.parameters import LiveParameters, Settings, declare, unknown_parameters
from lassokin_ros.pipeline import Frame, Pipeline
from lassokin_ros.throttle import Throttle
from lassokin_ros.urdf import urdf
from msg_adapters.backends import RclpyBackend
from msg_adapters.outputs import DiagnosticArrayBuilder, StringBuilder
from msg_adapters.registry import full_type_name

DIAGNOSTICS_PERIOD_S = 1.0
CAMERA_INFO_DEPTH, OUTPUT_DEPTH = 1, 10


class TrackerNode(Node):
    """Keypoints and camera_info in; joint states, joints, translation, markers, certificate and diagnostics out."""

    def __init__(self, **options: Any) -> None:
        """options: rclpy's (context, namespace, parameter_overrides, ...). Raises a LassokinError for a bad setting."""
        super().__init__("tracker", **options)
        settings = declare(self)
        self._live_parameters = LiveParameters(self, settings, self._tune)
        self._pipeline = Pipeline(*settings)
        self._camera_warning = Throttle(self.get_logger().warning, time.monotonic)
        self._warning = Throttle(self.get_logger().warning, time.monotonic)
        backend = RclpyBackend()
        name = self.get_fully_qualified_name().lstrip("/")  # /diagnostics is shared by the trackers of all namespaces
        self._messages = FrameMessages(backend, self._pipeline.tracker.skeleton, name)
        self._description, self._status = StringBuilder(backend), DiagnosticArrayBuilder(backend)
        self._diagnostics = Diagnostics(self._pipeline, name, time.monotonic())
        self._out = {t.name: self._publisher(t) for t in (*topics.FRAME_OUTPUTS, *topics.OTHER_OUTPUTS)}
        self._base_frame = ""
        self._describe_body(settings[1].base_frame)
        self._listen(settings[1].keypoints_type, settings[1].queue_depth)
        for line in unknown_parameters(self):
            self.get_logger().warning(line)

    def _publisher(self, topic: topics.OutputTopic) -> Publisher:
        durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=1 if topic.latched else OUTPUT_DEPTH, durability=durability)
        override = QoSOverridingOptions.with_default_policies()
        return self.create_publisher(
            _message_class(topic.message_type), topic.name, qos, qos_overriding_options=override
        )

    def _listen(self, keypoints_type: str, depth: int) -> None:
        """Subscriptions, service, timer and the watch on the clock."""
        subscribe = partial(
            self.create_subscription, qos_overriding_options=QoSOverridingOptions.with_default_policies()
        )
        subscribe(
            _message_class(topics.CAMERA_INFO_TYPE),
            topics.CAMERA_INFO,
            self._on_camera_info,
            _sensor_data(CAMERA_INFO_DEPTH),
        )
        subscribe(_message_class(keypoints_type), topics.KEYPOINTS, self._on_keypoints, _sensor_data(depth))
        self.create_service(Trigger, "~/reset", self._on_reset)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # diagnostics go on while simulated time stands still
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._publish_diagnostics, clock=steady)
        jump = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True)
        self._jump_watch = self.get_clock().create_jump_callback(jump, post_callback=self._on_clock_jump)

    def _on_camera_info(self, message: Any) -> None:
        self._diagnostics.saw_camera(time.monotonic())
        reason = self._pipeline.set_camera(message)
        if reason is not None:
            self._camera_warning.say(reason, f"camera_info refused: {self._pipeline.camera_fault}")

    def _on_keypoints(self, message: Any) -> None:
        started = time.monotonic()
        now_ns = self.get_clock().now().nanoseconds
        try:
            frame = self._pipeline.process(message, now_ns)
            for topic, output in self._messages.build(frame, self._is_wanted):
                self._out[topic].publish(output)
            self._after(frame)
        except Exception as error:  # the promise: no message, however strange, ends the node
            if self.context.ok():
                self._pipeline.counts["rejected: internal_error"] += 1
                self._warning.say("internal_error", f"a keypoint message was dropped: {type(error).__name__}: {error}")
            return
        ended = time.monotonic()
        self._diagnostics.saw_frame(frame, ended, ended - started, (now_ns - frame.stamp_ns) * 1e-9)

    def _is_wanted(self, topic: str) -> bool:
        return self._out[topic].get_subscription_count() > 0

    def _after(self, frame: Frame) -> None:
        """What is said in the log, and the body's description when the camera's frame has another name."""
        if not frame.accepted:
            self._warning.say(str(frame.rejection), f"keypoints rejected ({frame.rejection}): {frame.detail}")
        elif frame.frame_id and frame.frame_id != self._base_frame:
            try:
                self._describe_body(frame.frame_id)
            except LassokinError as error:
                self._warning.say("base_frame", str(error))
        if self._pipeline.counts["unstamped"] == 1:
            self._warning.say("unstamped", "keypoints without a stamp: outputs carry the time of their arrival")

    def _describe_body(self, base_frame: str) -> None:
        self._base_frame = base_frame
        text = urdf(self._pipeline.tracker.skeleton, base_frame)
        self._out[topics.ROBOT_DESCRIPTION].publish(self._description.fill(text))

    def _publish_diagnostics(self) -> None:
        line = self._diagnostics.line(time.monotonic())
        now_ns = self.get_clock().now().nanoseconds
        self._out[topics.DIAGNOSTICS].publish(self._status.fill(now_ns, "", [line]))

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._pipeline.reset()
        response.success, response.message = True, "state forgotten; the next usable frame initialises anew"
        return response

    def _on_clock_jump(self, jump: TimeJump) -> None:
        self.get_logger().info("the clock has jumped: the state is forgotten")
        self._pipeline.reset()

    def _tune(self, settings: Settings) -> None:
        self._pipeline.tune(*settings)


def _message_class(message_type: str) -> Any:
    """The class of a message type, imported now. Raises ConfigurationError when its package is not installed."""
    package, _, name = full_type_name(message_type).split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise ConfigurationError(
            f"message type {message_type} needs the ROS package {package}, which is not installed: apt install "
            f"ros-$ROS_DISTRO-{package.replace('_', '-')}, or source the workspace that has it"
        ) from None


def _sensor_data(depth: int) -> QoSProfile:
    """The sensor-data profile, which reliable and best-effort publishers both match, with another depth."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
