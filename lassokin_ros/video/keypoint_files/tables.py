"""Tables with a row for each image: CSV of DeepLabCut and with MediaPipe's landmarks, and arrays of numpy.

An .npz is an export of this package, or holds `kp2d` with `keypoint_names`.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path
from zipfile import BadZipFile
from zlib import error as DamagedArchive

import numpy as np

from lassokin_ros.common.command_line import one_line
from lassokin_ros.detector.backend import Detected
from lassokin_ros.video.keypoint_files.keypoints import (
    MOST_NUMBERS,
    KeypointFile,
    body_of,
    by_names,
    detected,
    in_order,
    on_frames,
)
from lassokin_ros.video.sources import SourceError

FORM = (
    "expected a table of DeepLabCut, or one with the columns left_shoulder_x, left_shoulder_y, "
    "left_shoulder_visibility or x1, y1, v1 and so on"
)
CONFIDENCE = ("likelihood", "visibility", "v", "confidence", "conf", "score", "c", "presence")
"""Names of the third value, the first in a table counts."""
TIMES = {
    "seconds": 1.0,
    "time": 1.0,
    "times": 1.0,
    "stamps": 1.0,
    "timestamp": 1.0,
    "timems": 1e-3,
    "timestampms": 1e-3,
}
"""Columns with the time of an image, without blanks and brackets, and their unit in s."""
LARGEST_SHARE = 3.0
"""Points are shares of the image's sides if nine tenths of them are below this."""
ARRAYS = (
    "expected an export of this package, or kp2d (frames, points, 2 or 3) in px with keypoint_names, and, if they are "
    "known, stamp_s or fps, and image_size"
)
NAMES = "kp2d keypoint_names stamp_s fps image_size detected_px landmark_names stamp_ns".split()
"""Arrays that are read; the last three are those of an export."""


def read_table(file: Path) -> KeypointFile:
    """Read a table. Raises SourceError."""
    try:
        with file.open(encoding="utf-8-sig", newline="") as text:
            rows = [row for row in csv.reader(text) if row]
    except (OSError, ValueError, csv.Error) as error:
        raise SourceError(f"'{file}' is no table ({one_line(error)}); {FORM}") from None
    header, body = _header(rows)
    if len({len(row) for row in body} | {len(header)}) != 1 or not body:
        raise SourceError(f"'{file}' has no rows, or rows of different lengths; {FORM}")
    columns = _columns(header)
    if not columns:
        raise SourceError(f"'{file}' has the columns {', '.join(map(':'.join, header[:8]))}; {FORM}")
    numbers = np.array([[_number(cell) for cell in row] for row in body])
    points = np.ones((len(body), len(columns), 3))
    for place, (x, y, confidence) in enumerate(columns.values()):
        points[:, place, :2] = numbers[:, [x, y]]
        if confidence is not None:
            points[:, place, 2] = numbers[:, confidence]
    if all(name.isdecimal() for name in columns):  # x1, y1, ... or x0, y0, ...
        layout, count = body_of(len(columns), str(file))
        points = points[:, np.argsort([int(name) for name in columns])][:, :count]
    else:
        layout, order = by_names(list(columns), str(file))
        points = in_order(order, points)
    seen = points[points[..., 2] > 0][:, :2]
    relative = bool(len(seen) and np.nanquantile(np.abs(seen), 0.9) < LARGEST_SHARE)
    return KeypointFile(layout, [[detected(row)] for row in points], _times(header, numbers), relative=relative)


def _header(rows: list[list[str]]) -> tuple[list[tuple[str, ...]], list[list[str]]]:
    """Return the names of each column, one or (of DeepLabCut) two, and the rows below."""
    titles = [row[0].strip().lower() for row in rows[:5]]
    if "bodyparts" in titles and "coords" in titles:
        parts, coords = titles.index("bodyparts"), titles.index("coords")
        return list(zip(rows[parts], rows[coords])), rows[coords + 1 :]
    return [(name.strip(),) for name in rows[0]] if rows else [], rows[1:]


def _columns(header: list[tuple[str, ...]]) -> dict[str, tuple[int, int, int | None]]:
    """Return the columns x, y and confidence (None without) by the name of the point."""
    found: dict[str, dict[str, int]] = {}
    for number, names in enumerate(header):
        if len(names) == 2:
            point, value = names
        elif match := re.fullmatch(r"([xyzv])_?(\d+)", names[0], re.IGNORECASE):  # x1, v_1
            value, point = match.groups()
        elif match := re.fullmatch(r"(.+?)[\s_.:-]*(x|y|" + "|".join(CONFIDENCE) + ")", names[0], re.IGNORECASE):
            point, value = match.groups()
        else:
            continue
        found.setdefault(point.strip(), {}).setdefault(value.strip().lower(), number)
    return {
        point: (values["x"], values["y"], next((values[name] for name in CONFIDENCE if name in values), None))
        for point, values in found.items()
        if {"x", "y"} <= values.keys()
    }


def _times(header: list[tuple[str, ...]], numbers: np.ndarray) -> np.ndarray | None:
    """Return the times (f,) s in a column that is one of times and rises, else None."""
    for number, names in enumerate(header):
        unit = TIMES.get(re.sub(r"[\s_()\[\]]", "", names[0].lower()))
        if unit is not None and np.all(np.diff(numbers[:, number]) > 0):
            return np.asarray((numbers[:, number] - numbers[0, number]) * unit)
    return None


def _number(cell: str) -> float:
    """Return a cell as a number, NaN if it is none."""
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def read_arrays(file: Path) -> KeypointFile:
    """Read an archive. Raises SourceError."""
    try:
        with np.load(file, allow_pickle=False) as archive:
            data = {name: archive[name] for name in NAMES if name in archive}
    except (OSError, EOFError, BadZipFile, DamagedArchive, ValueError, TypeError, AttributeError):
        raise SourceError(f"'{file}' is no .npz file; {ARRAYS}") from None
    points, names = data.get("kp2d", data.get("detected_px")), data.get("keypoint_names", data.get("landmark_names"))
    if points is None or names is None or points.dtype.kind not in "fiu" or points.size > MOST_NUMBERS:
        raise SourceError(f"'{file}' has no keypoints with names; {ARRAYS}")
    if points.ndim != 3 or points.shape[2] not in (2, 3) or points.shape[1] != names.size or not len(points):
        raise SourceError(f"'{file}' has keypoints of shape {points.shape} and {names.size} names; {ARRAYS}")
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
