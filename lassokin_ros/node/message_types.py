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
BUILT = ("tf2_msgs", "people_msgs", "hri_msgs", "vision_msgs", "yolo_msgs", "zed_msgs")
"""Packages that the command BUILD builds into a virtual environment, for machines without a ROS from apt."""
BUILD = "pip install '.[messages]' && python test/support/installation/message_packages.py"
"""In a checkout, with names of packages; `make messages` builds all of them into the .venv there."""


def message_class(message_type: str) -> Any:
    """Import the class of a message type. Raises ConfigurationError if its package is not installed."""
    package, _, name = full_type_name(message_type).split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        source = SOURCES.get(package) or f"apt install ros-$ROS_DISTRO-{package.replace('_', '-')}"
        build = f"; without ROS from apt, in a checkout of lassokin_ros: {BUILD} {package}" if package in BUILT else ""
        raise ConfigurationError(
            f"message type {message_type} needs the ROS package {package}, which is not installed: {source}, or source "
            f"the workspace that has it{build}"
        ) from None
