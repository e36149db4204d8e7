"""The interface of the detectors, and their selection by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import user_path


class DetectorError(LassokinError):
    """A detector cannot be used: its package, its version or its model file does not fit, or it fails on an image."""


@dataclass(frozen=True, eq=False)
class Detected:
    """Keypoints of one person in one image. pixels: (l, 2) px. confidence: (l,) 0 to 1, 0 = missing."""

    pixels: np.ndarray
    confidence: np.ndarray


class Detector(Protocol):
    """A 2D pose detector."""

    landmarks: str
    """Name of the landmark layout."""
    several: bool
    """Whether it can find more than one person in an image."""

    def detect(self, image: np.ndarray, seconds: float) -> list[Detected]:
        """Return the people in an image, the surest first.

        image: (height, width, 3), uint8, RGB. seconds: the image's time, s. Raises DetectorError.
        """
        ...

    def close(self) -> None:
        """Release the model."""
        ...


def make_detector(name: str) -> Detector:
    """Return a detector. Raises DetectorError.

    name: "mediapipe", "mediapipe_hands" for a body with hands, or the path of a MediaPipe or an ONNX file.
    """
    if name == "mediapipe_hands":
        from lassokin_ros.detector.mediapipe_hands import MediaPipeHands

        return MediaPipeHands()
    if name == "mediapipe" or name.endswith(".task"):
        from lassokin_ros.detector.mediapipe_pose import MODEL, MediaPipePose

        return MediaPipePose(MODEL if name == "mediapipe" else user_path(name))
    if name.endswith(".onnx"):
        from lassokin_ros.detector.onnx_pose import OnnxPose

        return OnnxPose(user_path(name))
    raise DetectorError(f"detector '{name}'; expected mediapipe, mediapipe_hands, or the path of a .task or .onnx file")
