"""The node `camera`: publishes a webcam or a video file as `image_raw` and `camera_info`.

It is for machines without a camera driver of ROS. A driver gives better stamps and the camera's controls.
"""

from __future__ import annotations

import os
import threading
import time
from typing import Any

import cv2
import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.yaml_files import user_path
from lassokin_ros.pipeline.settings import OPTICAL_FRAME
from lassokin_ros.video.camera import DEFAULT_FOV, assumed_fov_warning, from_file, from_fov
from lassokin_ros.video.sources import Source, SourceError, open_source
from msg_adapters.backends import RclpyBackend
from msg_adapters.inputs import camera_info, rgb_image

RETRY_S = 2.0
"""s: between two attempts to open a disconnected camera."""
LOG_PERIOD_S = 10.0
"""s: between two messages that the camera found does not fit."""
LEAST_SIDE = 64
"""px"""
POLL_S = 0.05
"""s: between two looks for a subscriber."""
CAMERA_INFO_WAIT_S = 5.0
"""s: how long a file that has a subscriber of image_raw waits for one of camera_info. Nobody may need camera_info."""
LAST_READ_S = 1.0
"""s: how long the end of the node waits for the last image."""
PARAMETERS: dict[str, tuple[Any, str]] = {
    "source": ("0", "number or device of a webcam, a video file, a folder of images, or an address (rtsp://, http://)"),
    "fov": (0.0, "field of view along the longer side of the image, degrees; 0: a default is assumed, with a warning"),
    "calibration": ("", "calibration file of ROS (ost.yaml), OpenCV or Kalibr, scaled to the image; empty: none"),
    "longest_side": (1280, "longer side of the published images, px; larger images are scaled down, smaller ones kept"),
    "frame_id": (OPTICAL_FRAME, "optical frame of the camera, in the headers"),
}
"""Default value and description of each parameter."""


class CameraNode(Node):
    """Publishes the images of a source. A thread reads them: a webcam's at once, a file's at their own times.

    A webcam that is disconnected is reported once, and opened again when it is connected. A file starts when somebody
    subscribes to `image_raw` and `camera_info`, and ends with a line in the log. camera_info is transient local: a
    tracker that is connected later receives the last one.
    """

    def __init__(self, node_name: str = "camera", **options: Any) -> None:
        """options: of rclpy's Node. Raises SourceError or CameraError."""
        super().__init__(node_name, **options)
        given = {name: self._declare(name) for name in PARAMETERS}
        # The shell does not expand the ~ of `source:=~/walk.mp4`. As a path, an address would lose a slash.
        self._source_name, self._frame_id = os.path.expanduser(str(given["source"])), given["frame_id"]
        self._fov = given["fov"] or None
        self._calibration = user_path(given["calibration"]) if given["calibration"] else None
        self._longest_side = given["longest_side"]
        if self._longest_side < LEAST_SIDE:
            raise SourceError(f"longest_side is {self._longest_side} px; expected {LEAST_SIDE} px or more")
        self._backend = RclpyBackend()
        source = self._open()
        if self._fov is None and self._calibration is None:
            self.get_logger().warning(assumed_fov_warning("the parameter fov or calibration"))
        qos = QoSProfile(depth=2)
        self._images = self.create_publisher(Image, "image_raw", qos)
        latched = QoSProfile(depth=qos.depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._infos = self.create_publisher(CameraInfo, "camera_info", latched)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(source,), daemon=True)
        self._thread.start()
        size = f"{self._size[0]} x {self._size[1]} px"
        start = "" if source.live else "; it starts when somebody subscribes to image_raw"
        self.get_logger().info(f"publishes the images of {source.name}, {size} at {source.fps:.3g} Hz{start}")

    def _declare(self, name: str) -> Any:
        value, description = PARAMETERS[name]
        # `-p source:=0` is an integer for ROS.
        descriptor = ParameterDescriptor(description=description, read_only=True, dynamic_typing=name == "source")
        return self.declare_parameter(name, value, descriptor).value

    def _open(self) -> Source:
        """Open the source and the calibration for its size."""
        source = open_source(self._source_name)
        scale = min(self._longest_side / max(source.size), 1.0)
        self._size = round(source.size[0] * scale), round(source.size[1] * scale)
        content = round(source.content[0] * scale), round(source.content[1] * scale)
        if self._calibration is not None and self._fov is not None:
            raise CameraError("calibration has the lens; expected no fov beside it")
        if self._calibration is None:
            self._camera = from_fov(self._fov or DEFAULT_FOV, self._size, content)
        else:  # without a size it is for the source's images
            calibration = from_file(self._calibration, source.size)
            self._camera = calibration.scaled_to(self._size, str(self._calibration))
        return source

    def _run(self, source: Source) -> None:
        """Publish the images of the source until the node ends; the body of the thread."""
        try:
            if not source.live:
                self._await_subscribers()
            while not self._ended.is_set():
                try:
                    self._publish_all(source)
                    if not self._ended.is_set():  # else the node ends, not the source
                        self.get_logger().info(f"{source.name} has ended")
                    return
                except SourceError as error:
                    if self._ended.is_set() or not source.live:
                        self.get_logger().error(str(error))
                        return
                    self.get_logger().error(f"{error}; waiting for it")
                source = self._await_camera(source)
        except Exception as error:
            if self.context.ok() and not self._ended.is_set():
                self.get_logger().error(f"the camera stops: {type(error).__name__}: {error}")

    def _await_subscribers(self) -> None:
        """Wait for a subscriber of image_raw, then for some seconds for one of camera_info."""
        while not self._images.get_subscription_count():
            if self._ended.wait(POLL_S):
                return
        deadline = time.monotonic() + CAMERA_INFO_WAIT_S
        while not self._infos.get_subscription_count() and time.monotonic() < deadline:
            if self._ended.wait(POLL_S):
                return

    def _await_camera(self, source: Source) -> Source:
        """Try to open the camera again until it is back or the node ends."""
        while not self._ended.wait(RETRY_S):
            try:
                source = self._open()
            except SourceError:
                continue
            except CameraError as error:  # another camera has the number now
                self.get_logger().error(f"{error}; waiting for the camera", throttle_duration_sec=LOG_PERIOD_S)
                continue
            self.get_logger().info(f"{source.name} is back")
            return source
        return source

    def _publish_all(self, source: Source) -> None:
        """Publish until the source ends. Images of a file that are late by more than one period are left out."""
        began_ns, latest_s = self.get_clock().now().nanoseconds, 1 / source.fps
        for image in source.images:
            now_ns = self.get_clock().now().nanoseconds
            stamp_ns = now_ns if source.live else began_ns + round(image.seconds * 1e9)
            wait_s = (stamp_ns - now_ns) * 1e-9
            if self._ended.wait(max(wait_s, 0.0)):
                return
            if wait_s > -latest_s:
                self._publish(stamp_ns, image.rgb)

    def _publish(self, stamp_ns: int, rgb: np.ndarray) -> None:
        if rgb.shape[1::-1] != self._size:
            rgb = cv2.resize(rgb, self._size, interpolation=cv2.INTER_AREA)
        camera, backend, frame = self._camera, self._backend, self._frame_id
        self._infos.publish(camera_info(backend, stamp_ns, frame, camera.K, camera.D, self._size, camera.model))
        self._images.publish(rgb_image(backend, stamp_ns, frame, rgb))

    def destroy_node(self) -> None:
        """Stop the thread, too. One that waits for a camera ends with the process."""
        self._ended.set()
        self._thread.join(LAST_READ_S)
        super().destroy_node()
