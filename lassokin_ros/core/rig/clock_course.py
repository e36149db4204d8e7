"""How the offset of two clocks changes in a recording: images that were lost without a trace, and clocks that drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lassokin_ros.core.rig.offset import Offset, offset_between
from lassokin_ros.core.rig.tracks import Track

WINDOW_S, STEP_S = 3.0, 1.0
"""s: duration of a part with an offset of its own, and between two parts."""
SEARCHED_S = 1.5
"""s around the offset of the whole recording."""
LEAST_SHARE, LARGEST_DEVIATION_S = 0.8, 0.03
"""What the offset of a part must have to count; one by one they need not be sure."""
FEWEST_PARTS, BESIDE = 5, 2
"""Parts that count, in all, and on each side of a step."""
SMALLEST_STEP_S, SMALLEST_DRIFT_S = 0.025, 0.03
"""s: smallest step, and smallest change by a drift over the recording."""
CLEARLY = 3.0
"""Deviations from which a step or a drift is no chance."""


@dataclass(frozen=True, eq=False)
class Course:
    """An offset that changes. times: (k,) s of the second clock, rising; offsets: (k,) s at these times.

    lost: (s of the second clock, s) of each group of lost images. drift: relative difference of the rates.
    """

    times: np.ndarray
    offsets: np.ndarray
    lost: Sequence[tuple[float, float]] = ()
    drift: float = 0.0

    def at(self, seconds: np.ndarray) -> np.ndarray:
        """Return the offsets at times of the second clock, s."""
        return np.interp(seconds, self.times, self.offsets)


def course_of(first: Track, second: Track, offset: Offset) -> Course:
    """Return the course of the second clock around an offset that is sure."""
    aligned = replace(second, begin=second.begin - offset.seconds)
    end = aligned.begin + len(aligned) / 60
    found = []
    for begin in np.arange(aligned.begin, end - WINDOW_S / 2, STEP_S):
        own = offset_between(first, aligned.between(begin, begin + WINDOW_S), SEARCHED_S)
        if own.share >= LEAST_SHARE and own.deviation < LARGEST_DEVIATION_S:
            found.append((begin + WINDOW_S / 2, own.seconds, own.deviation))
    constant = Course(np.zeros(1), np.array([offset.seconds]))
    if len(found) < FEWEST_PARTS:
        return constant
    times, local, deviations = np.array(found).T
    times = times + offset.seconds
    weights = 1 / np.hypot(deviations, 0.004)
    flat = _misfit(local, weights, np.ones((len(local), 1)))
    slope, drifting = _line(times, local, weights)
    stepping, place = min((_misfit_of_step(local, weights, k), k) for k in range(BESIDE, len(local) - BESIDE + 1))
    step = float(np.median(local[place:]) - np.median(local[:place]))
    if abs(step) > SMALLEST_STEP_S and stepping < 0.5 * flat and stepping < 0.8 * drifting:
        before, after = (offset.seconds + float(np.median(part)) for part in (local[:place], local[place:]))
        at = 0.5 * (times[place - 1] + times[place])
        return Course(np.array([at - 1e-3, at + 1e-3]), np.array([before, after]), [(float(at), -step)])
    if abs(slope) * np.ptp(times) > SMALLEST_DRIFT_S and drifting < 0.5 * flat:
        middle = float(np.average(local - slope * times, weights=weights**2)) + offset.seconds
        ends = np.array([times[0] - 3600, times[-1] + 3600])
        return Course(ends, middle + slope * ends, drift=slope)
    return constant


def _misfit(values: np.ndarray, weights: np.ndarray, columns: np.ndarray) -> float:
    """Return the robust misfit of the best combination of columns (k, c) to values (k,)."""
    solution, *_ = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=None)
    return float(np.minimum(np.abs((values - columns @ solution) * weights), 5.0).mean())


def _misfit_of_step(values: np.ndarray, weights: np.ndarray, place: int) -> float:
    residuals = np.concatenate([part - np.median(part) for part in (values[:place], values[place:])])
    return float(np.minimum(np.abs(residuals * weights), 5.0).mean())


def _line(times: np.ndarray, values: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Return slope and misfit of a straight line."""
    columns = np.stack([np.ones(len(times)), times - times.mean()], axis=1)
    solution, *_ = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=None)
    return float(solution[1]), _misfit(values, weights, columns)
