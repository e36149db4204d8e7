"""Keypoints in std_msgs/Float32MultiArray: N x 3, row i is landmark i: x, y in px, confidence. There is no stamp."""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import MAX_POINTS, Keypoints, check_count


class Float32MultiArrayAdapter:
    """Reads an array of keypoints. The layout may be empty; otherwise it must match the data."""

    def decode(self, message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
        """See KeypointAdapter.decode."""
        offset, size = message.layout.data_offset, len(message.data)
        check_count(min(size // 3, MAX_POINTS + 1))
        rows = (size - offset) // 3
        if offset > size or (size - offset) % 3 or not _fits(message.layout.dim, rows):
            shape = " x ".join(str(d.size) for d in message.layout.dim[:8]) or "none"
            raise AdapterError(
                "wrong_shape", f"{size} values, data_offset {offset}, dimensions {shape}; expected N x 3 values"
            )
        with np.errstate(invalid="ignore"):  # a NaN may be signalling
            values = np.asarray(message.data, dtype=float)[offset:].reshape(rows, 3)
        return Keypoints(None, "", np.arange(rows), values[:, :2], values[:, 2])


def _fits(dimensions: Any, rows: int) -> bool:
    """Return True if the layout is empty, (rows, 3), or one dimension of 3 rows."""
    sizes = [d.size for d in dimensions[:3]]
    return sizes in ([], [rows, 3], [3 * rows])
