"""Arrays of numpy: an export of this package (.npz), or `kp2d` with `keypoint_names`."""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile
from zlib import error as DamagedArchive

import numpy as np

from lassokin_ros.detector.backend import Detected
from lassokin_ros.video.keypoint_files.keypoints import (
    MOST_NUMBERS,
    KeypointFile,
    by_names,
    detected,
    in_order,
    on_frames,
)
from lassokin_ros.video.sources import SourceError

FORM = (
    "expected an export of this package, or kp2d (frames, points, 2 or 3) in px with keypoint_names, and, if they are "
    "known, stamp_s or fps, and image_size"
)


def read_arrays(file: Path) -> KeypointFile:
    """Read an archive. Raises SourceError."""
    try:
        with np.load(file, allow_pickle=False) as archive:
            data = {name: archive[name] for name in WANTED if name in archive}
    except (OSError, EOFError, BadZipFile, DamagedArchive, ValueError, TypeError, AttributeError):
        raise SourceError(f"'{file}' is no .npz file; {FORM}") from None
    points, names = data.get("kp2d", data.get("detected_px")), data.get("keypoint_names", data.get("landmark_names"))
    if points is None or names is None or points.dtype.kind not in "fiu" or points.size > MOST_NUMBERS:
        raise SourceError(f"'{file}' has no keypoints with names; {FORM}")
    if points.ndim != 3 or points.shape[2] not in (2, 3) or points.shape[1] != names.size or not len(points):
        raise SourceError(f"'{file}' has keypoints of shape {points.shape} and {names.size} names; {FORM}")
    if points.shape[2] == 2:
        points = np.concatenate([points, np.ones_like(points[..., :1])], axis=-1)
    layout, order = by_names([str(name) for name in names.ravel()], str(file))
    rows = [detected(row) for row in in_order(order, points.astype(float))]
    size = data.get("image_size")
    known = (int(size[0]), int(size[1])) if size is not None and size.shape == (2,) else None
    stamps = data.get("stamp_s", data["stamp_ns"] * 1e-9 if "stamp_ns" in data else None)
    if stamps is None and "fps" in data and float(data["fps"]) > 0:
        stamps = np.arange(len(rows)) / float(data["fps"])
    if stamps is None:
        return KeypointFile(layout, [[row] for row in rows], size=known)
    times, numbers = np.unique(stamps, return_inverse=True)  # an export has a row for each person
    found: dict[int, list[Detected]] = {}
    for number, row in zip(numbers.ravel().tolist(), rows):
        found.setdefault(number, []).append(row)
    return KeypointFile(layout, on_frames(found), times - times[0], known)


WANTED = (
    *("kp2d", "keypoint_names", "stamp_s", "fps", "image_size"),
    *("detected_px", "landmark_names", "stamp_ns"),
)
"""Arrays that are read; the second row is that of an export."""
