"""Gating of measured depths: select those that can belong to the body."""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.observation import Observation

DEPTH_RANGE = 0.05, 100.0
"""m: a depth outside this range is ignored."""
HIDDEN = 0.03
"""Distance / height from the nearest surface of the body to a landmark's own surface from which the landmark is hidden
by another part of the body."""
THINNEST = 0.5
"""The distance from the surface to the landmark may be less than `surface` by at most this share of it."""
SAME_SURFACE = 0.12
"""m: a depth this near to the body's nearest surface is that of this surface."""


def of_own_surface(
    depth: np.ndarray, landmarks: np.ndarray, nearest: np.ndarray, surface: np.ndarray, height: float
) -> np.ndarray:
    """Depths (l,) m of a camera, corrected by the last pose, so that `surface` is the distance to the landmarks.

    A landmark behind another part of the body was not measured: NaN. For the others the distance from the surface to
    the landmark along the line of sight, which is longer inside a limb that leans, is that of the last pose, within
    limits. A depth in front of the nearest surface, or behind it, is kept: there the last pose is wrong.

    landmarks: (l,) m, depths of the last pose's landmarks. nearest: (l,) m, where the line of sight meets the last
    pose's body. surface: m, as in `gate_depth`; height: m, of the person.
    """
    more = landmarks - nearest - surface
    with np.errstate(invalid="ignore"):
        met = np.abs(depth - nearest) < SAME_SURFACE
    corrected = depth + np.clip(more, -THINNEST * surface, HIDDEN * height)
    return np.where(met, np.where(more > HIDDEN * height, np.nan, corrected), depth)


def gate_depth(
    observation: Observation,
    visible: np.ndarray,
    surface: np.ndarray | float,
    expected: float | None,
    reach: float,
    noise: float,
) -> tuple[np.ndarray, np.ndarray] | None:
    """(depth, weights) of an observation, each (l,), or None if no depth can be used.

    visible: (l,) bool, landmarks whose keypoints are used. surface: (l,) m from the body's surface to the landmark.
    expected: m, depth of the person; None for the median of the measurements. reach: m, measurements farther from the
    person are ignored. noise: m, standard deviation unless the observation gives it. weights: 1/m, 0 = not used.
    """
    if observation.depth is None or not math.isfinite(observation.depth_age):
        return None
    depth = np.asarray(observation.depth, dtype=float)
    if observation.depth_of_surface:
        depth = depth + surface
    given = observation.depth_deviation
    deviation = np.full(depth.shape, noise) if given is None else np.asarray(given, dtype=float)
    with np.errstate(invalid="ignore"):
        used = visible & (depth > DEPTH_RANGE[0]) & (depth < DEPTH_RANGE[1]) & (deviation > 0) & (deviation < 10.0)
    if not used.any():
        return None
    centre = float(np.median(depth[used])) if expected is None else expected
    used &= np.abs(np.where(used, depth, centre) - centre) < reach
    if not used.any():
        return None
    deviation = np.maximum(np.where(used, deviation, 1.0), 0.005)  # a surface is not known more exactly
    weights = np.where(used, 1 / deviation, 0.0)
    return np.where(used, depth, 0.0), weights
