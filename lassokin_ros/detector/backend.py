"""The interface of the detectors, and their selection by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import user_path
from msg_adapters.backends import Backend
from msg_adapters.inputs import people_cloud, point_cloud


class DetectorError(LassokinError):
    """A detector cannot be used: its package, its version or its model file does not fit, or it fails on an image."""


@dataclass(frozen=True, eq=False)
class Detected:
    """Keypoints of one person in one image.

    pixels: (l, 2) px. confidence: (l,) 0 to 1, 0 = missing. number: the person's, from 1; 0 if nobody knows who it is.
    """

    pixels: np.ndarray
    confidence: np.ndarray
    number: int = 0


def numbered(people: Sequence[Detected]) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Return number, pixels and confidence of the people in an image. Numbers below 0 are valid in this image only."""
    return [(one.number or -1 - i, one.pixels, one.confidence) for i, one in enumerate(people)]


def keypoint_message(backend: Backend, stamp_ns: int, frame_id: str, found: Sequence[Detected], several: bool) -> Any:
    """Return the people in an image as sensor_msgs/PointCloud2.

    several: the detector can find more than one person; the points then have the field `person`, see `numbered`.
    """
    if several:
        return people_cloud(backend, stamp_ns, frame_id, numbered(found))
    pixels, confidence = (found[0].pixels, found[0].confidence) if found else (np.zeros((0, 2)), np.zeros(0))
    return point_cloud(backend, stamp_ns, frame_id, pixels, confidence)


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
        from lassokin_ros.detector.mediapipe_pose import MediaPipeHands

        return MediaPipeHands()
    if name == "mediapipe" or name.endswith(".task"):
        from lassokin_ros.detector.mediapipe_pose import MODEL, MediaPipePose

        return MediaPipePose(MODEL if name == "mediapipe" else user_path(name))
    if name.endswith(".onnx"):
        from lassokin_ros.detector.onnx_pose import OnnxPose

        return OnnxPose(user_path(name))
    raise DetectorError(f"detector '{name}'; expected mediapipe, mediapipe_hands, or the path of a .task or .onnx file")
