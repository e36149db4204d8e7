"""The kinds of pose models: how an image becomes a model's input, and its outputs become keypoints.

A kind is recognised by the shapes of a model's input and outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

MEAN, DEVIATION = np.array([123.675, 116.28, 103.53]), np.array([58.395, 57.12, 57.375])
"""Normalisation of RTMPose, RGB."""
COCO = 17
LAYOUTS = {COCO: "coco17", 26: "halpe26"}
"""Landmark layout by the number of keypoints."""
LEAST_YOLO_SCORE = 0.25
Outputs = Sequence[np.ndarray]
Size = tuple[int, int]


@dataclass(frozen=True)
class ModelKind:
    """A kind of model.

    border: grey value beside an image of another aspect ratio. follows: the person should fill the image; the model
    gets the surroundings of the last detection. prepare: (h, w, 3) uint8 RGB to (h, w, 3). decode: outputs and input
    size (width, height) px to (k, 3), x, y in px of the input and score; None without a person.
    """

    name: str
    border: int
    follows: bool
    prepare: Callable[[np.ndarray], np.ndarray]
    decode: Callable[[Outputs, Size], np.ndarray | None]


def recognise(channels_first: bool, outputs: Sequence[Sequence[int]]) -> tuple[ModelKind, int] | None:
    """Return kind and number of keypoints of a model from the shapes of its outputs, or None."""
    shapes = [tuple(shape) for shape in outputs]
    if not channels_first:
        return (MOVENET, COCO) if shapes == [(1, 1, COCO, 3)] else None
    if len(shapes) == 2 and all(len(shape) == 3 and shape[0] == 1 for shape in shapes):
        count = shapes[0][1]
        return (RTMPOSE, count) if count == shapes[1][1] and count in LAYOUTS else None
    if len(shapes) == 1 and len(shapes[0]) == 3 and shapes[0][0] == 1:
        if shapes[0][1] == 5 + 3 * COCO:
            return YOLO, COCO
        if shapes[0][2] == 6 + 3 * COCO:
            return YOLO_END_TO_END, COCO
    return None


def _normalised(image: np.ndarray) -> np.ndarray:
    return np.asarray((image - MEAN) / DEVIATION)


def _unit_range(image: np.ndarray) -> np.ndarray:
    return image / 255.0


def _same(image: np.ndarray) -> np.ndarray:
    return image


def _movenet(outputs: Outputs, size: Size) -> np.ndarray:
    """Rows y, x (0 to 1) and score."""
    y, x, score = outputs[0].reshape(COCO, 3).T
    return np.stack([x * size[0], y * size[1], score], axis=1)


def _rtmpose(outputs: Outputs, size: Size) -> np.ndarray:
    """SimCC: one distribution per axis and keypoint, in bins of half a pixel."""
    axes = [output[0] for output in outputs[:2]]
    places = [axis.argmax(axis=1) * extent / axis.shape[1] for axis, extent in zip(axes, size)]
    score = np.minimum(axes[0].max(axis=1), axes[1].max(axis=1))
    return np.stack([*places, score], axis=1)


def _yolo(outputs: Outputs, _size: Size) -> np.ndarray | None:
    """Columns: box (4), score, keypoints (x, y, score). The column with the highest score is the person."""
    return _best(outputs[0][0].T, 5)


def _yolo_end_to_end(outputs: Outputs, _size: Size) -> np.ndarray | None:
    """Rows: box (4), score, class, keypoints (x, y, score); from YOLO26 on, and from exports with nms=True."""
    return _best(outputs[0][0], 6)


def _best(people: np.ndarray, first: int) -> np.ndarray | None:
    """Return the keypoints, from column `first` on, of the row with the highest score (column 4), if it suffices."""
    if not len(people):
        return None
    person = people[people[:, 4].argmax()]
    return None if person[4] < LEAST_YOLO_SCORE else np.asarray(person[first:]).reshape(COCO, 3)


MOVENET = ModelKind("MoveNet", 0, True, _same, _movenet)
RTMPOSE = ModelKind("RTMPose", 0, True, _normalised, _rtmpose)
YOLO = ModelKind("YOLO-pose", 114, False, _unit_range, _yolo)
YOLO_END_TO_END = ModelKind("YOLO-pose, end to end", 114, False, _unit_range, _yolo_end_to_end)
EXPECTED = (
    f"MoveNet (1, 1, {COCO}, 3), RTMPose (1, {' or '.join(map(str, LAYOUTS))}, bins) twice, YOLO-pose "
    f"(1, {5 + 3 * COCO}, n) or (1, n, {6 + 3 * COCO})"
)
