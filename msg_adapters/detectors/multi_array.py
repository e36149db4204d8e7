"""Keypoints in std_msgs/Float32MultiArray or Float64MultiArray, without a stamp: x, y in px and confidence.

N x 3: row i is landmark i of one person. People x N x 3: one block for each person, without lasting numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import LARGEST_CONFIDENCE, MAX_POINTS, Keypoints, check_count

FEWEST = 4
"""Rows from which on the order of the values is examined."""


def decode(message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
    """Read an array of keypoints. A layout that is not empty must match the data. See KeypointAdapter.decode."""
    offset, size = message.layout.data_offset, len(message.data)
    check_count(min(size // 3, MAX_POINTS + 1))
    rows = (size - offset) // 3
    shape = [d.size for d in message.layout.dim[:8]]
    if offset > size or (size - offset) % 3 or not _fits(shape, rows):
        raise AdapterError(
            "wrong_shape",
            f"{size} values, data_offset {offset}, dimensions {' x '.join(map(str, shape)) or 'none'}; expected "
            "N x 3 values (x px, y px, confidence), or people x N x 3, in dimensions of these sizes or none",
        )
    with np.errstate(invalid="ignore"):  # a NaN may be signalling
        values = np.asarray(message.data, dtype=float)[offset:].reshape(rows, 3)
    if len(shape) < 2 and rows >= FEWEST and _is_planar(values):
        raise AdapterError(
            "wrong_shape",
            f"{size} values, of which the last third are confidences; expected x, y and confidence of each "
            "keypoint in turn, not all x, then all y, then all confidences",
        )
    number = np.arange(rows)
    if len(shape) != 3 or not rows:
        return Keypoints(None, "", number, values[:, :2], values[:, 2])
    person, landmark = np.divmod(number, shape[1])
    return Keypoints(None, "", landmark, values[:, :2], values[:, 2], person, persistent=False, landmarks=shape[1])


def _is_planar(values: np.ndarray) -> bool:
    """Return True if the values (n, 3) are those of n x, n y and n confidences, one after the other."""
    places, scores = np.split(values.ravel(), [2 * len(values)])
    with np.errstate(invalid="ignore"):
        are_scores = bool(((scores >= 0) & (scores <= 1)).all())
        large = [np.mean(part > LARGEST_CONFIDENCE) > 0.5 for part in (places, values[:, 2])]
    return are_scores and all(large)


def _fits(shape: list[int], rows: int) -> bool:
    """Return True if the layout is empty, (rows, 3), one dimension of 3 rows, or (people, N, 3) with `rows` in all."""
    if len(shape) == 3:
        return shape[0] * shape[1] == rows and shape[2] == 3
    return shape in ([], [rows, 3], [3 * rows])
