"""The best assignment of detections to people, by SciPy's optimiser.

In a file of its own, since SciPy's optimisers take 12 MB and 70 ms to load: who follows one person needs none of it.
"""

from __future__ import annotations

from typing import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment


def assign(costs: np.ndarray, limits: Sequence[float]) -> list[tuple[int, int]]:
    """(row, column) pairs of the least total cost; costs: (rows, columns); a row takes no cost above its limit."""
    if costs.size == 0:
        return []
    allowed = costs <= np.asarray(limits, dtype=float)[:, None]
    rows, columns = linear_sum_assignment(np.where(allowed, costs, 1e3))
    return [(int(r), int(c)) for r, c in zip(rows, columns) if allowed[r, c]]
