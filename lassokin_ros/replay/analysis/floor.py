"""The floor under a person's feet, for the report and for exports in a level world."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LEAST_STANDING = 0.1
"""Share of the frames in which a foot must stand still for these frames alone to give the floor."""
STANDING_PERCENTILE = 20
"""Otherwise, percentile of the lowest foot's height over time: people jump, and lie in few frames."""
SOLE = 0.012
"""Height of a foot joint above the floor, as a fraction of the person's height."""
FEET = ("_foot", "_ankle")


def floor_height(
    positions: np.ndarray,
    observed: np.ndarray,
    contacts: np.ndarray,
    names: Sequence[str],
    height: float,
    level: np.ndarray,
) -> float:
    """Return the floor's height above the camera, m; NaN if no foot is observed in half of the frames.

    It is the median height of the lowest foot while a foot stands still. positions: (f, n, 3) m, joints in the camera
    frame. observed: (f, n) bool. contacts: (f, n) bool, ankles of feet that stand still. names: of the joints. height:
    m, of the person. level: (3, 3) rotation from the camera frame to that of a level camera.
    """
    feet = [i for i, name in enumerate(names) if name.endswith(FEET)]
    seen: np.ndarray = np.any(observed[:, feet], axis=1) if feet else np.zeros(len(observed), dtype=bool)
    if not len(seen) or seen.mean() < 0.5:
        return float("nan")
    lowest = -(positions[seen][:, feet] @ level[1]).max(axis=1)
    standing = contacts[seen].any(axis=1)
    enough = standing.mean() >= LEAST_STANDING
    found = np.median(lowest[standing]) if enough else np.percentile(lowest, STANDING_PERCENTILE)
    return float(found) - SOLE * height
