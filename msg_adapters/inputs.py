"""Convert arrays to the input messages of the tracker, for recordings, examples and tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import CloudBuilder, set_header

POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("confidence", "<f4"), ("id", "<i4")])
POINT_OF_PERSON = np.dtype([*POINT.descr, ("person", "<i4")])


def point_cloud(backend: Backend, stamp_ns: int, frame_id: str, pixels: np.ndarray, confidence: np.ndarray) -> Any:
    """Return keypoints of one image as sensor_msgs/PointCloud2. Points with confidence 0 are omitted.

    pixels: (l, 2) px; confidence: (l,) 0 to 1; the id of a point is its row.
    """
    return CloudBuilder(backend, POINT).fill(stamp_ns, frame_id, _points(POINT, pixels, confidence))


def people_cloud(
    backend: Backend, stamp_ns: int, frame_id: str, people: Sequence[tuple[int, np.ndarray, np.ndarray]]
) -> Any:
    """Return everybody's keypoints of one image, as `point_cloud`, with the field `person`.

    people: number, pixels and confidence of each person. Numbers below 0 are valid in this message only.
    """
    parts = [np.empty(0, POINT_OF_PERSON)]
    for number, pixels, confidence in people:
        parts.append(_points(POINT_OF_PERSON, pixels, confidence))
        parts[-1]["person"] = number
    return CloudBuilder(backend, POINT_OF_PERSON).fill(stamp_ns, frame_id, np.concatenate(parts))


def _points(kind: np.dtype, pixels: np.ndarray, confidence: np.ndarray) -> np.ndarray:
    ids = np.flatnonzero(confidence > 0)
    points = np.empty(len(ids), kind)
    points["x"], points["y"] = pixels[ids].T
    points["confidence"], points["id"] = confidence[ids], ids
    return points


def camera_info(
    backend: Backend,
    stamp_ns: int,
    frame_id: str,
    K: np.ndarray,
    D: np.ndarray,
    size: tuple[int, int],
    model: str = "plumb_bob",
) -> Any:
    """Return sensor_msgs/CameraInfo of a single camera: K (3, 3) px, D in the order of the model, size (w, h) px."""
    message = backend.make("sensor_msgs/msg/CameraInfo")
    set_header(message.header, stamp_ns, frame_id)
    message.width, message.height = size
    message.distortion_model = model
    message.d = backend.float64(np.asarray(D, dtype=float))
    message.k = np.asarray(K, dtype=float).reshape(9)
    message.r = np.eye(3).reshape(9)
    message.p = np.hstack([K, np.zeros((3, 1))]).reshape(12)
    return message


def rgb_image(backend: Backend, stamp_ns: int, frame_id: str, rgb: np.ndarray) -> Any:
    """Return sensor_msgs/Image of the encoding rgb8. rgb: (height, width, 3) uint8."""
    message = backend.make("sensor_msgs/msg/Image")
    set_header(message.header, stamp_ns, frame_id)
    message.height, message.width = rgb.shape[:2]
    message.encoding, message.is_bigendian, message.step = "rgb8", 0, 3 * rgb.shape[1]
    message.data = backend.uint8(rgb.tobytes())
    return message
