"""Events in the pose: the person turns faster than people do and stays reversed, the pelvis jumps along the line of
sight, or the pose explains the frame badly. And the probability of a wrong pose, from figures of the last second.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

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
OFFSET = -2.83
BY_PRIOR, PRIOR_MEAN, PRIOR_SPREAD, PRIOR_S = 0.40, 1.895, 0.61, 0.5
"""Slope, mean and spread of the mean of ln(prior cost) over the last 0.5 s."""
BY_NETWORK, NETWORK_MEAN, NETWORK_SPREAD, NETWORK_S = 1.22, -2.806, 0.636, 1.0
"""Slope, mean and spread of ln(largest distance in m of the network's pose from the tracked one in the last 1 s)."""
SMALLEST = 1e-6
Vector = tuple[float, float, float]
"""Three numbers: arithmetic on so few takes a third of the time of numpy's."""
Value = TypeVar("Value")
ROUNDING_S = 1e-6
"""s: stamps are rounded, so a window of 0.1 s holds the frame of exactly 0.1 s ago."""


class Recent(Generic[Value]):
    """Values with their stamps, of the last `seconds`."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds + ROUNDING_S
        self._stamps: deque[float] = deque()
        self.values: deque[Value] = deque()
        """The values, oldest first."""

    def add(self, stamp: float, value: Value) -> None:
        """Add a value and drop those that are too old. stamp: s. A stamp that goes back drops all others."""
        if self._stamps and stamp < self._stamps[-1]:
            self.clear()
        self._stamps.append(stamp)
        self.values.append(value)
        self.forget_before(stamp)

    def forget_before(self, stamp: float) -> None:
        """Drop the values that are too old at a stamp, s."""
        stamps = self._stamps
        while stamps and stamp - stamps[0] > self._seconds:
            stamps.popleft()
            self.values.popleft()

    def clear(self) -> None:
        """Drop all values."""
        self._stamps.clear()
        self.values.clear()

    @property
    def span(self) -> float:
        """Time from the oldest value to the newest one, s."""
        return self._stamps[-1] - self._stamps[0] if self._stamps else 0.0


class Change(Generic[Value]):
    """Reports a value that differs from one of the last moments; once, because the later ones are compared with it."""

    def __init__(self, seconds: float, differs: Callable[[Value, Value], bool]) -> None:
        """differs: whether an earlier value and the present one are too different."""
        self._recent: Recent[Value] = Recent(seconds)
        self._differs = differs

    def reset(self) -> None:
        """Forget the earlier values."""
        self._recent.clear()

    def update(self, stamp: float, value: Value) -> Value | None:
        """Return the earlier value from which this one differs, None without one. stamp: s."""
        self._recent.forget_before(stamp)
        before = next((old for old in self._recent.values if self._differs(old, value)), None)
        if before is not None:
            self._recent.clear()
        self._recent.add(stamp, value)
        return before


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


class FailureModel:
    """How likely the mean error of a pose's joints exceeds 100 mm, from two figures of the last second.

    A logistic model, learned on simulation. On real video of the full body its area under the ROC curve is 0.78 (0.89
    for 150 mm; the odds of `output.failure_probability`: 0.73 and 0.82), and the stated probability is half of the true
    share. Further figures helped in simulation and hurt on real video. benchmarks/accuracy.py --failure-probability
    prints it.
    """

    def __init__(self) -> None:
        self._prior: Recent[float] = Recent(PRIOR_S)
        self._network: Recent[float] = Recent(NETWORK_S)

    def reset(self) -> None:
        """Forget the earlier frames."""
        self._prior.clear()
        self._network.clear()

    def update(self, stamp: float, prior_cost: float, network_distance: float) -> float:
        """Return the probability, NaN without a network.

        stamp: s. prior_cost: of the pose prior for the solved state. network_distance: m, mean distance of the joints,
        relative to the hips; NaN for a frame without the network's pose.
        """
        self._prior.add(stamp, math.log(max(prior_cost, SMALLEST)))
        self._network.forget_before(stamp)
        if math.isfinite(network_distance):
            self._network.add(stamp, network_distance)
        distances, costs = self._network.values, self._prior.values
        if not distances:
            return math.nan
        prior = (sum(costs) / len(costs) - PRIOR_MEAN) / PRIOR_SPREAD
        network = (math.log(max(max(distances), SMALLEST)) - NETWORK_MEAN) / NETWORK_SPREAD
        return 1 / (1 + math.exp(-OFFSET - BY_PRIOR * prior - BY_NETWORK * network))
