"""Classes of ROS messages by the name of their type."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from lassokin_ros.core.errors import ConfigurationError
from msg_adapters.detectors.registry import full_type_name

SOURCES = {
    "yolo_msgs": "build it from github.com/mgonzs13/yolo_ros",
    "people_msgs": "build it from github.com/wg-perception/people",
}
"""How to install packages of messages that apt does not have."""


def message_class(message_type: str) -> Any:
    """Import the class of a message type. Raises ConfigurationError if its package is not installed."""
    package, _, name = full_type_name(message_type).split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        source = SOURCES.get(package) or f"apt install ros-$ROS_DISTRO-{package.replace('_', '-')}"
        raise ConfigurationError(
            f"message type {message_type} needs the ROS package {package}, which is not installed: {source}, or source "
            "the workspace that has it"
        ) from None
