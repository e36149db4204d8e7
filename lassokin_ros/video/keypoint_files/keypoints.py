"""The keypoints in a file, and which layout its points are in."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.landmarks import BODY, Layout, built_in_layouts
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.detector.backend import Detected
from lassokin_ros.video.sources import SourceError

LAYOUTS = {17: "coco17", 18: "openpose18", 25: "body25", 26: "halpe26", 33: "mediapipe33"}
"""Layout by the number of points, for files without names."""
LONGER = {133: 17, 136: 26}
"""Whole bodies with faces and hands: number of points, and how many of the first are those of the body."""
NEEDED = ("shoulder", "hip", "knee")
"""Landmarks that a file must name on both sides."""
MOST_NUMBERS = 50_000_000
"""Most numbers in a file, 8 bytes each."""


@dataclass(frozen=True, eq=False)
class KeypointFile:
    """The keypoints of a file.

    layout: name of the landmark layout. people: the people in each of f images. seconds: (f,) s, rising; None if the
    file has no times. size: (width, height) px of the images; None if unknown. relative: the points are shares of
    width and height.
    """

    layout: str
    people: Sequence[Sequence[Detected]]
    seconds: np.ndarray | None = None
    size: tuple[int, int] | None = None
    relative: bool = False

    def shown_at(self, seconds: np.ndarray, size: tuple[int, int]) -> StoredKeypoints:
        """Return them as a detector. seconds: (f,) of the images. size: (width, height) px."""
        scale = np.array(size) if self.relative else np.ones(2)
        people = [[Detected(one.pixels * scale, one.confidence) for one in image] for image in self.people]
        several = max(map(len, people), default=0) > 1
        return StoredKeypoints(self.layout, several, dict(zip(seconds.tolist(), people)))


@dataclass(eq=False)
class StoredKeypoints:
    """The keypoints of a file as a Detector: the images are known by their times, s."""

    landmarks: str
    several: bool
    people: Mapping[float, list[Detected]]

    def detect(self, image: np.ndarray, seconds: float) -> list[Detected]:
        """See Detector.detect. The image is not looked at."""
        return self.people.get(seconds, [])

    def close(self) -> None:
        """See Detector.close."""


def detected(points: np.ndarray) -> Detected:
    """Return a person's keypoints. points: (l, 3), x, y and confidence; one that is not finite or (0, 0) is missing."""
    seen = np.isfinite(points).all(axis=1) & (points[:, :2] != 0).any(axis=1)
    return Detected(np.where(seen[:, None], points[:, :2], 0.0), np.where(seen, np.clip(points[:, 2], 0.0, 1.0), 0.0))


def body_of(count: int, source: str) -> tuple[str, int]:
    """Return layout and number of the body's points of a file with `count` points per person. Raises SourceError."""
    body = LONGER.get(count, count)
    if body not in LAYOUTS:
        known = ", ".join(f"{number} ({name})" for number, name in LAYOUTS.items())
        raise SourceError(f"'{source}' has {count} points per person; expected {known}")
    return LAYOUTS[body], body


def by_names(names: Sequence[str], source: str) -> tuple[str, np.ndarray]:
    """Return the layout that has most of the named points, and the column (l,) of each landmark, -1 = not in the file.

    Raises SourceError if no layout fits.
    """
    columns = {_plain(name): number for number, name in enumerate(names)}
    lacking = [f"{side}_{part}" for part in NEEDED for side in ("left", "right") if f"{side[0]}{part}" not in columns]
    if lacking:
        raise SourceError(
            f"'{source}' has the points {', '.join(names[:40])}, and no {lacking[0]}; expected the names of the "
            "landmarks of a layout, such as left_shoulder, LShoulder or l_shoulder"
        )
    skeleton, best = Skeleton.load(BODY, 1.75), ("", np.zeros(0, int), 0)
    for layout in built_in_layouts(BODY):
        found = np.array([columns.get(_plain(name), -1) for name in Layout.load(layout, skeleton).names])
        known = int((found >= 0).sum())
        if known > best[2] or known == best[2] and len(found) < len(best[1]):
            best = layout, found, known
    return best[:2]


def in_order(columns: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points (..., l, 3) of a layout from those of a file (..., k, 3); see by_names. Confidence 0 = missing."""
    return np.asarray(np.where(columns[:, None] >= 0, points[..., columns, :], 0.0))


def on_frames(found: Mapping[int, Sequence[Detected]]) -> list[Sequence[Detected]]:
    """Return the people of each image from the first number to the last. Numbers with large gaps are counted anew."""
    numbers = sorted(found)
    if numbers and numbers[-1] - numbers[0] >= 10 * len(numbers):  # those of a data set, not of a video
        return [found[number] for number in numbers]
    return [found.get(number, ()) for number in range(numbers[0], numbers[-1] + 1)] if numbers else []


def number_in(name: str) -> int | None:
    """Return the last number in a name, without its suffix: that of the image."""
    found = re.findall(r"\d+", re.sub(r"\.\w+$", "", name))
    return int(found[-1]) if found else None


def _plain(name: str) -> str:
    """Return a name without differences of spelling: LHip, l_hip, hip_left and left_hip become lhip."""
    words = re.sub(r"([a-z])([A-Z])|([LR])([A-Z][a-z])", r"\1\3 \2\4", name)
    parts = [part for part in re.split(r"[^a-z0-9]+", words.lower()) if part]
    sides = [part[0] for part in parts if part in ("left", "right", "l", "r")]
    return "".join([*sides, *(part for part in parts if part not in ("left", "right", "l", "r"))])
