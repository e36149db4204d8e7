"""All inputs besides the keypoints: camera_info, depth images, TF and the simulated time.

They are polled when they are needed, see `polled_subscription`. Missing ones are logged.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.clock import ROSClock
from rclpy.node import Node

from lassokin_ros.node.inputs.camera_info_input import CameraInfoInput
from lassokin_ros.node.inputs.camera_publishers import CameraPublishers
from lassokin_ros.node.inputs.depth_input import DepthInput
from lassokin_ros.node.inputs.latched_camera_info import LatchedCameraInfo
from lassokin_ros.node.inputs.missing_input import MissingInput
from lassokin_ros.node.inputs.polled_subscription import SimulatedTime
from lassokin_ros.node.inputs.transform_input import TransformInput
from lassokin_ros.node.log_throttle import LogThrottle
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.status.diagnostics import Diagnostics
from lassokin_ros.pipeline.people.per_body_pipeline import PerBodyPipeline
from lassokin_ros.pipeline.pipeline import Pipeline
from msg_adapters.keypoints import stamp_of


class SceneInputs:
    """The subscriptions, and what is done with their messages."""

    def __init__(
        self,
        node: Node,
        pipeline: Pipeline | PerBodyPipeline,
        diagnostics: Diagnostics,
        on_error: Callable[[str, Exception], None],
    ) -> None:
        """on_error: called with a name of the message and the exception.

        Raises ConfigurationError if the package of a required message type is not installed.
        """
        self._node, self._pipeline, self._diagnostics, self._on_error = node, pipeline, diagnostics, on_error
        self._camera_warning = LogThrottle(node.get_logger().warning, time.monotonic)
        self.simulated_time = SimulatedTime(node)
        self.camera_info = CameraInfoInput(
            node,
            known=lambda: pipeline.has_camera,
            on_any=lambda: diagnostics.count_camera_info(time.monotonic()),
            on_new=self._on_camera_info,
            on_error=partial(on_error, "a camera_info message"),
        )
        self._latched_camera_info = LatchedCameraInfo(node, self.camera_info.take)
        self._camera_publishers = CameraPublishers(node)
        self._depth = None
        if pipeline.depth is not None:
            self._depth = DepthInput(node, pipeline.config, pipeline.depth, pipeline.counts, time.monotonic())
        self._transforms = None if pipeline.mount is None else TransformInput(node, pipeline.mount)
        self._missing_clock = MissingInput(node, topics.CLOCK, topics.CLOCK_TYPE, (), time.monotonic())
        self._missing_camera = MissingInput(node, topics.CAMERA_INFO, topics.CAMERA_INFO_TYPE, (), time.monotonic())

    def poll(self) -> None:
        """Process the messages received so far."""
        polled = [("a time", self.simulated_time.poll), ("a camera_info message", self.camera_info.poll)]
        if self._transforms is not None:
            polled.append(("a TF message", self._transforms.poll))
        for what, poll in polled:
            try:
                poll()
            except Exception as error:  # the other inputs must still be polled
                self._on_error(what, error)

    def with_depth(self, message: Any, work: Callable[[], None]) -> None:
        """Process a keypoint message by `work`, as soon as its depth image is received or not expected."""
        if self._depth is None:
            work()
        else:
            self._depth.hold(stamp_of(message), work)

    def check(self, now: float) -> str:
        """Log missing inputs; now: s, steady clock. Call it periodically. Return faults of clock and TF, in words."""
        clock, faults = self._node.get_clock(), []
        if isinstance(clock, ROSClock) and clock.ros_time_is_active:
            has_time = clock.now().nanoseconds > 0
            self._missing_clock.check(now, has_time)
            if not has_time:
                faults.append("use_sim_time is set, but no time was received on /clock")
        else:
            self._missing_clock.restart(now)
        self._latched_camera_info.check(now, self._diagnostics.camera_received)
        faults.append(self._camera_publishers.check(now, self._pipeline.camera.is_shared))
        self._missing_camera.check(now, self._diagnostics.camera_received)
        if self._depth is not None:
            self._depth.check(now)
        if self._transforms is not None:
            faults.append(self._transforms.check(now))
        return "; ".join(filter(None, faults))

    def _on_camera_info(self, message: Any) -> bool:
        reason = self._pipeline.set_camera(message)
        if reason is not None:
            self._camera_warning.log(reason, f"camera_info refused: {self._pipeline.camera_fault}")
        return reason is None and not self._pipeline.camera.is_shared
