"""Solve many small positive definite systems of one size at once, as the blocks of one band matrix (LAPACK).

For 12 systems of 6 unknowns this takes half the time of numpy's batched solve, which is mostly overhead.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.linalg import lapack


class BandSolver:
    """Solver for h systems of n unknowns."""

    @staticmethod
    @lru_cache(maxsize=32)
    def cached(h: int, n: int) -> BandSolver:
        """Return the solver for these numbers, created at the first call."""
        return BandSolver(h, n)

    def __init__(self, h: int, n: int) -> None:
        diagonal, column = np.arange(n), np.arange(h * n)[:, None]
        row = column + diagonal
        inside = row // n == column // n
        #: (h n, n): for each column of the band matrix, from the diagonal down, the index of the entry in (h, n, n).
        self._places = np.where(inside, row * n + column % n, 0)
        self._inside = inside.astype(float)

    def solve(self, H: np.ndarray, g: np.ndarray) -> np.ndarray:
        """The solutions x (..., n) of H x = g, for symmetric H (..., n, n) and g (..., n), h systems in total.

        Raises numpy.linalg.LinAlgError if a matrix is singular.
        """
        band = H.take(self._places)
        band *= self._inside
        _, solution, failed = lapack.dpbsv(band.T, g.reshape(-1), lower=1, overwrite_ab=1)
        if failed or not math.isfinite(solution.sum()):  # one bad system makes the other results invalid
            return np.linalg.solve(H, g[..., None])[..., 0]
        return np.asarray(solution).reshape(g.shape)
