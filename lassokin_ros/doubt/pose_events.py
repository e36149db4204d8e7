"""Events in the pose: the person turns faster than people do and stays reversed, the pelvis jumps along the line of
sight, or the pose explains the frame badly.
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.doubt.recent import Recent

TURN_DEG, TURN_S = 90.0, 0.15
"""A turn by more than 90 degrees within 0.15 s is none of a person: it occurred in 0 of 127 recordings and clips, and
after 21 of 24 exchanges of the sides and all of 16 changes of person. Below 6.7 Hz no turn is reported."""
_TURNED = math.cos(math.radians(TURN_DEG))
MERGED_S = 0.3
"""s: turns that follow each other within this time are one turn."""
CORNERS = ("left_hip", "right_hip", "left_shoulder", "right_shoulder")
JUMP, JUMP_S = 0.25, 0.1
"""A change of the distance from the camera by more than a quarter within 0.1 s. No good recording has it, and 15 of 16
changes of person do. Below 10 Hz no jump is reported."""
COST = 10.0
"""Cost per measurement above which a pose explains nothing. The largest of good recordings is 6.6."""
PRIOR_COST = 120.0
"""Cost of the pose prior above which a posture is none of a person. The largest of good recordings is 108."""
REPROJECTION, RUN_S = 0.05, 0.1
"""Reprojection error as a share of the person's height in the image, and s for which it must stay above. It occurred in
no good recording, and in 24 of 24 exchanges of the sides."""
Vector = tuple[float, float, float]
"""Three numbers: arithmetic on so few takes a third of the time of numpy's."""


def facing_of(corners: np.ndarray) -> Vector:
    """Return the unit vector to the person's front, NaN for a degenerate trunk.

    corners: (4, 3) m, positions of the `CORNERS`.
    """
    axes = corners.T.tolist()
    a, b, c = (hip - right_hip + shoulder - right_shoulder for hip, right_hip, shoulder, right_shoulder in axes)
    d, e, f = (shoulder + right_shoulder - hip - right_hip for hip, right_hip, shoulder, right_shoulder in axes)
    x, y, z = b * f - c * e, c * d - a * f, a * e - b * d
    size = math.hypot(x, y, z)
    return (x / size, y / size, z / size) if size > 0 else (math.nan, math.nan, math.nan)


def _dot(one: Vector, other: Vector) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def is_fast_turn(before: Vector, front: Vector) -> bool:
    """Return whether two facings differ by more than a person turns in `TURN_S`."""
    return _dot(before, front) < _TURNED


class LastingReversal:
    """Remembers whether the person is reversed since a turn that was too fast.

    Once the tracker follows exchanged sides, no figure of a single frame shows it: the reversed pose explains the
    image. The parity of the turns does. An odd number of reversals is doubted until the next one.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the earlier turns."""
        self._odd = False
        self._turn: tuple[float, Vector] | None = None

    def update(self, stamp: float, front: Vector, turned_from: Vector | None) -> bool:
        """Return whether the person is reversed.

        turned_from: the facing before a fast turn that ends in this frame, None without one.
        """
        if turned_from is not None:
            start = turned_from if self._turn is None else self._turn[1]
            self._turn = stamp, start
        if self._turn is None:
            return self._odd
        last, before = self._turn
        reversed_now = self._odd ^ (_dot(before, front) < 0)
        if stamp - last > MERGED_S:
            self._odd, self._turn = reversed_now, None
        return reversed_now


def is_jump(before: float, distance: float) -> bool:
    """Return whether the distance, m, above 0, is that of a pelvis that has jumped."""
    return abs(distance / before - 1) > JUMP


def is_costly(cost_per_measurement: float, prior_cost: float) -> bool:
    """Return whether a cost is above that of any good frame. NaN is not."""
    return cost_per_measurement > COST or prior_cost > PRIOR_COST


class ReprojectionRun:
    """Reports reprojection errors that stay large."""

    def __init__(self) -> None:
        self._recent: Recent[float] = Recent(RUN_S)

    def reset(self) -> None:
        """Forget the earlier frames."""
        self._recent.clear()

    def update(self, stamp: float, share: float) -> bool:
        """Return whether the error has been large for `RUN_S`. stamp: s. share: of the person's height in the image."""
        if not share > REPROJECTION:
            self._recent.clear()
            return False
        self._recent.add(stamp, share)
        return self._recent.span > 0.8 * RUN_S
