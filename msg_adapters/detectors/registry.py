"""Supported keypoint messages, one line each. The module of an adapter is imported on demand."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any, Protocol

from msg_adapters.keypoints import Keypoints

ADAPTERS = {
    "sensor_msgs/msg/PointCloud2": "msg_adapters.detectors.point_cloud2",
    "geometry_msgs/msg/PolygonStamped": "msg_adapters.detectors.polygon_stamped",
    "std_msgs/msg/Float32MultiArray": "msg_adapters.detectors.multi_array",
    "std_msgs/msg/Float64MultiArray": "msg_adapters.detectors.multi_array",
    "hri_msgs/msg/Skeleton2D": "msg_adapters.detectors.hri_skeleton2d",
    "yolo_msgs/msg/DetectionArray": "msg_adapters.detectors.yolo_detections",
    "zed_msgs/msg/ObjectsStamped": "msg_adapters.detectors.zed_objects",
}
"""Message type -> module of the adapter."""


class KeypointAdapter(Protocol):
    """Decodes the keypoint messages of one type: a module with this function."""

    def decode(self, message: Any, image_size: tuple[int, int] | None) -> Keypoints:
        """Return the keypoints of a message. Raises AdapterError if the message is inconsistent.

        image_size: (width, height) px from camera_info, None before the first one. It is needed for normalised
        coordinates.
        """
        ...


def full_type_name(message_type: str) -> str:
    """Return the long form of a message type: "sensor_msgs/PointCloud2" -> "sensor_msgs/msg/PointCloud2"."""
    parts = message_type.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else message_type


@cache
def keypoint_adapter(message_type: str) -> KeypointAdapter:
    """Return an adapter for a message type in long or short form. Raises KeyError if there is none."""
    adapter: Any = import_module(ADAPTERS[full_type_name(message_type)])
    return adapter  # type: ignore[no-any-return]
