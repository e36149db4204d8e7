"""The inputs of one camera besides its keypoints: camera_info and depth images. Missing ones are logged."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node

from lassokin_ros.node.inputs.camera_info_input import CameraInfoInput
from lassokin_ros.node.inputs.camera_publishers import CameraPublishers
from lassokin_ros.node.inputs.depth_input import DepthInput
from lassokin_ros.node.inputs.latched_camera_info import LatchedCameraInfo
from lassokin_ros.node.inputs.missing_input import MissingInput
from lassokin_ros.node.log_throttle import LogThrottle
from lassokin_ros.pipeline.camera_images import CameraImages
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.session import Session


class CameraInputs:
    """The subscriptions of one camera, and what is done with their messages."""

    def __init__(
        self,
        node: Node,
        session: Session,
        images: CameraImages,
        diagnostics: Diagnostics,
        on_depth: Callable[[str, Any], None],
        on_error: Callable[[str, Exception], None],
    ) -> None:
        """images: of this camera. on_depth: called with its name and a depth image. on_error: called with a name of the
        message and the exception.

        Raises ConfigurationError if the package of a required message type is not installed.
        """
        self._session, self._images, self._diagnostics, self._on_error = session, images, diagnostics, on_error
        self._warning = LogThrottle(node.get_logger().warning, time.monotonic)
        topic, now = topics.of_camera(topics.CAMERA_INFO, images.name), time.monotonic()
        self._received = False
        self.camera_info = CameraInfoInput(
            node,
            topic,
            known=lambda: images.camera.view is not None,
            on_any=self._on_any_camera_info,
            on_new=self._on_camera_info,
            on_error=partial(on_error, "a camera_info message"),
        )
        self._latched_camera_info = LatchedCameraInfo(node, topic, self.camera_info.take)
        self._publishers = CameraPublishers(node, topic)
        self._missing_camera = MissingInput(node, topic, topics.CAMERA_INFO_TYPE, (), now)
        self._depth = None
        if images.depth is not None:
            depth = session.config.depth_topic(images.name)
            self._depth = DepthInput(node, depth, images.depth, partial(on_depth, images.name), now)

    def poll(self) -> None:
        """Process the messages received so far."""
        try:
            self.camera_info.poll()
        except Exception as error:  # the other inputs must still be polled
            self._on_error("a camera_info message", error)

    def check(self, now: float) -> str:
        """Log missing inputs; now: s, steady clock. Call it periodically. Return faults, in words."""
        self._latched_camera_info.check(now, self._received)
        fault = self._publishers.check(now, self._images.camera.is_shared)
        self._images.camera.publishers = self._publishers.count
        self._missing_camera.check(now, self._received)
        if self._depth is not None:
            self._depth.check(now)
        return fault

    def _on_any_camera_info(self) -> None:
        self._received = True
        self._diagnostics.count_camera_info(time.monotonic())

    def _on_camera_info(self, message: Any) -> bool:
        reason = self._session.set_camera(message, self._images.name)
        if reason is not None:
            self._warning.log(reason, f"camera_info refused: {self._images.camera.fault}")
        return reason is None and not self._images.camera.is_shared
