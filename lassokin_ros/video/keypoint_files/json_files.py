"""JSON of OpenPose (a folder, one file per image), of AlphaPose, and of COCO (results or annotations)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.common.command_line import one_line
from lassokin_ros.detector.backend import Detected
from lassokin_ros.video.keypoint_files.keypoints import (
    MOST_NUMBERS,
    KeypointFile,
    body_of,
    detected,
    number_in,
    on_frames,
)
from lassokin_ros.video.sources import SourceError, natural_key

FORM = "expected the JSON of OpenPose, AlphaPose or COCO"
HANDS = ("hand_left_keypoints_2d", "hand_right_keypoints_2d")
"""Lists of OpenPose with 21 points each; empty without --hand."""
WITH_HANDS = {"body25": "openpose67"}
"""Layout of a body with both hands by that of the body."""


def openpose_files(folder: Path) -> list[Path]:
    """Return the JSON files of a folder in the order of their numbers; those of OpenPose if there are others, too."""
    files = [file for file in folder.iterdir() if file.suffix.lower() == ".json" and not file.name.startswith(".")]
    own = [file for file in files if file.stem.endswith("_keypoints")]
    return sorted(own or files, key=lambda file: natural_key(file.name))


def read_openpose(folder: Path, hands: bool = True) -> KeypointFile:
    """Read a folder of OpenPose: `walk_000000000012_keypoints.json` with `people`, `pose_keypoints_2d`, `HANDS`.

    The layout has hands if somebody's hand has points, unless hands is False. Raises SourceError.
    """
    files = openpose_files(folder)
    layouts: dict[str, None] = {}
    numbers = [number_in(file.stem) for file in files]
    counted = None not in numbers and len(set(numbers)) == len(numbers)
    found: dict[int, list[np.ndarray]] = {}
    for order, (number, file) in enumerate(zip(numbers, files)):
        data = _load(file)
        people = data.get("people") if isinstance(data, dict) else None
        if not isinstance(people, list):
            raise SourceError(f"'{file}' has no list people; {FORM}")
        rows = [_points(person, ("pose_keypoints_2d", "pose_keypoints"), str(file)) for person in people]
        layouts |= dict.fromkeys(layout for layout, _ in rows)
        whole = [np.concatenate([points, _hands(person)]) for person, (_, points) in zip(people, rows)]
        found[number if counted and number is not None else order] = whole
    layout = _one(layouts, str(folder))
    if hands and any(points[-42:, :2].any() for frame in found.values() for points in frame):
        layout = WITH_HANDS.get(layout, layout)
    kept = slice(None if layout in WITH_HANDS.values() else -42)
    return KeypointFile(layout, on_frames({at: [detected(one[kept]) for one in frame] for at, frame in found.items()}))


def read_results(file: Path) -> KeypointFile:
    """Read the results of AlphaPose or COCO, or COCO's annotations, which have the images' size. Raises SourceError."""
    data = _load(file)
    rows, size, names = data, None, {}
    if isinstance(data, dict):
        rows, images = data.get("annotations"), data.get("images")
        if not isinstance(images, list) or not all(isinstance(image, dict) for image in images):
            raise SourceError(f"'{file}' has no lists images and annotations; {FORM}")
        sizes = {(image.get("width"), image.get("height")) for image in images}
        size = next(iter(sizes)) if len(sizes) == 1 else None
        names = {str(image.get("id")): image.get("file_name") for image in images}
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) and "image_id" in row for row in rows):
        raise SourceError(f"'{file}' holds no people with image_id and keypoints; {FORM}")
    layouts: dict[str, None] = {}
    found: dict[int, list[Detected]] = {}
    for row in rows:
        layout, points = _points(row, ("keypoints",), str(file))
        number = number_in(str(names.get(str(row["image_id"])) or row["image_id"]))
        if number is None:
            raise SourceError(f"'{file}' has image_id {row['image_id']!r}; expected the number of an image in it")
        layouts[layout] = None
        found.setdefault(number, []).append(detected(points))
    known = size if size is not None and all(isinstance(side, int) and side > 0 for side in size) else None
    return KeypointFile(_one(layouts, str(file)), on_frames(found), size=known)


def _load(file: Path) -> Any:
    try:
        return json.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise SourceError(f"'{file}' is no JSON ({one_line(error)}); {FORM}") from None


def _points(person: Any, names: Sequence[str], source: str) -> tuple[str, np.ndarray]:
    """Return layout and points (l, 3) of a flat list of x, y and confidence. Raises SourceError."""
    row = person if isinstance(person, Mapping) else {}
    values = _numbers(next((row[name] for name in names if name in row), None))
    if not 0 < len(values) < MOST_NUMBERS or len(values) % 3:
        raise SourceError(f"'{source}' has a person without a list {names[0]} of x, y and confidence; {FORM}")
    layout, count = body_of(len(values) // 3, source)
    return layout, values.reshape(-1, 3)[:count]


def _hands(person: Mapping[str, Any]) -> np.ndarray:
    """Return the points (42, 3) of both hands of a person of OpenPose, 0 = missing."""
    lists = [_numbers(person.get(name)) for name in HANDS]
    return np.concatenate([hand if len(hand) == 63 else np.zeros(63) for hand in lists]).reshape(-1, 3)


def _numbers(values: Any) -> np.ndarray:
    """Return a list as an array (n,); n = 0 if it is none of numbers."""
    try:
        return np.array(values, dtype=float).ravel()
    except (TypeError, ValueError):
        return np.zeros(0)


def _one(layouts: Iterable[str], source: str) -> str:
    found = list(layouts)
    if len(found) != 1:
        raise SourceError(
            f"'{source}' has {'nobody' if not found else ' and '.join(found)}; expected people of one layout"
        )
    return found[0]
