"""Pose models in ONNX files, run by onnxruntime, see pose_models.py."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.detector.backend import Detected, DetectorError
from lassokin_ros.detector.pose_models import EXPECTED, LAYOUTS, recognise

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
        found = recognise(self._channels_first, shapes := self._output_shapes())
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
            raise DetectorError(f"the model '{self._path}' cannot be run: {_short(error)}") from None
        return outputs

    def _output_shapes(self) -> list[tuple[int, ...]]:
        """Run the model once: exported models often leave their shapes open."""
        return [output.shape for output in self._run(np.zeros((*self._size[::-1], 3)))]


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
        raise DetectorError(f"'{path}' is no ONNX model: {_short(error)}") from None


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:160]
