"""Huber's loss on a landmark's reprojection error, in standard deviations."""

from __future__ import annotations

import numpy as np

THRESHOLD = 3.0
"""Standard deviations beyond which an error counts linearly."""


def huber_weights(size: np.ndarray, threshold: float = THRESHOLD) -> np.ndarray:
    """Factor on the squared error that makes least squares minimise Huber's loss, in (0, 1]."""
    return np.minimum(1.0, threshold / np.maximum(size, threshold))


def huber_cost(size: np.ndarray, threshold: float = THRESHOLD) -> np.ndarray:
    """1/2 e^2 up to the threshold t, t (e - t/2) beyond."""
    inside = np.minimum(size, threshold)
    return inside * (size - 0.5 * inside)
