"""Optimal assignment of detections to people, with scipy's solver."""

from __future__ import annotations

from typing import Sequence

import numpy as np

from lassokin_ros.core.scipy_functions import compiled_module

linear_sum_assignment = compiled_module("optimize", "_lsap", "optimize").linear_sum_assignment


def assign(costs: np.ndarray, limits: Sequence[float] | np.ndarray) -> list[tuple[int, int]]:
    """Return the (row, column) pairs of least total cost.

    costs: (rows, columns); limits: per row, the largest cost of a pair.
    """
    if costs.size == 0:
        return []
    allowed = costs <= np.asarray(limits, dtype=float)[:, None]
    rows, columns = linear_sum_assignment(np.where(allowed, costs, 1e3))
    return [(int(r), int(c)) for r, c in zip(rows, columns) if allowed[r, c]]
