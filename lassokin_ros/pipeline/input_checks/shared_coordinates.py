"""Keypoints of one person that share exactly one x or one y: placeholders in one coordinate, such as y = -10.

Measured positions agree in one coordinate only where a detector rounds them: to whole pixels, or to the cells of a
heat map. Then few keypoints agree by chance, and they are measurements.
"""

from __future__ import annotations

import numpy as np

FEWEST = 3
"""Keypoints that share a coordinate from which on they are placeholders, if the detector does not round, or outside of
the image."""
FEWEST_ROUNDED, MOST_OF = 5, 0.5
"""For rounded positions inside the image: the same number, and the share of the person's keypoints."""


def is_shared(xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(k,) bool: points of one person, (k, 2) px, with a coordinate that is a placeholder.

    size: (width, height) px of the image; 0 = unknown.
    """
    shared = np.zeros(len(xy), dtype=bool)
    for values, length in zip(xy.T, size):
        shared |= _shared(values, length)
    return shared


def _shared(values: np.ndarray, length: int) -> np.ndarray:
    """(k,) bool: the coordinates (k,) that are placeholders. length: px of the image's side; 0 = unknown."""
    shared = np.zeros(len(values), dtype=bool)
    different, counts = np.unique(values, return_counts=True)
    for value in different[counts >= FEWEST]:
        same = values == value
        outside = value < 0 or 0 < length < value
        if outside or _are_most(same) or not _rounded(values[~same]):
            shared |= same
    return shared


def _are_most(same: np.ndarray) -> bool:
    """Return True if so many of the points (k,) share a coordinate that rounding does not explain it."""
    count = np.count_nonzero(same)
    return bool(count == len(same) or count >= max(FEWEST_ROUNDED, MOST_OF * len(same)))


def _rounded(values: np.ndarray) -> bool:
    """Return True if a detector may have rounded the coordinates: some agree, or all are whole numbers."""
    return len(np.unique(values)) < len(values) or bool(np.array_equal(values, np.round(values)))
