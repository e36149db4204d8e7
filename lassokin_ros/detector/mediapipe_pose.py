"""MediaPipe Pose, alone and with the hands, by its Tasks API. Its packages have no weights: see `MODEL`.

For the hands, MediaPipe's hand model looks at the surroundings of each wrist, as MediaPipe Holistic does. Whose hand it
is follows from the wrist. The model's own label of the side is not used: it expects mirrored images.
"""

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

from lassokin_ros.common.command_line import one_line
from lassokin_ros.detector.backend import Detected, DetectorError

MODEL = Path(__file__).with_name("pose_landmarker_full.task")
HANDS_MODEL = Path(__file__).with_name("hand_landmarker_full.task")
"""The models `full` of 0.10.21 (Apache-2.0); training/pose_landmarker.py makes them."""
NEEDED = "pip install 'mediapipe>=0.10.30,<0.10.32'"
NEWEST = (0, 10, 31)
"""The wheels up to this one have no code that opens a connection. Later ones look up a host."""
NETWORKS = ("pose_detector.tflite", "pose_landmarks_detector.tflite")
"""Files in a .task file for the pose."""
QUIET = {"GLOG_minloglevel": "3", "TF_CPP_MIN_LOG_LEVEL": "3"}
"""Environment variables that keep MediaPipe from writing to stderr beside our lines."""
HAND_POINTS = 21
WRISTS, KNUCKLES = ((15, 17, 19), (16, 18, 20)), 1.0
"""Points of the pose at wrist, little finger and index finger, left and right. The region's middle is so many times as
far from the wrist as the middle of the other two."""
LIMBS = {(11, 23): 0.300, (23, 25): 0.242, (25, 27): 0.233, (11, 13): 0.167, (13, 15): 0.151}
"""Points of the left side and their distance in heights, see skeletons/anthropometric.yaml: the size in the image."""
REACH = 0.16
"""Half the side of a hand's region, of the height: a hand has 0.11 from the wrist to the tip."""
LEAST_PX = 16
"""Side of a region, px, below which no hand is looked for."""
SURE = 0.5
"""Confidence of the pose's wrist below which no hand is looked for."""


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
            self._mediapipe, self._landmarker = _landmarker("Pose", path, running_mode="VIDEO")

    def detect(self, image: np.ndarray, seconds: float) -> list[Detected]:
        """See Detector.detect. After a time that does not rise, MediaPipe's own clock goes on by 1 ms, as it must."""
        given_ms = round(seconds * 1000.0)
        self._clock_ms += max(given_ms - self._given_ms, 1)
        self._given_ms = given_ms
        shown = _image(self._mediapipe, image)
        with nullcontext() if self._loaded else quiet_stderr():
            try:
                people = self._landmarker.detect_for_video(shown, self._clock_ms).pose_landmarks
            except (RuntimeError, ValueError) as error:  # by the status of the C code
                raise DetectorError(f"the model '{self._path}' cannot be run: {one_line(error)}") from None
        if not people:
            return []
        self._loaded = True
        height, width = image.shape[:2]
        points = np.array([(p.x, p.y, p.visibility) for p in people[0]])
        return [Detected(points[:, :2] * (width, height), np.clip(points[:, 2], 0.0, 1.0))]

    def close(self) -> None:
        """See Detector.close. Without it, the interpreter reports an error when it ends."""
        self._landmarker.close()


