"""Quality of service of inputs and outputs, and its overrides by parameters."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions


def sensor_data(depth: int) -> QoSProfile:
    """Return a sensor-data profile with this depth, which matches reliable and best-effort publishers.

    Every call makes a new profile, because rclpy writes the overrides into its argument.
    """
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def overrides(node: Node, topic: str, endpoint: str) -> QoSOverridingOptions | None:
    """Return the options that declare qos_overrides parameters, None if none is given for this topic at the start.

    endpoint: "publisher" or "subscription". Other parameters are not declared, because they would fill `ros2 param
    list`.
    """
    prefix = f"qos_overrides.{node.resolve_topic_name(topic)}.{endpoint}."
    given = getattr(node, "_parameter_overrides", {})
    return QoSOverridingOptions.with_default_policies() if any(name.startswith(prefix) for name in given) else None


def matches_every_publisher(qos: QoSProfile) -> bool:
    """True if a QoS, which a user may have overridden, still matches reliable and best-effort publishers."""
    return qos.reliability == ReliabilityPolicy.BEST_EFFORT
