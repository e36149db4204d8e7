"""Whether one of several cameras was moved a moment ago, as the person shows.

The poses that the last frames suggest are compared with those that all frames before did. With a given pose, a camera
that was moved cannot be told from a detector's lasting errors.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from lassokin_ros.core.learned.epipolar_fit import (
    GIVEN_DEVIATION,
    EpipolarFit,
    Pairs,
    moved_by,
    relative_size,
    size_of,
    stacked,
)
from lassokin_ros.core.observation import CameraPose

LATELY = 6
"""Frames that show at once that a camera was moved."""
CHANGED, CONTRADICTS = 0.75, 1.3
"""Sizes, in GIVEN_DEVIATION, of what the last frames suggest beyond what all frames before did: half of it is used in
the covariance, and from which on the cameras are said to contradict each other. A detector's errors cause 0.3 to 0.9, a
camera that was turned by 3 degrees 1.5; see docs/experiments.md."""
LEAST_CHANGE, UNSURE, FARTHEST_OFF = 0.4, 0.5, 2.0
"""The same, below which nothing is added to the covariance, and by how much it may be larger; and m, limit of the
deviation that is added."""
FEWEST_JUDGED = 10
"""Frames before there is a judgement."""


class MovedCameras:
    """Compares the last frames of each camera but the anchor with those before."""

    def __init__(self, fit: EpipolarFit) -> None:
        self._fit = fit
        self.reset()

    def reset(self) -> None:
        """Forget the frames."""
        self._lately: dict[str, deque[Pairs]] = {}
        self._suggested: dict[str, np.ndarray] = {}  # (6,) correction that the last frames suggest, by camera
        self._usual: dict[str, tuple[np.ndarray, int]] = {}  # (6,) mean of those before, and their number
        self.moves: dict[str, np.ndarray] = {}
        """(6,) by how much a camera was moved lately, relative to the anchor, as the last frames suggest, by name."""
        self._anchor = ""

    def add(
        self, name: str, anchor: str, pair: Pairs, due: bool, sized: bool, correction: np.ndarray | None = None
    ) -> None:
        """Use a frame of a camera and of the anchor. due: whether it is time to judge; sized: see `EpipolarFit.solved`.

        correction: (6,) of the pose in use, if poses are corrected.
        """
        frames = self._lately.setdefault(name, deque(maxlen=LATELY))
        frames.append(pair)
        if len(frames) < LATELY or not due:
            return
        start = self._suggested.get(name, np.zeros(6))
        suggested = self._fit.solved(stacked(frames), start, 3 * GIVEN_DEVIATION, sized, steps=2)
        self._suggested[name], self._anchor = suggested, anchor
        if correction is not None:
            self.moves[name] = suggested - correction
            return
        usual, count = self._usual.get(name, (np.zeros(6), 0))
        plausible = relative_size(suggested) < 2.2
        if count >= FEWEST_JUDGED or not plausible:
            self.moves[name] = suggested - usual
        if plausible and (count < FEWEST_JUDGED or relative_size(self.moves[name]) < CHANGED):
            self._usual[name] = usual + (suggested - usual) / min(count + 1, 25), count + 1

    @property
    def contradicting(self) -> list[str]:
        """Names of the cameras that contradict the anchor since a moment: they were moved, or it was."""
        return [name for name, move in self.moves.items() if relative_size(move) > CONTRADICTS]

    @property
    def in_words(self) -> str:
        """Which camera was moved, in words; empty if none was.

        Of two cameras it cannot be told which one. If several contradict the anchor, it was the anchor.
        """
        names = self.contradicting
        if not names:
            return ""
        largest = max((self.moves[name] for name in names), key=relative_size)
        by = f"about {math.degrees(size_of(largest)[0]):.0f} degrees or {size_of(largest)[1]:.2f} m"
        if len(self.moves) == 1:
            return f"cameras '{self._anchor}' and '{names[0]}' contradict each other: one of them was moved, by {by}"
        moved = names[0] if len(names) == 1 else self._anchor
        return f"camera '{moved}' contradicts the others: it was moved, by {by}"

    def place_covariance(
        self, place: np.ndarray, poses: Mapping[str, CameraPose], moves: Mapping[str, np.ndarray]
    ) -> np.ndarray | None:
        """(3, 3) m^2: how far a place (3,) m is elsewhere with the poses that frames suggest; None if nowhere.

        poses: the given ones, by name; moves: (6,) by how much they are off. It is where the line of sight of the moved
        camera meets the anchor's. Either of both may have been moved, so that the place is off in all directions of the
        plane of the two lines.
        """
        anchor, found = poses.get(self._anchor), np.zeros((3, 3))
        for name, move in moves.items():
            given, size = poses.get(name), relative_size(move)
            if anchor is None or given is None or size < LEAST_CHANGE:
                continue
            share = size**4 / (size**4 + CHANGED**4) * (1 + UNSURE / size)
            seen = moved_by(given, share * move)
            a, b = place - anchor.centre, seen.rotation.T @ (given.rotation @ (place - given.centre))
            normal = np.cross(a, b)
            if not normal.any():
                continue
            s, t, _ = np.linalg.solve(np.stack([a, -b, normal], axis=1), seen.centre - anchor.centre)
            off = 0.5 * (anchor.centre + s * a + seen.centre + t * b) - place
            normal = normal / np.linalg.norm(normal)
            found += min(off @ off, FARTHEST_OFF**2) * (np.eye(3) - np.outer(normal, normal))
        return found if found.any() else None
