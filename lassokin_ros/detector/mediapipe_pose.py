"""MediaPipe Pose, by its Tasks API. Its packages have no weights: these are in a file beside this module."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib import metadata
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from lassokin_ros.detector.backend import Detected, DetectorError

MODEL = Path(__file__).with_name("pose_landmarker_full.task")
"""The model `full` of 0.10.21 (Apache-2.0); training/pose_landmarker.py makes it."""
NEEDED = "pip install 'mediapipe>=0.10.30,<0.10.32'"
NEWEST = (0, 10, 31)
"""The wheels up to this one have no code that opens a connection. Later ones look up a host."""
NETWORKS = ("pose_detector.tflite", "pose_landmarks_detector.tflite")
"""Files in a .task file for the pose."""


class MediaPipePose:
    """MediaPipe Pose with tracking between images. The images should come in the order of time."""

    landmarks = "mediapipe33"
    several = False

    def __init__(self, path: Path = MODEL) -> None:
        """path: a file pose_landmarker_*.task. Raises DetectorError."""
        _check(path)
        self._path, self._loaded = path, False
        self._given_ms, self._clock_ms = 0, 0
        with quiet_stderr():
            self._mediapipe, self._landmarker = _landmarker(path)

    def detect(self, image: np.ndarray, seconds: float) -> list[Detected]:
        """See Detector.detect. After a time that does not rise, MediaPipe's own clock goes on by 1 ms, as it must."""
        given_ms = round(seconds * 1000.0)
        self._clock_ms += max(given_ms - self._given_ms, 1)
        self._given_ms = given_ms
        shown = self._mediapipe.Image(image_format=self._mediapipe.ImageFormat.SRGB, data=np.ascontiguousarray(image))
        with nullcontext() if self._loaded else quiet_stderr():
            try:
                people = self._landmarker.detect_for_video(shown, self._clock_ms).pose_landmarks
            except (RuntimeError, ValueError) as error:  # by the status of the C code
                raise DetectorError(f"the model '{self._path}' cannot be run: {short(error)}") from None
        if not people:
            return []
        self._loaded = True
        height, width = image.shape[:2]
        points = np.array([(p.x, p.y, p.visibility) for p in people[0]])
        return [Detected(points[:, :2] * (width, height), np.clip(points[:, 2], 0.0, 1.0))]

    def close(self) -> None:
        """See Detector.close. Without it, the interpreter reports an error when it ends."""
        self._landmarker.close()


def _check(path: Path) -> None:
    """Raise DetectorError for a file that is missing, or no model of a pose."""
    if not path.is_file():
        raise DetectorError(f"there is no file '{path}'; expected a model pose_landmarker_*.task of MediaPipe")
    try:
        with ZipFile(path) as file:
            names = file.namelist()
    except BadZipFile:
        with path.open("rb") as file:
            pointer = file.read(12) == b"version http"
        kind = "a pointer of Git LFS in place of the file" if pointer else "damaged, or no .task file"
        raise DetectorError(f"'{path}' is {kind}; expected a model pose_landmarker_*.task of MediaPipe") from None
    if not set(NETWORKS) <= set(names):
        raise DetectorError(
            f"'{path}' holds {', '.join(names) or 'nothing'}; expected a model of MediaPipe's pose landmarker, with "
            f"{' and '.join(NETWORKS)}"
        )


def mediapipe_package() -> tuple[Any, Any, Any]:
    """Return MediaPipe's package, its part for images, and its class of base options. Raises DetectorError."""
    try:
        version = metadata.version("mediapipe")
        if tuple(map(int, re.findall(r"\d+", version)[:3])) > NEWEST:
            raise DetectorError(
                f"mediapipe {version} looks up a host when it runs, and images should not leave the computer; install "
                f"a release that does not: {NEEDED}"
            )
        import mediapipe
        from mediapipe.tasks.python import BaseOptions, vision
    except (ImportError, OSError) as error:  # OSError: a library that it loads
        raise DetectorError(f"the detector mediapipe cannot be imported ({error}); install it with: {NEEDED}") from None
    return mediapipe, vision, BaseOptions


def _landmarker(path: Path) -> tuple[Any, Any]:
    """Return the package and its open landmarker."""
    mediapipe, vision, base = mediapipe_package()
    options = vision.PoseLandmarkerOptions(
        base_options=base(model_asset_buffer=path.read_bytes()), running_mode=vision.RunningMode.VIDEO
    )
    try:
        return mediapipe, vision.PoseLandmarker.create_from_options(options)
    except Exception as error:  # RuntimeError, ValueError and others, by the status of the C code
        raise DetectorError(f"'{path}' is no model of MediaPipe's pose landmarker: {short(error)}") from None


def short(error: Exception) -> str:
    """Return an error in one line."""
    return " ".join(str(error).split())[:160]


@contextmanager
def quiet_stderr() -> Iterator[None]:
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
