"""MediaPipe Pose, from the releases of the PyPI package that contain its weights (Apache-2.0)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib import metadata
from typing import Any

import numpy as np

from lassokin_ros.detector.backend import Detected, DetectorError

NEEDED = "pip install 'mediapipe>=0.10.14,<0.10.22'"


class MediaPipePose:
    """MediaPipe Pose with tracking between images. The images must come in the order of time."""

    landmarks = "mediapipe33"
    several = False

    def __init__(self) -> None:
        """Raises DetectorError."""
        self._loaded = False
        with _quiet_stderr():
            self._pose = _pose()
            self._pose.process(np.zeros((64, 64, 3), np.uint8))  # returns when the models are loaded

    def detect(self, image: np.ndarray, seconds: float) -> list[Detected]:
        """See Detector.detect."""
        with nullcontext() if self._loaded else _quiet_stderr():
            found = self._pose.process(np.ascontiguousarray(image)).pose_landmarks
        if found is None:
            return []
        self._loaded = True
        height, width = image.shape[:2]
        points = np.array([(p.x, p.y, p.visibility) for p in found.landmark])
        return [Detected(points[:, :2] * (width, height), np.clip(points[:, 2], 0.0, 1.0))]

    def close(self) -> None:
        """See Detector.close."""
        self._pose.close()


@contextmanager
def _quiet_stderr() -> Iterator[None]:
    """Discard what compiled code writes to stderr. MediaPipe logs several lines whatever its log level is."""
    try:
        kept = os.dup(2)
    except OSError:  # stderr is closed
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _pose() -> Any:
    try:
        import mediapipe
    except ImportError as error:
        raise DetectorError(f"the detector mediapipe cannot be imported ({error}); install it with: {NEEDED}") from None
    solutions = getattr(mediapipe, "solutions", None)
    if solutions is None or not hasattr(solutions, "pose"):
        raise DetectorError(
            f"mediapipe {metadata.version('mediapipe')} does not contain the weights of MediaPipe Pose; install a "
            f"release that does: {NEEDED}"
        )
    return solutions.pose.Pose(model_complexity=1)  # the package contains the weights of `full` only
