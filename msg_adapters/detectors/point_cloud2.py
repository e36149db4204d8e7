"""Keypoints in sensor_msgs/PointCloud2: fields x, y (or u, v), confidence, id and, optionally, person and depth.

depth: m along the optical axis, of the surface that a depth camera sees at the keypoint; NaN or 0 = not measured.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints, check_count, frame_name, header_stamp

MAX_FIELDS = 64
MAX_POINT_STEP = 4096
"""Bytes. A keypoint takes 16 to 32; additional fields take a few more."""
LONGEST_NAME = 32
"""Characters of a field name that are used. Error texts contain the names."""
ALIASES = {"u": "x", "v": "y"}
DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8", 9: "i8", 10: "u8"}
"""Those of sensor_msgs/PointField, and PCL's for 64-bit integers."""
WHOLE = ("id", "person")
"""Fields that hold whole numbers. Their type may be a float, as of an array in which all columns have one type."""
LARGEST_WHOLE = 2.0**53
"""Largest whole number up to which a float64 has all of them."""
NAMES = ("x", "y", "confidence", *WHOLE, "depth")


def decode(message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
    """Read a cloud of keypoints with any byte order, padding and additional fields. See KeypointAdapter.decode."""
    stamp = header_stamp(message.header)
    check_count(message.width * message.height)
    if message.width * message.height == 0 and not message.fields:  # a default message: nobody
        none = np.empty(0, np.int64)
        return Keypoints(stamp, frame_name(message.header), none, np.empty((0, 2)), np.empty(0), none)
    if len(message.fields) > MAX_FIELDS:
        raise AdapterError("wrong_fields", f"the cloud has {len(message.fields)} fields; expected x, y, ...")
    if message.point_step > MAX_POINT_STEP:
        raise AdapterError(
            "wrong_layout", f"point_step is {message.point_step}; expected at most {MAX_POINT_STEP} bytes"
        )
    fields = tuple([(f.name[:LONGEST_NAME], f.offset, f.datatype, f.count) for f in message.fields])
    points = _points(message, _dtype(fields, message.point_step, bool(message.is_bigendian)))
    xy = np.empty((len(points), 2))
    with np.errstate(invalid="ignore"):  # a NaN may be signalling
        xy[:, 0], xy[:, 1] = points["x"], points["y"]
        confidence = points["confidence"].astype(float)
        depth = _depth(points)
    persons = _whole(points, "person") if "person" in (points.dtype.names or ()) else None
    ids = _whole(points, "id")
    return Keypoints(stamp, frame_name(message.header), ids, xy, confidence, persons, depth=depth)


@lru_cache(maxsize=16)
def _dtype(fields: tuple[tuple[str, int, int, int], ...], point_step: int, big_endian: bool) -> np.dtype:
    """Return the numpy dtype of one point. Raises AdapterError if required fields are missing or wrong."""
    order = ">" if big_endian else "<"
    formats: dict[str, tuple[str, int]] = {}
    for name, offset, datatype, count in fields:
        name = ALIASES.get(name, name)
        if name not in NAMES:
            continue
        if name in formats:
            raise AdapterError("wrong_fields", f"the cloud has two fields '{name}'")
        if datatype not in DATATYPES or count > 1:
            raise AdapterError(
                "wrong_datatype",
                f"field '{name}' has datatype {datatype}, count {count}; expected one number: datatype 1 to 8 of "
                "sensor_msgs/PointField (7 is FLOAT32), or 9 or 10 (PCL's 64-bit integers), with count 1",
            )
        if offset + np.dtype(DATATYPES[datatype]).itemsize > point_step:
            raise AdapterError(
                "wrong_layout", f"field '{name}' at offset {offset} does not fit in a point_step of {point_step}"
            )
        formats[name] = order + DATATYPES[datatype], offset
    missing = [name for name in ("x", "y", "confidence", "id") if name not in formats]
    if missing:
        there = ", ".join(name for name, *_ in fields[:16]) or "none"
        raise AdapterError(
            "wrong_fields",
            f"the cloud has no field {', '.join(missing)}; expected x, y (px; or u, v), confidence (0 to 1) and id (of "
            f"the landmark); its fields are: {there}",
        )
    return np.dtype(
        {
            "names": list(formats),
            "formats": [kind for kind, _ in formats.values()],
            "offsets": [offset for _, offset in formats.values()],
            "itemsize": point_step,
        }
    )


def _whole(points: np.ndarray, name: str) -> np.ndarray:
    """Return a field of whole numbers (k,), -1 for NaN. Raises AdapterError for others."""
    values = points[name]
    if values.dtype.kind == "f":
        with np.errstate(invalid="ignore"):  # a NaN may be signalling
            values = np.where(np.isnan(values), -1.0, values)
            wrong = (values != np.rint(values)) | (np.abs(values) > LARGEST_WHOLE)
        if wrong.any():
            raise AdapterError(
                "wrong_datatype", f"field '{name}' holds {values[wrong][0]:g}; expected whole numbers, such as int32"
            )
    whole: np.ndarray = values.astype(np.int64)
    return whole


def _depth(points: np.ndarray) -> np.ndarray | None:
    """Return the field depth (k,), m, NaN = not measured; None if the cloud has none."""
    if "depth" not in (points.dtype.names or ()):
        return None
    depth = points["depth"].astype(float)
    depth[~(depth > 0)] = np.nan
    return depth if np.isfinite(depth).any() else None


def _points(message: Any, dtype: np.dtype) -> np.ndarray:
    """Return the points (k,) of the cloud without a copy. Raises AdapterError if its sizes are inconsistent."""
    width, height, size = message.width, message.height, len(message.data)
    if message.row_step < width * message.point_step or size != message.row_step * height:
        raise AdapterError(
            "wrong_layout",
            f"{size} bytes for height {height}, row_step {message.row_step}, width {width}, point_step "
            f"{message.point_step}; expected height * row_step bytes and row_step of width * point_step or more",
        )
    if width * height == 0:
        return np.empty(0, dtype)
    strides = (message.row_step, message.point_step)
    return np.ndarray((height, width), dtype, memoryview(message.data), 0, strides).reshape(-1)