class MediaPipeHands:
    """A person's 33 points, then 21 of the left hand and 21 of the right hand."""

    landmarks = "mediapipe75"
    several = False

    def __init__(self) -> None:
        """Raises DetectorError."""
        self._pose = MediaPipePose()
        with quiet_stderr():
            self._mediapipe, self._landmarker = _landmarker("Hand", HANDS_MODEL, running_mode="IMAGE", num_hands=1)

    def detect(self, image: np.ndarray, seconds: float) -> list[Detected]:
        """See Detector.detect."""
        found = []
        for person in self._pose.detect(image, seconds):
            hands = [self._hand(image, region) for region in hand_regions(person, image.shape)]
            pixels, scores = zip((person.pixels, person.confidence), *hands)
            found.append(Detected(np.concatenate(pixels), np.concatenate(scores)))
        return found

    def _hand(self, image: np.ndarray, region: tuple[slice, slice] | None) -> tuple[np.ndarray, np.ndarray]:
        """Return the points (21, 2) px and their confidence (21,) of the hand in a region; 0 without one."""
        missing = np.zeros((HAND_POINTS, 2)), np.zeros(HAND_POINTS)
        if region is None:
            return missing
        part = image[region]
        with quiet_stderr():
            try:
                found = self._landmarker.detect(_image(self._mediapipe, part))
            except (RuntimeError, ValueError) as error:  # by the status of the C code
                raise DetectorError(f"the model of the hands cannot be run: {one_line(error)}") from None
        if not found.hand_landmarks:
            return missing
        points = np.array([(point.x, point.y) for point in found.hand_landmarks[0]]) * part.shape[1::-1]
        score = min(float(found.handedness[0][0].score), 1.0)
        return points + [region[1].start, region[0].start], np.full(HAND_POINTS, score)

    def close(self) -> None:
        """See Detector.close."""
        self._pose.close()
        self._landmarker.close()


def hand_regions(person: Detected, shape: tuple[int, ...]) -> list[tuple[slice, slice] | None]:
    """Return rows and columns of the surroundings of both hands, None where no wrist is seen or the region is small.

    person: 33 points of the pose. shape: (height, width, ...) of the image.
    """
    pixels, regions = person.pixels, list[tuple[slice, slice] | None]()
    pairs = [(a + side, b + side, length) for (a, b), length in LIMBS.items() for side in (0, 1)]
    size = max(float(np.linalg.norm(pixels[a] - pixels[b])) / length for a, b, length in pairs)
    for wrist, little, index in WRISTS:
        middle = pixels[wrist] + KNUCKLES * (0.5 * (pixels[little] + pixels[index]) - pixels[wrist])
        limits = np.array(shape[1::-1])
        first = np.clip(np.floor(middle - REACH * size), 0, limits).astype(int)
        last = np.clip(np.ceil(middle + REACH * size), 0, limits).astype(int)
        seen = person.confidence[wrist] >= SURE and (last - first).min() >= LEAST_PX
        regions.append((slice(first[1], last[1]), slice(first[0], last[0])) if seen else None)
    return regions


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


def _landmarker(part: str, path: Path, running_mode: str, **options: Any) -> tuple[Any, Any]:
    """Return MediaPipe's package, and its open landmarker of a part, "Pose" or "Hand". Raises DetectorError."""
    try:
        version = metadata.version("mediapipe")
        if tuple(map(int, re.findall(r"\d+", version)[:3])) > NEWEST:
            raise DetectorError(
                f"mediapipe {version} looks up a host when it runs, and images should not leave the computer; install "
                f"a release that does not: {NEEDED}"
            )
        for name, level in QUIET.items():
            os.environ.setdefault(name, level)
        import mediapipe
        from mediapipe.tasks.python import BaseOptions, vision
    except (ImportError, OSError) as error:  # OSError: a library that it loads
        raise DetectorError(f"the detector mediapipe cannot be imported ({error}); install it with: {NEEDED}") from None
    base, mode = BaseOptions(model_asset_buffer=path.read_bytes()), vision.RunningMode[running_mode]
    made = getattr(vision, f"{part}LandmarkerOptions")(base_options=base, running_mode=mode, **options)
    try:
        return mediapipe, getattr(vision, f"{part}Landmarker").create_from_options(made)
    except Exception as error:  # RuntimeError, ValueError and others, by the status of the C code
        raise DetectorError(
            f"'{path}' is no model of MediaPipe's {part.lower()} landmarker: {one_line(error)}"
        ) from None


def _image(mediapipe: Any, rgb: np.ndarray) -> Any:
    return mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=np.ascontiguousarray(rgb))


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
