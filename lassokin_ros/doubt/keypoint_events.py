"""Events in the keypoints: the detector exchanges left and right, or continues with another person.

They tell what the detector did from one frame to the next, before the tracker corrects it (`core/image/side_swaps`): by
how far each keypoint moved to its own place, and to the other side's place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.proportions import partners
from lassokin_ros.core.image.projection import carried, norm

PAIRS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
"""Landmarks that exist on both sides."""
LONGEST_S = 0.3
"""s: after a longer pause two frames are not compared."""
LIMBS = {"body": PAIRS, "legs": PAIRS[3:], "arms": PAIRS[:3]}
RATIO = {"body": 1.6, "legs": 1.5, "arms": 3.5}
"""Ratio of the pairs' straight displacement to the crossed one from which they are exchanged. On 28 recordings and 550
clips of motion capture at 30, 15 and 10 Hz no exchange was reported; 23 of 24 of the body and 20 of 24 of the legs
were found. Arms cross in ordinary motion, so theirs is higher."""
LEAST_MOTION = 0.12
"""Trunk lengths: a smaller straight displacement is the noise of pairs that lie on each other."""
LEAST, PER_SECOND = 0.5, 15.0
"""Trunk lengths, and trunk lengths per second: the larger one is the median displacement of a person's keypoints that
no motion of 44 recordings and 550 clips reached. All of 16 changes of person exceeded it."""
_HALVES = np.full(2, 0.5)


@dataclass(eq=False)
class KeypointMotion:
    """The motion between two frames, in trunk lengths of the image (middle of the shoulders to middle of the hips).

    step: s. points, last: (l, 2) keypoints now and before, NaN if missing. trunk: its length in their unit. partner:
    see `partners`.
    """

    step: float
    points: np.ndarray
    last: np.ndarray
    trunk: float
    partner: np.ndarray

    @cached_property
    def straight(self) -> np.ndarray:
        """(l,) distance of each keypoint from its own last place, NaN if one of them is missing."""
        return norm(self.points - self.last) / self.trunk

    @property
    def largest(self) -> float:
        """The largest of these distances, NaN if there is none."""
        return float(np.fmax.reduce(self.straight))

    @cached_property
    def crossed(self) -> np.ndarray:
        """(l,) distance of each keypoint from its counterpart's last place, NaN if one of them is missing."""
        return norm(self.points - self.last[self.partner]) / self.trunk


class MotionMeter:
    """Measures the motion from frame to frame."""

    def __init__(self, names: Sequence[str]) -> None:
        """names: l landmarks in layout order."""
        self._partner = partners(names)
        trunk = [f"{side}_{part}" for part in ("shoulder", "hip") for side in ("left", "right")]
        self._trunk = [list(names).index(name) for name in trunk] if set(trunk) <= set(names) else []
        self.reset()

    def reset(self) -> None:
        """Forget the last frame."""
        self._last: tuple[float, np.ndarray, np.ndarray | None] | None = None
        self._size = np.nan

    def update(self, stamp: float, points: np.ndarray, rotation: np.ndarray | None = None) -> KeypointMotion | None:
        """Return the motion since the last frame, None without one of the last `LONGEST_S` or without a trunk.

        stamp: s. points: (l, 2) in any unit of the image, NaN = missing. rotation: see `Signs`; turns of the camera are
        no motion.
        """
        last, size, self._last, present = self._last, self._size, (stamp, points.copy(), rotation), math.nan
        if self._trunk:
            (a, b), (c, d), (e, f), (g, h) = points.take(self._trunk, axis=0).tolist()
            present = 0.5 * math.hypot(a + c - e - g, b + d - f - h)
        self._size = size if math.isnan(present) else present
        scale = max(size, present) if size == size and present == present else self._size
        if last is None or not 0 < stamp - last[0] <= LONGEST_S or not scale > 0:
            return None
        before = last[1]
        if rotation is not None and last[2] is not None and not np.array_equal(rotation, last[2]):
            before = carried(before, rotation @ last[2].T, np.zeros(3))
        return KeypointMotion(stamp - last[0], points, before, scale, self._partner)


class SideExchange:
    """Reports exchanges of the sides."""

    def __init__(self, names: Sequence[str]) -> None:
        """names: l landmarks in layout order."""
        place = {name: i for i, name in enumerate(names)}
        pairs = [pair for pair in PAIRS if {f"left_{pair}", f"right_{pair}"} <= place.keys()]
        self._pairs = np.array(
            [[place[f"{side}_{pair}"] for side in ("left", "right")] for pair in pairs], int
        ).reshape(-1, 2)
        #: For each limb the indices of its pairs among these.
        self._limbs = {limb: [i for i, pair in enumerate(pairs) if pair in own] for limb, own in LIMBS.items()}

    def update(self, motion: KeypointMotion | None) -> str:
        """Return what was exchanged with this frame: body, legs, arms, or an empty text."""
        if motion is None:
            return ""
        straight = (motion.straight[self._pairs] @ _HALVES).tolist()  # of each pair, NaN if it is not seen
        if not any(own > LEAST_MOTION for own in straight):
            return ""
        moved = list(zip(straight, (motion.crossed[self._pairs] @ _HALVES).tolist()))
        for limb, pairs in self._limbs.items():
            seen = [moved[i] for i in pairs if moved[i][0] == moved[i][0] and moved[i][1] == moved[i][1]]
            if len(seen) >= max(2, len(pairs) / 2):
                own, other = (sum(values) / len(seen) for values in zip(*seen))
                if own > LEAST_MOTION and own > RATIO[limb] * other:
                    return limb
        return ""


def is_person_change(motion: KeypointMotion | None) -> bool:
    """Return whether the keypoints are another person's than in the last frame."""
    if motion is None:
        return False
    limit = max(LEAST, PER_SECOND * motion.step)
    return limit < _median(motion.straight) < np.inf and _median(motion.crossed) > limit


def _median(values: np.ndarray) -> float:
    """Return the median of the known values; infinity if there are none. np.nanmedian takes ten times as long."""
    known = sorted(values[values == values].tolist())
    if not known:
        return np.inf
    return float(known[len(known) // 2] + known[(len(known) - 1) // 2]) / 2
