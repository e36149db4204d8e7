"""The clocks of cameras that see one person: offsets, images that were lost without a trace, and clocks that drift.

Neither poses nor lenses are needed. Points x and y of two cameras at one instant satisfy y^T F x = 0 with one
fundamental matrix F. The smallest eigenvalue of the mean of k k^T, k = kron(y, x), is the mean square residual of the
best F (Longuet-Higgins' eight-point method). It is computed for each offset: the entries of k k^T are correlations of
monomials of x and y, which the FFT gives for all offsets at once. Their sums add over time, so that blocks of it are
resampled (bootstrap) for the deviation. The keypoints of each camera are first put on a regular grid of times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

STEP_S = 1 / 60
"""s between two times of the grid."""


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
    """Return the track by local lines with Gaussian weights; None for fewer than two frames.

    stamps: (n,) s, rising. points: (n, l, 2). known: (n, l).
    """
    if len(stamps) < 2:
        return None
    deviation = float(np.clip(0.7 * np.median(np.diff(stamps)), 0.035, 0.12))  # s, of the weights
    times = np.arange(stamps[0], stamps[-1] + 1e-9, STEP_S)
    flat = np.where(known[..., None], points, 0.0).reshape(len(stamps), -1)
    weights = known.astype(float)
    # In parts, so that memory does not grow with the square of the duration.
    parts = [_lines(times[i : i + 512], stamps, flat, weights, deviation) for i in range(0, len(times), 512)]
    values, found = (np.concatenate(part) for part in zip(*parts))
    return Track(float(times[0]), np.where(found[..., None], values, 0.0), found)


def _lines(
    times: np.ndarray, stamps: np.ndarray, flat: np.ndarray, weights: np.ndarray, deviation: float
) -> tuple[np.ndarray, ...]:
    """Return the values (t, l, 2) of the lines at the times (t,), and whether they are known (t, l)."""
    reach = 4 * deviation
    inside = slice(*np.searchsorted(stamps, [times[0] - reach, times[-1] + reach]))
    stamps, flat, weights = stamps[inside], flat[inside], weights[inside]
    apart = stamps - times[:, None]
    kernel = np.exp(-0.5 * (apart / deviation) ** 2) * (np.abs(apart) < reach)
    moments = [(kernel * apart**power) @ weights for power in range(3)]
    level, slope = kernel @ flat, (kernel * apart) @ flat
    spread = moments[0] * moments[2] - moments[1] ** 2
    known = (spread > 0.3 * (moments[0] * deviation) ** 2) & (moments[0] > 0.8)  # otherwise it would be extrapolated
    shape = (*weights.shape, 2)[1:]
    level, slope = level.reshape(len(times), *shape), slope.reshape(len(times), *shape)
    divisor = np.where(known, spread, 1.0)[..., None]
    return (moments[2][..., None] * level - moments[1][..., None] * slope) / divisor, known


GRID_S = 2 * STEP_S
"""s: every second time of the grid is used."""
SEARCHED_S = 20.0
"""s: largest offset that is looked for between files."""
MONOMIALS = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


@dataclass(frozen=True)
class Offset:
    """What the second camera's clock shows at an instant, minus what the first one's shows, s.

    deviation: s, infinite if it is not known. share: of the resamples that agree. residual: mean square; the smaller,
    the better the two see one person.
    """

    seconds: float
    deviation: float
    share: float
    residual: float

    @property
    def is_sure(self) -> bool:
        """Whether the keypoints determine the offset."""
        return self.share >= 0.9 and self.deviation < 0.02  # s


UNKNOWN = Offset(0.0, np.inf, 0.0, np.inf)


def offset_between(first: Track, second: Track, searched: float = SEARCHED_S) -> Offset:
    """Return the offset of the clocks of two cameras by one person's keypoints.

    searched: s, the largest absolute value. The begins of the tracks are on the two clocks.
    """
    end = max(first.begin, second.begin) + 60  # s, the longest part that is used
    first, second = (track.between(track.begin, end) for track in (first, second))
    a, b = _homogeneous(first), _homogeneous(second)
    if a is None or b is None:
        return UNKNOWN
    begin = second.begin - first.begin
    shifts = np.arange(-(len(a) - 1), len(b))
    offsets = shifts * GRID_S + begin
    inside = np.abs(offsets) <= searched
    if not inside.any():
        return UNKNOWN
    shifts, offsets = shifts[inside], offsets[inside]
    sums = _sums(a, b, shifts)
    counts = np.random.default_rng(0).multinomial(len(sums), np.full(len(sums), 1 / len(sums)), 30)
    weights = np.vstack([np.ones(len(sums)), counts])
    least = 0.4 / GRID_S * a.shape[1]  # both see 0.4 of the landmarks for 1 s
    peaks, residual = [], np.inf
    for number, weight in enumerate(weights):
        costs, rows = _residuals(np.tensordot(weight, sums, 1))
        enough = rows > least
        if not enough.any():
            return UNKNOWN
        usual = float(np.median(costs[enough]))
        # Log-likelihood of each offset against that of a usual one; noise cannot undercut a residual of 1e-5.
        scores = np.where(enough, 0.5 * rows * (np.log(usual + 1e-5) - np.log(costs + 1e-5)), -np.inf)
        best = int(np.argmax(scores))
        residual = float(costs[best]) if number == 0 else residual
        peaks.append(offsets[best] + GRID_S * _vertex(scores, best))
    apart = np.abs(np.array(peaks[1:]) - peaks[0]) < 0.1  # s
    deviation = np.inf
    if np.count_nonzero(apart) > 3:
        # A detector's errors last longer than a block, or as long as the track. Both numbers are chosen on validation
        # people, so that 98 % are within 1.96 deviations in benchmarks/videos/synchrony.py.
        deviation = math.hypot(1.2 * float(np.std(np.array(peaks[1:])[apart])), 0.003)
    return Offset(float(peaks[0]), deviation, float(apart.mean()), residual)


def _homogeneous(track: Track) -> np.ndarray | None:
    """Return the points (f, l, 3) of the thinned track, centred, scaled and with a 1; zeros where unknown."""
    points, known = track.points[::2], track.known[::2]
    if np.count_nonzero(known) < 20:
        return None
    centred = points - points[known].mean(axis=0)
    spread = np.sqrt((centred[known] ** 2).sum(-1).mean() / 2)
    if not spread > 0:
        return None
    return np.concatenate([centred / spread, np.ones((*known.shape, 1))], -1) * known[..., None]


def _sums(a: np.ndarray, b: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Return the sums (blocks, 6, 6, s), over a block's times and all landmarks, of the monomials of a(k), b(k + s)."""
    blocks = int(np.clip(len(a) * GRID_S / 0.5, 1, 40))  # of 0.5 s or more
    edges = np.linspace(0, len(a), blocks + 1).round().astype(int)
    length, most = int(np.diff(edges).max()), len(shifts)
    before, after = max(-int(shifts[0]), 0), max(int(shifts[-1]) + length, 0)
    products = [np.stack([x[..., i] * x[..., j] for i, j in MONOMIALS]) for x in (a, b)]
    padded = np.pad(products[1], ((0, 0), (before, after), (0, 0)))
    size = 1 << (length + most - 1).bit_length()
    sums = np.empty((blocks, 6, 6, most))
    for number, (low, high) in enumerate(zip(edges, edges[1:])):
        start = low + int(shifts[0]) + before
        of_a = np.fft.rfft(products[0][:, low:high], size, axis=1).conj()
        of_b = np.fft.rfft(padded[:, start : start + length + most], size, axis=1)
        spectra = of_a.transpose(1, 0, 2) @ of_b.transpose(1, 2, 0)
        sums[number] = np.fft.irfft(spectra, size, axis=0)[:most].transpose(1, 2, 0)
    return sums


