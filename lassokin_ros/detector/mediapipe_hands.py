"""MediaPipe Pose with the hands: MediaPipe's hand model in the surroundings of each wrist, as MediaPipe Holistic does.

Whose hand it is follows from the wrist. The model's own label of the side is not used: it expects mirrored images.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.detector.backend import Detected, DetectorError
from lassokin_ros.detector.mediapipe_pose import MediaPipePose, mediapipe_package, quiet_stderr, short

MODEL = Path(__file__).with_name("hand_landmarker_full.task")
"""The model `full` of 0.10.21 (Apache-2.0); training/pose_landmarker.py makes it."""
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
POINTS = 21


class MediaPipeHands:
    """A person's 33 points, then 21 of the left hand and 21 of the right hand."""

    landmarks = "mediapipe75"
    several = False

    def __init__(self) -> None:
        """Raises DetectorError."""
        self._pose = MediaPipePose()
        with quiet_stderr():
            self._mediapipe, self._landmarker = _hand_landmarker()

    def detect(self, image: np.ndarray, seconds: float) -> list[Detected]:
        """See Detector.detect."""
        return [self._with_hands(image, person) for person in self._pose.detect(image, seconds)]

    def _with_hands(self, image: np.ndarray, person: Detected) -> Detected:
        hands = [self._hand(image, region) for region in hand_regions(person, image.shape)]
        pixels = [person.pixels, *(points for points, _ in hands)]
        return Detected(np.concatenate(pixels), np.concatenate([person.confidence, *(score for _, score in hands)]))

    def _hand(self, image: np.ndarray, region: tuple[slice, slice] | None) -> tuple[np.ndarray, np.ndarray]:
        """Return the points (21, 2) px and their confidence (21,) of the hand in a region; 0 without one."""
        missing = np.zeros((POINTS, 2)), np.zeros(POINTS)
        if region is None:
            return missing
        part = np.ascontiguousarray(image[region])
        shown = self._mediapipe.Image(image_format=self._mediapipe.ImageFormat.SRGB, data=part)
        with quiet_stderr():
            try:
                found = self._landmarker.detect(shown)
            except (RuntimeError, ValueError) as error:  # by the status of the C code
                raise DetectorError(f"the model of the hands cannot be run: {short(error)}") from None
        if not found.hand_landmarks:
            return missing
        points = np.array([(point.x, point.y) for point in found.hand_landmarks[0]]) * part.shape[1::-1]
        score = min(float(found.handedness[0][0].score), 1.0)
        return points + [region[1].start, region[0].start], np.full(POINTS, score)

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


def _hand_landmarker() -> tuple[Any, Any]:
    """Return the package and its open landmarker of one hand."""
    mediapipe, vision, base = mediapipe_package()
    options = vision.HandLandmarkerOptions(
        base_options=base(model_asset_buffer=MODEL.read_bytes()), running_mode=vision.RunningMode.IMAGE, num_hands=1
    )
    return mediapipe, vision.HandLandmarker.create_from_options(options)
