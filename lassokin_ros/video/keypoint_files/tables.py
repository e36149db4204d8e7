"""CSV tables with a row for each image: of DeepLabCut, and of programs that write MediaPipe's landmarks."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from lassokin_ros.video.keypoint_files.keypoints import KeypointFile, body_of, by_names, detected, in_order
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


def read_table(file: Path) -> KeypointFile:
    """Read a table. Raises SourceError."""
    try:
        with file.open(encoding="utf-8-sig", newline="") as text:
            rows = [row for row in csv.reader(text) if row]
    except (OSError, ValueError, csv.Error) as error:
        raise SourceError(f"'{file}' is no table ({' '.join(str(error).split())[:160]}); {FORM}") from None
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