def _residuals(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean square residual (s,) of the best fundamental matrix, and the number of rows (s,)."""
    rows, index = np.maximum(sums[5, 5], 1e-9), np.zeros((3, 3), int)
    for number, (i, j) in enumerate(MONOMIALS):
        index[i, j] = index[j, i] = number
    of_x, of_y = (index[np.ix_(which, which)] for which in (np.arange(9) % 3, np.arange(9) // 3))
    moments = (sums[of_x, of_y] / rows).transpose(2, 0, 1)
    return np.maximum(np.linalg.eigvalsh(moments)[:, 0], 0.0), rows


def _vertex(scores: np.ndarray, best: int) -> float:
    """Return the place of the maximum between its neighbours, by a parabola, in steps from -0.5 to 0.5."""
    if not 0 < best < len(scores) - 1 or not np.isfinite(scores[best - 1 : best + 2]).all():
        return 0.0
    before, at, after = scores[best - 1 : best + 2]
    curvature = before - 2 * at + after
    return float(np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)) if curvature < 0 else 0.0


def offsets_of(people: Sequence[Sequence[Track]], searched: float = SEARCHED_S) -> list[Offset]:
    """Return the offset of each of c cameras to the first one, see `Offset`; `UNKNOWN` where it cannot be determined.

    people: the tracks of the people in each camera. They are paired by the smallest residual. The offsets of the pairs
    are combined by least squares; a pair that contradicts the others is left out.
    """
    pairs: dict[tuple[int, int], Offset] = {}
    for i, j in combinations(range(len(people)), 2):
        found = [offset_between(one, other, searched) for one in people[i] for other in people[j]]
        pairs[i, j] = min((one for one in found if one.is_sure), key=lambda one: one.residual, default=UNKNOWN)
    sure = {pair: offset for pair, offset in pairs.items() if offset.is_sure}
    while True:
        offsets, deviations = _combined(len(people), sure)
        missing = {
            (i, j): abs(offsets[j] - offsets[i] - one.seconds) / (3 * one.deviation + 0.02)  # s, beyond the deviations
            for (i, j), one in sure.items()
        }
        if not missing or max(missing.values()) < 1:
            break
        del sure[max(missing, key=missing.__getitem__)]
    share = min((one.share for one in sure.values()), default=0.0)
    return [
        Offset(float(seconds), float(deviation), share, 0.0) if np.isfinite(deviation) else UNKNOWN
        for seconds, deviation in zip(offsets, deviations)
    ]


def _combined(count: int, sure: dict[tuple[int, int], Offset]) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets and deviations (c,) s by weighted least squares, infinite if nothing connects one to the first."""
    reached, before = {0}, -1
    while len(reached) != before:
        before = len(reached)
        reached |= {one for pair in sure if reached & set(pair) for one in pair}
    others = sorted(reached - {0})
    H, g = np.zeros((count, count)), np.zeros(count)
    for (i, j), offset in sure.items():
        row = np.zeros(count)
        row[[i, j]] = -1, 1
        H += np.outer(row, row) / offset.deviation**2
        g += row * offset.seconds / offset.deviation**2
    offsets, deviations = np.zeros(count), np.full(count, np.inf)
    deviations[0] = 0.0
    if others:
        covariance = np.linalg.inv(H[np.ix_(others, others)])
        offsets[others], deviations[others] = covariance @ g[others], np.sqrt(np.diag(covariance))
    return offsets, deviations


WINDOW_S = 3.0
"""s: duration of a part with an offset of its own. The parts begin 1 s apart."""


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
    for begin in np.arange(aligned.begin, end - WINDOW_S / 2, 1.0):
        own = offset_between(first, aligned.between(begin, begin + WINDOW_S), 1.5)
        if own.share >= 0.8 and own.deviation < 0.03:  # one by one they need not be sure
            found.append((begin + WINDOW_S / 2, own.seconds, own.deviation))
    constant = Course(np.zeros(1), np.array([offset.seconds]))
    if len(found) < 5:
        return constant
    times, local, deviations = np.array(found).T
    times = times + offset.seconds
    weights = 1 / np.hypot(deviations, 0.004)
    flat = _misfit(local, weights, np.ones((len(local), 1)))
    slope, drifting = _line(times, local, weights)
    stepping, place = min((_misfit_of_step(local, weights, k), k) for k in range(2, len(local) - 1))
    step = float(np.median(local[place:]) - np.median(local[:place]))
    if abs(step) > 0.025 and stepping < 0.5 * flat and stepping < 0.8 * drifting:
        before, after = (offset.seconds + float(np.median(part)) for part in (local[:place], local[place:]))
        at = 0.5 * (times[place - 1] + times[place])
        return Course(np.array([at - 1e-3, at + 1e-3]), np.array([before, after]), [(float(at), -step)])
    if abs(slope) * np.ptp(times) > 0.03 and drifting < 0.5 * flat:
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
