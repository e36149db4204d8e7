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
LYING = np.cos(np.radians(45.0))
"""Cosine between trunk and vertical below which a person lies, kneels on the hands, or bridges."""
FLESH = {"wrist": 0.012, "hand": 0.01, "elbow": 0.02, "knee": 0.03, "shoulder": 0.04, "neck": 0.04, "head": 0.05}
FLESH |= {"hip": 0.05, "pelvis": 0.05, "spine": 0.06, "collar": 0.05}
"""Height of a joint above the floor on which it rests, as a fraction of the person's height."""


def floor_height(
    positions: np.ndarray,
    observed: np.ndarray,
    contacts: np.ndarray,
    names: Sequence[str],
    height: float,
    level: np.ndarray,
) -> float:
    """Return the floor's height above the camera, m; NaN if no foot is observed in half of the frames.

    It is the median height of the lowest foot while a foot stands still; of people who lie in most frames, or support
    themselves with the hands, that of what rests on the floor, whichever part of the body it is.

    positions: (f, n, 3) m, joints in the camera frame. observed: (f, n) bool. contacts: (f, n) bool, ankles of feet
    that stand still. names: of the joints. height: m, of the person. level: (3, 3) rotation from the camera frame to
    that of a level camera.
    """
    lying = _lying(positions, names, level)
    if len(lying) and lying.mean() > 0.5:
        flesh = np.array([FLESH.get(_part(name), SOLE) for name in names]) * height
        heights = np.where(observed, -(positions @ level[1]) - flesh, np.inf).min(axis=1)[lying]
        return float(np.median(heights[np.isfinite(heights)])) if np.isfinite(heights).any() else float("nan")
    feet = [i for i, name in enumerate(names) if name.endswith(FEET)]
    seen: np.ndarray = np.any(observed[:, feet], axis=1) if feet else np.zeros(len(observed), dtype=bool)
    if not len(seen) or seen.mean() < 0.5:
        return float("nan")
    lowest = -(positions[seen][:, feet] @ level[1]).max(axis=1)
    standing = contacts[seen].any(axis=1)
    enough = standing.mean() >= LEAST_STANDING
    found = np.median(lowest[standing]) if enough else np.percentile(lowest, STANDING_PERCENTILE)
    return float(found) - SOLE * height


def _lying(positions: np.ndarray, names: Sequence[str], level: np.ndarray) -> np.ndarray:
    """Return (f,) bool: the trunk is far from upright."""
    if not {"pelvis", "neck"} <= set(names):
        return np.zeros(len(positions), dtype=bool)
    trunk = positions[:, names.index("neck")] - positions[:, names.index("pelvis")]
    return np.asarray(-(trunk @ level[1]) < LYING * np.linalg.norm(trunk, axis=1))


def _part(name: str) -> str:
    """Return the part of the body: 'elbow' of left_elbow, 'spine' of spine2."""
    return name.removeprefix("left_").removeprefix("right_").rstrip("0123456789")
