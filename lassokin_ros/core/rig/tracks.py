"""One person's keypoints in one camera, on a regular grid of times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STEP_S = 1 / 60
"""s between two times of the grid."""
KERNEL_S, KERNEL_PERIODS, LONGEST_KERNEL_S = 0.035, 0.7, 0.12
"""s: standard deviation of the Gaussian weights of the local line; in periods of a slow camera; and at most, s."""
REACH = 4.0
"""Standard deviations of the kernel at which its weights end."""
AT_ONCE = 512
"""Times of the grid that are computed at once, so that memory does not grow with the square of the duration."""
LEAST_SPREAD, LEAST_WEIGHT = 0.3, 0.8
"""Least spread of the times under the kernel, of its square, and least sum of weights: there is no extrapolation."""


@dataclass(frozen=True, eq=False)
class Track:
    """begin: s, of the first of f times. points: (f, l, 2), 0 where unknown. known: (f, l)."""

    begin: float
    points: np.ndarray
    known: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def between(self, begin: float, end: float) -> Track:
        """Return the part between two times, s."""
        first, last = (int(np.clip(round((at - self.begin) / STEP_S), 0, len(self))) for at in (begin, end))
        return Track(self.begin + first * STEP_S, self.points[first:last], self.known[first:last])

    def at(self, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return points (k, l, 2) and known (k, l) at the times of the grid that are nearest to the given ones, s."""
        index = np.round((seconds - self.begin) / STEP_S).astype(int)
        inside = (index >= 0) & (index < len(self))
        index = np.clip(index, 0, len(self) - 1)
        return self.points[index], self.known[index] & inside[:, None]


def track_of(stamps: np.ndarray, points: np.ndarray, known: np.ndarray) -> Track | None:
    """Return the track by kernel-weighted local lines; None for fewer than two frames.

    stamps: (n,) s, rising. points: (n, l, 2). known: (n, l).
    """
    if len(stamps) < 2:
        return None
    kernel = float(np.clip(KERNEL_PERIODS * np.median(np.diff(stamps)), KERNEL_S, LONGEST_KERNEL_S))
    times = np.arange(stamps[0], stamps[-1] + 1e-9, STEP_S)
    flat = np.where(known[..., None], points, 0.0).reshape(len(stamps), -1)
    weights = known.astype(float)
    parts = [_lines(times[i : i + AT_ONCE], stamps, flat, weights, kernel) for i in range(0, len(times), AT_ONCE)]
    values, found = (np.concatenate(part) for part in zip(*parts))
    return Track(float(times[0]), np.where(found[..., None], values, 0.0), found)


def _lines(
    times: np.ndarray, stamps: np.ndarray, flat: np.ndarray, weights: np.ndarray, deviation: float
) -> tuple[np.ndarray, ...]:
    """Return the values (t, l, 2) of the lines at the times (t,), and whether they are known (t, l).

    deviation: s, of the kernel.
    """
    reach = REACH * deviation
    inside = slice(*np.searchsorted(stamps, [times[0] - reach, times[-1] + reach]))
    stamps, flat, weights = stamps[inside], flat[inside], weights[inside]
    apart = stamps - times[:, None]
    kernel = np.exp(-0.5 * (apart / deviation) ** 2) * (np.abs(apart) < reach)
    moments = [(kernel * apart**power) @ weights for power in range(3)]
    level, slope = kernel @ flat, (kernel * apart) @ flat
    spread = moments[0] * moments[2] - moments[1] ** 2
    known = (spread > LEAST_SPREAD * (moments[0] * deviation) ** 2) & (moments[0] > LEAST_WEIGHT)
    shape = (*weights.shape, 2)[1:]
    level, slope = level.reshape(len(times), *shape), slope.reshape(len(times), *shape)
    divisor = np.where(known, spread, 1.0)[..., None]
    return (moments[2][..., None] * level - moments[1][..., None] * slope) / divisor, known
