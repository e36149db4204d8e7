"""TF for the camera's mount: /tf and /tf_static, polled, with a log message if the frames are not connected."""

from __future__ import annotations

from functools import partial

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from lassokin_ros.node.inputs.polled_subscription import poll
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import sensor_data
from lassokin_ros.pipeline.camera.camera_mount import CameraMount
from lassokin_ros.pipeline.outputs import topics

DEPTH = 100
"""Queue depth of /tf and /tf_static, as in tf2_ros."""
FIRST_WARNING_S = 3.0
"""s from the first image without a mount until this is logged, because robots need time to start."""


class TransformInput:
    """The node's subscriptions to TF. Call `poll` before the mount is used, and periodically."""

    def __init__(self, node: Node, mount: CameraMount) -> None:
        """Raises ConfigurationError if tf2_msgs is not installed."""
        self._node, self._mount = node, mount
        kind = message_class(topics.TF_OUTPUT.message_type)
        latched = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._subscriptions = [
            node.create_subscription(kind, name, partial(mount.transforms.add, static=static), qos)
            for name, static, qos in ((topics.TF, False, sensor_data(DEPTH)), (topics.TF_STATIC, True, latched))
        ]
        self._failing_since: float | None = None
        self._fault_logged = self._angles_logged = False

    def poll(self) -> None:
        """Process the transforms received so far."""
        for subscription in self._subscriptions:
            poll(subscription, DEPTH)

    def check(self, now: float) -> str:
        """Log once the mount from TF, or once why there is none. Return the fault in words, or "".

        now: s, steady clock. Call it periodically.
        """
        fault = self._mount.fault
        if not fault:
            self._failing_since = None
            self._log_angles()
            return ""
        if self._failing_since is None:
            self._failing_since = now
        if now - self._failing_since < FIRST_WARNING_S:
            return ""
        if not self._fault_logged:
            self._fault_logged = True
            self._node.get_logger().warning(f"{fault}; until it is received, {self._in_use()}")
        return fault

    def _log_angles(self) -> None:
        if self._mount.angles is not None and not self._angles_logged:
            self._angles_logged = True
            self._node.get_logger().info(f"the camera's mount {self._mount.in_words()}")

    def _in_use(self) -> str:
        if self._mount.angles is not None:
            return "the last mount from TF is used"
        return "camera_roll and camera_pitch are used"
