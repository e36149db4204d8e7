"""Pose models in ONNX files, run by onnxruntime.

The kind of a model is recognised by the shapes of its input and outputs. It says how an image becomes the model's
input, and how the outputs become keypoints.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.common.command_line import one_line
from lassokin_ros.detector.backend import Detected, DetectorError

OPEN_SIDE = {True: 640, False: 192}
"""px: side of the input if the model does not fix it; with the channels first (YOLO) and last (MoveNet)."""
TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(int32)": np.int32,
    "tensor(uint8)": np.uint8,
}
TORSO = [5, 6, 11, 12]
"""Shoulders and hips of COCO's keypoints, with which those of Halpe begin, too."""
SURE = 0.3
"""Least score of a point that counts."""
TORSO_REACH, BODY_REACH = 1.9, 1.2
"""Half the side of the region, in multiples of the distance of the torso's and of all points (as MoveNet's demo)."""
LEAST_SIDE = 32
"""px"""
Region = tuple[slice, slice]
"""Rows and columns."""
WHOLE: Region = (slice(None), slice(None))
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


class OnnxPose:
    """A pose model. The image is scaled into the model's input without distortion, with borders."""

    def __init__(self, path: Path) -> None:
        """Raises DetectorError for a file that is missing, no ONNX model, or no known pose model."""
        self._path, self._session = path, _session(path)
        inputs = self._session.get_inputs()
        shape = inputs[0].shape if len(inputs) == 1 else []
        if len(shape) != 4 or 3 not in (shape[1], shape[3]) or inputs[0].type not in TYPES:
            given = ", ".join(f"{item.type} {item.shape}" for item in inputs)
            raise DetectorError(f"'{path}' is no pose model that is known: its inputs are {given}; expected one image")
        self._input, self._type, self._channels_first = inputs[0].name, TYPES[inputs[0].type], shape[1] == 3
        rows, columns = shape[2:4] if self._channels_first else shape[1:3]
        side = OPEN_SIDE[self._channels_first]
        self._size = (columns if isinstance(columns, int) else side, rows if isinstance(rows, int) else side)
        shapes = [
            output.shape for output in self._run(np.zeros((*self._size[::-1], 3)))
        ]  # the file may leave them open
        found = recognise(self._channels_first, shapes)
        if found is None:
            given = ", ".join(map(str, shapes))
            raise DetectorError(
                f"'{path}' is no pose model that is known: its outputs are {given}; expected {EXPECTED}"
            )
        self._kind, count = found
        self.landmarks, self.several = LAYOUTS[count], self._kind.several
        self._region = WHOLE
        self._shape: tuple[int, ...] = ()  # of the image for which the region is

    def detect(self, image: np.ndarray, seconds: float) -> list[Detected]:
        """See Detector.detect."""
        region = self._region if image.shape == self._shape else WHOLE
        self._shape = image.shape
        boxed, scale, shift = letterbox(image[region], self._size, self._kind.border)
        people = self._kind.decode(self._run(self._kind.prepare(boxed)), self._size).astype(float)
        people[..., :2] = (people[..., :2] - shift) / scale + [part.start or 0 for part in region[::-1]]
        people[..., 2] = np.clip(np.nan_to_num(people[..., 2]), 0.0, 1.0)
        if not self._kind.several:
            self._region = region_around(people[0], image.shape)
        return [Detected(person[:, :2], person[:, 2]) for person in people]

    def close(self) -> None:
        """See Detector.close."""
        self._session = None

    def _run(self, prepared: np.ndarray) -> list[np.ndarray]:
        """Run the model on an image (h, w, 3). Raises DetectorError."""
        ordered = prepared.transpose(2, 0, 1) if self._channels_first else prepared
        try:
            outputs: list[np.ndarray] = self._session.run(None, {self._input: ordered[None].astype(self._type)})
        except Exception as error:  # onnxruntime's own, of several kinds
            raise DetectorError(f"the model '{self._path}' cannot be run: {one_line(error)}") from None
        return outputs


