"""Huber's loss on a landmark's reprojection error, in standard deviations; and lengths of vectors."""

from __future__ import annotations

from functools import cache

import numpy as np

THRESHOLD = 3.0
"""Standard deviations beyond which an error counts linearly."""
MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a standard normal variable."""
CAP = 8.0
"""Standard deviations beyond which a point is an outlier without influence; used during initialisation."""


def squared_norm(errors: np.ndarray) -> np.ndarray:
    """Squared lengths (...) of vectors (..., d)."""
    if errors.ndim == 1:
        return np.asarray(errors.dot(errors))
    return np.asarray((errors * errors).dot(_ones(errors.shape[-1])))


@cache
def _ones(count: int) -> np.ndarray:
    """Cached ones. A product with them takes half the time of a sum here, if they are not created each time."""
    return np.ones(count)


def norm(errors: np.ndarray) -> np.ndarray:
    """Lengths (...) of vectors (..., d)."""
    return np.sqrt(squared_norm(errors))


def huber_weights(size: np.ndarray) -> np.ndarray:
    """Weights in (0, 1] on the squared errors with which least squares minimises Huber's loss (IRLS)."""
    return THRESHOLD / np.maximum(size, THRESHOLD)


def huber_cost(size: np.ndarray) -> np.ndarray:
    """Huber's loss: 1/2 e^2 up to t = `THRESHOLD`, t (e - t/2) beyond."""
    inside = np.minimum(size, THRESHOLD)
    return inside * (size - 0.5 * inside)


def capped_weights(size: np.ndarray) -> np.ndarray:
    """Huber's weights, 0 beyond `CAP`."""
    return np.where(size > CAP, 0.0, huber_weights(size))


def capped_cost(size: np.ndarray) -> np.ndarray:
    """Huber's loss, constant beyond `CAP`."""
    return huber_cost(np.minimum(size, CAP))
