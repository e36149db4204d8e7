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
LAYOUTS = {COCO: "coco17", 26: "halpe26", 133: "coco133"}
"""Landmark layout by the number of keypoints."""
LEAST_SCORE, LARGEST_OVERLAP = 0.25, 0.7
"""Score from which a box is a person, and ratio of intersection and union from which two boxes are the same person: the
defaults of Ultralytics."""
Outputs = Sequence[np.ndarray]
Size = tuple[int, int]


@dataclass(frozen=True)
class ModelKind:
    """A kind of model.

    border: grey value beside an image of another aspect ratio. several: it finds everybody in the image; otherwise one
    person who should fill the image, so the model gets the surroundings of the last detection. prepare: (h, w, 3) uint8
    RGB to (h, w, 3). decode: outputs and input size (width, height) px to people (p, k, 3), the surest first: x, y in
    px of the input and score; one person if not `several`.
    """

    name: str
    border: int
    several: bool
    prepare: Callable[[np.ndarray], np.ndarray]
    decode: Callable[[Outputs, Size], np.ndarray]


def recognise(channels_first: bool, outputs: Sequence[Sequence[int]]) -> tuple[ModelKind, int] | None:
    """Return kind and number of keypoints of a model from the shapes of its outputs, or None."""
    shapes = [tuple(shape) for shape in outputs]
    if any(len(shape) < 2 or shape[0] != 1 for shape in shapes):
        return None
    counts, ranks = [shape[1] for shape in shapes], [len(shape) for shape in shapes]
    if not channels_first:
        return (MOVENET, COCO) if shapes == [(1, 1, COCO, 3)] else None
    if ranks == [3, 3]:
        return (RTMPOSE, counts[0]) if counts[0] == counts[1] and counts[0] in LAYOUTS else None
    if ranks == [3, 4]:
        return (RTMO, COCO) if shapes[0][2] == 5 and shapes[1][2:] == (COCO, 3) else None
    if ranks == [4]:
        return (VITPOSE, counts[0]) if counts[0] in LAYOUTS else None
    if ranks == [3] and counts[0] == 5 + 3 * COCO:
        return YOLO, COCO
    return (YOLO_END_TO_END, COCO) if ranks == [3] and shapes[0][2] == 6 + 3 * COCO else None


def _normalised(image: np.ndarray) -> np.ndarray:
    return np.asarray((image - MEAN) / DEVIATION)


def _unit_range(image: np.ndarray) -> np.ndarray:
    return image / 255.0


def _bgr(image: np.ndarray) -> np.ndarray:
    return image[..., ::-1]


def _same(image: np.ndarray) -> np.ndarray:
    return image


def _movenet(outputs: Outputs, size: Size) -> np.ndarray:
    """Rows y, x (0 to 1) and score."""
    y, x, score = outputs[0].reshape(COCO, 3).T
    return np.stack([x * size[0], y * size[1], score], axis=1)[None]


def _rtmpose(outputs: Outputs, size: Size) -> np.ndarray:
    """SimCC: one distribution per axis and keypoint, in bins of half a pixel."""
    axes = [output[0] for output in outputs[:2]]
    places = [axis.argmax(axis=1) * extent / axis.shape[1] for axis, extent in zip(axes, size)]
    score = np.minimum(axes[0].max(axis=1), axes[1].max(axis=1))
    return np.stack([*places, score], axis=1)[None]


def _vitpose(outputs: Outputs, size: Size) -> np.ndarray:
    """Heat maps (k, h, w). The place is the largest value, moved by a quarter towards the larger neighbour."""
    maps = outputs[0][0]
    count, height, width = maps.shape
    row, column = np.divmod(maps.reshape(count, -1).argmax(axis=1), width)
    padded, k = np.pad(maps, ((0, 0), (1, 1), (1, 1)), mode="edge"), np.arange(count)
    x = column + 0.25 * np.sign(padded[k, row + 1, column + 2] - padded[k, row + 1, column])
    y = row + 0.25 * np.sign(padded[k, row + 2, column + 1] - padded[k, row, column + 1])
    scale = (np.array(size) - 1) / (np.array([width, height]) - 1)  # the corners of map and image coincide
    return np.stack([x * scale[0], y * scale[1], maps[k, row, column]], axis=1)[None]


def _rtmo(outputs: Outputs, _size: Size) -> np.ndarray:
    """Boxes (n, 5), corners and score, and keypoints (n, 17, 3)."""
    boxes, points = outputs[0][0], outputs[1][0]
    return _distinct(boxes[:, :4], boxes[:, 4], points)


def _yolo(outputs: Outputs, _size: Size) -> np.ndarray:
    """Columns: centre and size of the box, score, keypoints (x, y, score)."""
    rows = outputs[0][0].T.astype(float)
    half = rows[:, 2:4] / 2
    return _distinct(np.hstack([rows[:, :2] - half, rows[:, :2] + half]), rows[:, 4], rows[:, 5:])


def _yolo_end_to_end(outputs: Outputs, _size: Size) -> np.ndarray:
    """Rows: corners of the box, score, class, keypoints (x, y, score); YOLO26 and later, exports with nms=True."""
    rows = outputs[0][0]
    return _distinct(rows[:, :4], rows[:, 4], rows[:, 6:])


def _distinct(boxes: np.ndarray, scores: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the keypoints (p, 17, 3) of the sure boxes; of boxes that overlap, those of the surest.

    boxes: (n, 4) x, y of two corners. scores: (n,). points: (n, 17, 3) or (n, 51).
    """
    rest = np.flatnonzero(scores >= LEAST_SCORE)
    rest = rest[np.argsort(-scores[rest], kind="stable")]
    kept = []
    while len(rest):
        kept.append(rest[0])
        rest = rest[1:][_overlap(boxes[rest[0]], boxes[rest[1:]]) < LARGEST_OVERLAP]
    return points[kept].reshape(-1, COCO, 3)


def _overlap(box: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Return the ratio of intersection and union of a box (4,) and boxes (n, 4)."""
    sides = np.minimum(box[2:], boxes[:, 2:]) - np.maximum(box[:2], boxes[:, :2])
    common = np.clip(sides, 0.0, None).prod(axis=1)
    areas = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) + (box[2:] - box[:2]).prod()
    return np.asarray(common / np.maximum(areas - common, 1e-9))


MOVENET = ModelKind("MoveNet", 0, False, _same, _movenet)
RTMPOSE = ModelKind("RTMPose", 0, False, _normalised, _rtmpose)
VITPOSE = ModelKind("ViTPose", 0, False, _normalised, _vitpose)
RTMO = ModelKind("RTMO", 114, True, _bgr, _rtmo)
YOLO = ModelKind("YOLO-pose", 114, True, _unit_range, _yolo)
YOLO_END_TO_END = ModelKind("YOLO-pose, end to end", 114, True, _unit_range, _yolo_end_to_end)
EXPECTED = (
    f"MoveNet (1, 1, {COCO}, 3), RTMPose (1, {' or '.join(map(str, LAYOUTS))}, bins) twice, ViTPose (1, {COCO}, h, w), "
    f"RTMO (1, n, 5) and (1, n, {COCO}, 3), YOLO-pose (1, {5 + 3 * COCO}, n) or (1, n, {6 + 3 * COCO})"
)
