"""Seven lengths of a body, from joints or from landmarks at joints, and how two bodies differ in them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton

LENGTHS = ("thigh", "shank", "trunk", "hip width", "shoulder width", "upper arm", "forearm")
"""The trunk is from the middle of the hips to that of the shoulders."""
SIZED_BY = ("thigh", "shank", "trunk")
"""Lengths whose sum is a body's size."""
FEWEST = 0.1
"""Share of the frames in which a length must be known."""


def seven_lengths(place: Mapping[str, np.ndarray]) -> np.ndarray:
    """(7,) m, `LENGTHS`: medians over the frames, mean of left and right; NaN = unknown. place: joint -> (f, 3) m."""

    def bone(a: str, b: str) -> float:
        return float(np.mean([_median(place[f"{s}_{a}"] - place[f"{s}_{b}"]) for s in ("left", "right")]))

    def middle(joint: str) -> np.ndarray:
        return np.asarray(0.5 * (place[f"left_{joint}"] + place[f"right_{joint}"]))

    widths = [_median(place[f"left_{joint}"] - place[f"right_{joint}"]) for joint in ("hip", "shoulder")]
    trunk = _median(middle("shoulder") - middle("hip"))
    arms = [bone("shoulder", "elbow"), bone("elbow", "wrist")]
    return np.array([bone("hip", "knee"), bone("knee", "ankle"), trunk, *widths, *arms])


def skeleton_lengths(skeleton: Skeleton) -> np.ndarray:
    """(7,) m of a skeleton at rest."""
    return seven_lengths({name: skeleton.rest_positions[i][None] for i, name in enumerate(skeleton.joint_names)})


def landmark_lengths(landmarks: np.ndarray, layout: Layout) -> np.ndarray:
    """(7,) m of landmarks (f, l, 3) m, NaN = unknown."""
    return seven_lengths({name: landmarks[:, i].astype(float) for i, name in enumerate(layout.names)})


def log_ratios(lengths: np.ndarray, about: np.ndarray) -> np.ndarray:
    """(7,) log(lengths / about) at the same size, the sum of `SIZED_BY`; without these, at the size as given."""
    size = [LENGTHS.index(name) for name in SIZED_BY]
    scale = about[size].sum() / lengths[size].sum()
    return np.asarray(np.log(lengths / about * (scale if np.isfinite(scale) else 1.0)))


def rms_difference(lengths: np.ndarray, about: np.ndarray) -> float:
    """Root mean square of `log_ratios`; NaN if none is known."""
    ratios = log_ratios(lengths, about)
    return float(np.sqrt(np.nanmean(ratios**2))) if np.isfinite(ratios).any() else float("nan")


def _median(difference: np.ndarray) -> float:
    """m: median length of vectors (f, 3) that are known in a tenth of the frames, NaN otherwise."""
    length = np.linalg.norm(difference, axis=-1)
    known = np.isfinite(length)
    return float(np.median(length[known])) if known.mean() > FEWEST else float("nan")