def region_around(points: np.ndarray, shape: tuple[int, ...]) -> Region:
    """Return the region of the next image around a person; the whole image unless shoulders and hips are seen.

    points: (k, 3), x, y in px and score. shape: (height, width, ...) of the image.
    """
    sure = points[:, 2] > SURE
    shoulders, hips = sure[TORSO[:2]].any(), sure[TORSO[2:]].any()
    if not (shoulders and hips):
        return WHOLE
    seen, torso = points[sure, :2], points[[i for i in TORSO if sure[i]], :2]
    centre = torso.mean(axis=0)
    reach = np.maximum(TORSO_REACH * np.abs(torso - centre).max(axis=0), BODY_REACH * np.abs(seen - centre).max(axis=0))
    reach = np.maximum(reach, reach.max() / 2)  # arms that are about to be lifted stay inside
    limits = np.array([shape[1], shape[0]])
    first = np.clip(np.floor(centre - reach), 0, limits).astype(int)
    last = np.clip(np.ceil(centre + reach), 0, limits).astype(int)
    if (last - first).min() < LEAST_SIDE:
        return WHOLE
    return slice(first[1], last[1]), slice(first[0], last[0])


def letterbox(image: np.ndarray, size: tuple[int, int], border: int) -> tuple[np.ndarray, float, np.ndarray]:
    """Scale an image into (width, height) px without distortion. Returns image, scale and shift (2,) px."""
    import cv2

    height, width = image.shape[:2]
    scale = min(size[0] / width, size[1] / height)
    inner = max(round(width * scale), 1), max(round(height * scale), 1)
    left, top = (size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2
    result = np.full((size[1], size[0], 3), border, np.uint8)
    result[top : top + inner[1], left : left + inner[0]] = cv2.resize(image, inner)
    return result, scale, np.array([left, top], dtype=float)


def _session(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError:
        raise DetectorError("an ONNX model needs onnxruntime; install it with: pip install onnxruntime") from None
    if not os.path.isfile(path):  # False for a name that is too long
        raise DetectorError(f"there is no file '{path}'")
    try:
        return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own, of several kinds
        raise DetectorError(f"'{path}' is no ONNX model: {one_line(error)}") from None


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


def _yolo(outputs: Outputs, _size: Size) -> np.ndarray:
    """Columns: centre and size of the box, score, keypoints (x, y, score)."""
    rows = outputs[0][0].T.astype(float)
    half = rows[:, 2:4] / 2
    return _distinct(np.hstack([rows[:, :2] - half, rows[:, :2] + half]), rows[:, 4], rows[:, 5:])


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


MOVENET = ModelKind("MoveNet", 0, False, lambda image: image, _movenet)
RTMPOSE = ModelKind("RTMPose", 0, False, _normalised, _rtmpose)
VITPOSE = ModelKind("ViTPose", 0, False, _normalised, _vitpose)
# Boxes (n, 5), corners and score, and keypoints (n, 17, 3).
RTMO = ModelKind(
    "RTMO",
    114,
    True,
    lambda image: image[..., ::-1],
    lambda out, _: _distinct(out[0][0, :, :4], out[0][0, :, 4], out[1][0]),
)
YOLO = ModelKind("YOLO-pose", 114, True, lambda image: image / 255.0, _yolo)
# Rows: corners of the box, score, class, keypoints (x, y, score); YOLO26 and later, exports with nms=True.
YOLO_END_TO_END = replace(
    YOLO,
    name="YOLO-pose, end to end",
    decode=lambda out, _: _distinct(out[0][0, :, :4], out[0][0, :, 4], out[0][0, :, 6:]),
)
EXPECTED = (
    f"MoveNet (1, 1, {COCO}, 3), RTMPose (1, {' or '.join(map(str, LAYOUTS))}, bins) twice, ViTPose (1, {COCO}, h, w), "
    f"RTMO (1, n, 5) and (1, n, {COCO}, 3), YOLO-pose (1, {5 + 3 * COCO}, n) or (1, n, {6 + 3 * COCO})"
)
