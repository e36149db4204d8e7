"""The node `detector`: images in, 2D keypoints out."""

from __future__ import annotations

import time
from collections import Counter
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import Image, PointCloud2

from lassokin_ros.detector.backend import keypoint_message, make_detector
from lassokin_ros.node.log_throttle import LogThrottle
from lassokin_ros.node.qos import sensor_data
from msg_adapters.backends import RclpyBackend
from msg_adapters.errors import AdapterError
from msg_adapters.image import decode_image

DIAGNOSTICS_EVERY_S = 1.0


class DetectorNode(Node):
    """Subscribes to `image_raw` and publishes `keypoints` with the image's stamp and frame.

    The subscription holds the newest image only: images that arrive during a detection are dropped.
    """

    def __init__(self, node_name: str = "detector", **options: Any) -> None:
        """options: of rclpy's Node. Raises DetectorError."""
        super().__init__(node_name, **options)
        description = ParameterDescriptor(description="mediapipe, or the path of a .task or .onnx file", read_only=True)
        self._detector = make_detector(self.declare_parameter("detector", "mediapipe", description).value)
        self._backend = RclpyBackend()
        self._counts: Counter[str] = Counter()
        self._since = time.monotonic()
        self._busy_s = 0.0
        self._reported = 0
        self._refused = ""  # why the last image since the last report was dropped
        self._warning = LogThrottle(self.get_logger().warning, time.monotonic)
        self._keypoints = self.create_publisher(PointCloud2, "keypoints", QoSProfile(depth=5))
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=5))
        self.create_subscription(
            Image,
            "image_raw",
            self._on_image,
            sensor_data(1),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self.create_timer(DIAGNOSTICS_EVERY_S, self._publish_diagnostics, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.get_logger().info(f"publishes keypoints of the layout '{self._detector.landmarks}'")

    def _on_image(self, message: Image) -> None:
        """Detect and publish. A bad image is counted and logged; this method never raises for one."""
        started = time.monotonic()
        stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        try:
            found = self._detector.detect(decode_image(message), stamp_ns * 1e-9)
            frame_id = message.header.frame_id
            cloud = keypoint_message(self._backend, stamp_ns, frame_id, found, self._detector.several)
            self._keypoints.publish(cloud)
        except AdapterError as error:
            self._reject(error.reason, str(error))
        except Exception as error:
            if self.context.ok():
                self._reject("internal_error", f"an image was dropped: {type(error).__name__}: {error}")
        else:
            self._counts["detected" if found else "nobody"] += 1
            self._busy_s += time.monotonic() - started

    def _reject(self, reason: str, text: str) -> None:
        self._counts[f"rejected: {reason}"] += 1
        self._refused = text
        self._warning.log(reason, text)

    def _publish_diagnostics(self) -> None:
        now = time.monotonic()
        done = self._counts["detected"] + self._counts["nobody"]
        seconds, self._since = now - self._since, now
        new, self._reported = done - self._reported, done
        busy, self._busy_s = self._busy_s, 0.0
        values = {"rate [Hz]": f"{new / seconds:.1f}", "time per image [ms]": f"{1e3 * busy / new:.1f}" if new else "-"}
        values.update({name: str(count) for name, count in sorted(self._counts.items())})
        level = DiagnosticStatus.OK if new else DiagnosticStatus.WARN
        name = self.get_fully_qualified_name().lstrip("/")
        nothing = self._refused or "no image in the last second; is image_raw published?"
        text, self._refused = "detecting" if new else nothing, ""
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        status = DiagnosticStatus(level=level, name=f"{name}: keypoints", message=text, hardware_id="", values=pairs)
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def destroy_node(self) -> None:
        """Release the model, too."""
        super().destroy_node()
        self._detector.close()
