"""Offset between the clocks of cameras that see one person. Neither poses nor lenses are needed.

Points x and y of two cameras at one instant satisfy y^T F x = 0 with one fundamental matrix F. The smallest eigenvalue
of the mean of k k^T, k = kron(y, x), is the mean square residual of the best F (Longuet-Higgins' eight-point method).
It is computed for each offset: the entries of k k^T are correlations of monomials of x and y, which the FFT gives for
all offsets at once. Their sums add over time, so that blocks of it are resampled (bootstrap) for the deviation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from lassokin_ros.core.rig.tracks import STEP_S, Track

THINNED = 2
"""Every second time of the grid is used."""
GRID_S = THINNED * STEP_S
SHORTEST_BLOCK_S, MOST_BLOCKS = 0.5, 40
"""s: shortest block of the bootstrap; largest number of blocks."""
RESAMPLED = 30
"""Number of resamples."""
LEAST_OVERLAP_S = 1.0
"""s that both cameras must see in common, with 0.4 of the landmarks."""
LONGEST_S = 60.0
"""s of a track that are used at most."""
SEARCHED_S = 20.0
"""s: largest offset that is looked for between files."""
SAME_PEAK_S, LEAST_SHARE, LARGEST_DEVIATION_S = 0.1, 0.9, 0.02
"""An offset is sure if so large a share of the resamples is within so many s, and has a smaller deviation, s."""
CORRELATED = 1.2
"""Factor on the bootstrap's deviation: a detector's errors last longer than a block. Chosen on validation people."""
OWN_DEVIATION_S = 0.003
"""s: added to the bootstrap's deviation, in squares: the grid's error, and a detector's errors that last as long as the
track. Chosen on validation people, so that 98 % are within 1.96 deviations in benchmarks/videos/synchrony.py."""
RESIDUAL_FLOOR = 1e-5
"""Mean square residual of noise that cannot be undercut, in units of the spread of the points."""
CLOSURE_S = 0.02
"""s by which the offsets of three cameras may miss their sum, beyond their deviations."""

MONOMIALS = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
_INDEX = np.zeros((3, 3), int)
for _number, (_i, _j) in enumerate(MONOMIALS):
    _INDEX[_i, _j] = _INDEX[_j, _i] = _number
_OF_X = _INDEX[np.ix_(np.arange(9) % 3, np.arange(9) % 3)]
_OF_Y = _INDEX[np.ix_(np.arange(9) // 3, np.arange(9) // 3)]


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
        return self.share >= LEAST_SHARE and self.deviation < LARGEST_DEVIATION_S


UNKNOWN = Offset(0.0, np.inf, 0.0, np.inf)


def offset_between(first: Track, second: Track, searched: float = SEARCHED_S) -> Offset:
    """Return the offset of the clocks of two cameras by one person's keypoints.

    searched: s, the largest absolute value. The begins of the tracks are on the two clocks.
    """
    end = max(first.begin, second.begin) + LONGEST_S
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
    counts = np.random.default_rng(0).multinomial(len(sums), np.full(len(sums), 1 / len(sums)), RESAMPLED)
    weights = np.vstack([np.ones(len(sums)), counts])
    least = 0.4 * LEAST_OVERLAP_S / GRID_S * a.shape[1]
    peaks, residual = [], np.inf
    for number, weight in enumerate(weights):
        costs, rows = _residuals(np.tensordot(weight, sums, 1))
        enough = rows > least
        if not enough.any():
            return UNKNOWN
        best = int(np.argmax(scores := _scores(costs, rows, enough)))
        residual = float(costs[best]) if number == 0 else residual
        peaks.append(offsets[best] + GRID_S * _vertex(scores, best))
    apart = np.abs(np.array(peaks[1:]) - peaks[0]) < SAME_PEAK_S
    deviation = np.inf
    if np.count_nonzero(apart) > 3:
        deviation = math.hypot(CORRELATED * float(np.std(np.array(peaks[1:])[apart])), OWN_DEVIATION_S)
    return Offset(float(peaks[0]), deviation, float(apart.mean()), residual)


def _homogeneous(track: Track) -> np.ndarray | None:
    """Return the points (f, l, 3) of the thinned track, centred, scaled and with a 1; zeros where unknown."""
    points, known = track.points[::THINNED], track.known[::THINNED]
    if np.count_nonzero(known) < 20:
        return None
    centred = points - points[known].mean(axis=0)
    spread = np.sqrt((centred[known] ** 2).sum(-1).mean() / 2)
    if not spread > 0:
        return None
    return np.concatenate([centred / spread, np.ones((*known.shape, 1))], -1) * known[..., None]


def _sums(a: np.ndarray, b: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Return the sums (blocks, 6, 6, s), over a block's times and all landmarks, of the monomials of a(k), b(k + s)."""
    blocks = int(np.clip(len(a) * GRID_S / SHORTEST_BLOCK_S, 1, MOST_BLOCKS))
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
    rows = np.maximum(sums[5, 5], 1e-9)
    moments = (sums[_OF_X, _OF_Y] / rows).transpose(2, 0, 1)
    return np.maximum(np.linalg.eigvalsh(moments)[:, 0], 0.0), rows


def _scores(costs: np.ndarray, rows: np.ndarray, enough: np.ndarray) -> np.ndarray:
    """Return the logarithm (s,) of the likelihood of each offset, against that of a usual one."""
    usual = float(np.median(costs[enough])) + RESIDUAL_FLOOR
    return np.where(enough, 0.5 * rows * (np.log(usual) - np.log(costs + RESIDUAL_FLOOR)), -np.inf)


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
            (i, j): abs(offsets[j] - offsets[i] - one.seconds) / (3 * one.deviation + CLOSURE_S)
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
