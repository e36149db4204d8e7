"""The floor under a person's feet, for the report and for exports in a level world."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

STANDING_PERCENTILE = 20
"""Percentile of the lowest foot's height over time that is taken for the floor: people jump, and lie in few frames."""
SOLE = 0.012
"""Height of a foot joint above the floor, as a fraction of the person's height."""
FEET = ("_foot", "_ankle")


def floor_height(
    positions: np.ndarray, observed: np.ndarray, names: Sequence[str], height: float, level: np.ndarray
) -> float:
    """Return the floor's height above the camera, m; NaN if no foot is observed in half of the frames.

    positions: (f, n, 3) m, joints in the camera frame. observed: (f, n) bool. names: of the joints. height: m, of the
    person. level: (3, 3) rotation from the camera frame to that of a level camera.
    """
    feet = [i for i, name in enumerate(names) if name.endswith(FEET)]
    seen: np.ndarray = np.any(observed[:, feet], axis=1) if feet else np.zeros(len(observed), dtype=bool)
    if not len(seen) or seen.mean() < 0.5:
        return float("nan")
    lowest = -(positions[seen][:, feet] @ level[1]).max(axis=1)
    return float(np.percentile(lowest, STANDING_PERCENTILE)) - SOLE * height
