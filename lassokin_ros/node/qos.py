"""The quality of service with which inputs are subscribed to."""

from __future__ import annotations

from rclpy.qos import QoSProfile, ReliabilityPolicy


def sensor_data(depth: int) -> QoSProfile:
    """The sensor-data profile, which reliable and best-effort publishers both match, with another depth.

    A new one each time: rclpy writes a user's overrides into what it is given.
    """
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def matches_every_publisher(qos: QoSProfile) -> bool:
    """Whether that is still so of what a user may have overridden."""
    return qos.reliability == ReliabilityPolicy.BEST_EFFORT
