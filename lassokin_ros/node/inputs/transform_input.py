"""TF for the poses of cameras: /tf and /tf_static, polled, with a log message if frames do not connect."""

from __future__ import annotations

from functools import partial

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from lassokin_ros.node.inputs.polled_subscription import poll
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import sensor_data
from lassokin_ros.pipeline.camera.camera_places import CameraPlaces
from lassokin_ros.pipeline.outputs import topics

DEPTH = 100
"""Queue depth of /tf and /tf_static, as in tf2_ros."""
FIRST_WARNING_S = 3.0
"""s from the first image without a transform until this is reported, because robots need time to start. If TF has given
them before, it is reported at once: the robot moves, and the last ones no longer hold."""


class TransformInput:
    """The node's subscriptions to TF. Call `poll` before the transforms are used, and periodically."""

    def __init__(self, node: Node, places: CameraPlaces) -> None:
        """Raises ConfigurationError if tf2_msgs is not installed."""
        self._node, self._places = node, places
        kind = message_class(topics.TF.message_type)
        latched = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._subscriptions = [
            node.create_subscription(kind, name, partial(places.transforms.add, static=static), qos)
            for name, static, qos in ((topics.TF, False, sensor_data(DEPTH)), (topics.TF_STATIC, True, latched))
        ]
        self._failing_since: float | None = None
        self._fault_logged = self._success_logged = False

    def poll(self) -> None:
        """Process the transforms received so far."""
        for subscription in self._subscriptions:
            poll(subscription, DEPTH)

    def check(self, now: float) -> str:
        """Log once what TF gives, or once why it gives nothing. Return the fault in words, or "".

        now: s, steady clock. Call it periodically.
        """
        fault = self._places.fault
        if not fault:
            self._failing_since = None
            if self._places.known and not self._success_logged:
                self._success_logged = True
                self._node.get_logger().info(f"the cameras' poses {self._places.in_words()}")
            return ""
        if self._failing_since is None:
            self._failing_since = now
        if not self._success_logged and now - self._failing_since < FIRST_WARNING_S:
            return ""
        if not self._fault_logged:
            self._fault_logged = True
            self._node.get_logger().warning(f"{fault}; until it is received, images of the camera are rejected")
        return fault
