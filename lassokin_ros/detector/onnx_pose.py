"""Pose models in ONNX files, run by onnxruntime: MoveNet, RTMPose (SimCC) and YOLO-pose, with COCO's 17 keypoints.

The kind of the model is recognised by the shapes of its inputs and outputs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.detector.backend import Detected, DetectorError, nobody

LANDMARKS = 17
MEAN, DEVIATION = np.array([123.675, 116.28, 103.53]), np.array([58.395, 57.12, 57.375])
"""Normalisation of RTMPose, RGB."""
MOVENET_SIZE, YOLO_SIZE = 192, 640
"""px: side of the input where the model leaves it open."""
LEAST_YOLO_SCORE = 0.25


class OnnxPose:
    """A pose model with COCO's 17 keypoints. The whole image is scaled into the model's input, with grey borders."""

    landmarks = "coco17"

    def __init__(self, path: Path) -> None:
        """Raises DetectorError for a file that is missing, no ONNX model, or no known pose model."""
        self._session = _session(path)
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        self._input = inputs[0]
        self._kind = _kind([i.shape for i in inputs], [o.shape for o in outputs])
        if self._kind is None:
            shapes = ", ".join(str(o.shape) for o in outputs)
            raise DetectorError(
                f"'{path}' is no pose model that is known: its outputs are {shapes}; expected MoveNet (1, 1, 17, 3), "
                "RTMPose (n, 17, w) and (n, 17, h), or YOLO-pose (1, 56, n)"
            )
        shape = self._input.shape
        height, width = shape[1:3] if self._kind == "movenet" else shape[2:4]
        side = MOVENET_SIZE if self._kind == "movenet" else YOLO_SIZE
        self._size = (width if isinstance(width, int) else side, height if isinstance(height, int) else side)

    def detect(self, image: np.ndarray, seconds: float) -> Detected:
        """See Detector.detect."""
        boxed, scale, shift = letterbox(image, self._size)
        if self._kind == "movenet":
            kind = np.int32 if "int32" in self._input.type else np.uint8 if "uint8" in self._input.type else np.float32
            tensor = boxed[None].astype(kind)
        elif self._kind == "rtmpose":
            tensor = ((boxed - MEAN) / DEVIATION).transpose(2, 0, 1)[None].astype(np.float32)
        else:
            tensor = (boxed / 255.0).transpose(2, 0, 1)[None].astype(np.float32)
        outputs = self._session.run(None, {self._input.name: tensor})
        decode = {"movenet": _movenet, "rtmpose": _rtmpose, "yolo": _yolo}[self._kind or ""]
        points = decode(outputs, self._size)
        if points is None:
            return nobody(LANDMARKS)
        confidence = np.clip(np.nan_to_num(points[:, 2]), 0.0, 1.0)
        return Detected((points[:, :2] - shift) / scale, confidence)

    def close(self) -> None:
        """See Detector.close."""
        self._session = None


def letterbox(image: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, float, np.ndarray]:
    """Scale an image into (width, height) px without distortion. Returns image, scale and shift (2,) px."""
    import cv2

    height, width = image.shape[:2]
    scale = min(size[0] / width, size[1] / height)
    inner = max(round(width * scale), 1), max(round(height * scale), 1)
    left, top = (size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2
    result = np.full((size[1], size[0], 3), 114, np.uint8)
    result[top : top + inner[1], left : left + inner[0]] = cv2.resize(image, inner)
    return result, scale, np.array([left, top], dtype=float)


def _session(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError:
        raise DetectorError("an ONNX model needs onnxruntime; install it with: pip install onnxruntime") from None
    if not path.is_file():
        raise DetectorError(f"there is no file '{path}'")
    try:
        return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own, of several kinds
        raise DetectorError(f"'{path}' is no ONNX model: {' '.join(str(error).split())[:160]}") from None


def _kind(inputs: list[Any], outputs: list[Any]) -> str | None:
    """Return "movenet", "rtmpose", "yolo" or None."""
    if len(inputs) != 1 or len(inputs[0]) != 4:
        return None
    if inputs[0][3] == 3 and len(outputs) == 1 and list(outputs[0][-2:]) == [LANDMARKS, 3]:
        return "movenet"
    if inputs[0][1] != 3:
        return None
    if len(outputs) == 2 and all(len(shape) == 3 and shape[1] == LANDMARKS for shape in outputs):
        return "rtmpose"
    if len(outputs) == 1 and len(outputs[0]) == 3 and outputs[0][1] == 5 + 3 * LANDMARKS:
        return "yolo"
    return None


def _movenet(outputs: list[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """Rows y, x (0 to 1) and score to rows x, y (px) and score."""
    y, x, score = outputs[0].reshape(LANDMARKS, 3).T
    return np.stack([x * size[0], y * size[1], score], axis=1)


def _rtmpose(outputs: list[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """SimCC: one distribution per axis and keypoint, in bins of half a pixel."""
    axes = [output[0] for output in outputs[:2]]
    places = [axis.argmax(axis=1) * extent / axis.shape[1] for axis, extent in zip(axes, size)]
    score = np.minimum(axes[0].max(axis=1), axes[1].max(axis=1))
    return np.stack([*places, score], axis=1)


def _yolo(outputs: list[np.ndarray], _size: tuple[int, int]) -> np.ndarray | None:
    """Keypoints of the box with the highest score; None if no box has a sufficient score."""
    boxes = outputs[0][0]
    best = int(boxes[4].argmax()) if boxes.shape[1] else 0
    if not boxes.shape[1] or boxes[4, best] < LEAST_YOLO_SCORE:
        return None
    result: np.ndarray = boxes[5:, best].reshape(LANDMARKS, 3)
    return result
