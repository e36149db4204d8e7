"""Measurement gating: decide whether an observation can be used, and compute the weight of each landmark."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation, Rejection

FOCAL_RANGE = 1e-3, 1e9
"""px: a focal length outside this range is rejected, because the weights would lose digits."""
LATEST_STAMP = 1e11
"""s: no time is later, in the year 5138; one in ms, us or ns since 1970 is."""
WIDEST = 10.0
"""Largest normalised image coordinate of a usable point: 84 degrees off the optical axis."""


def gate_observation(
    observation: Observation, newest: float, layout: Layout, config: TrackerConfig
) -> tuple[Rejection | None, np.ndarray]:
    """The reason to reject an observation (or None), and the weights (l,): 1 / standard deviation, 0 = not used.

    newest: s, the observation's stamp must be later. Weights are in normalised image coordinates.
    """
    count = len(layout.names)
    none = np.zeros(count)
    if not _has_numbers(observation):
        return Rejection.NOT_FINITE, none
    if _is_empty(observation):
        return Rejection.TOO_FEW_LANDMARKS, none
    if not _fits(observation, count):
        return Rejection.WRONG_SHAPE, none
    if observation.stamp <= newest:
        return Rejection.OLD_STAMP, none
    usable = visible(observation, config)
    if np.count_nonzero(usable) < config.min_landmarks:
        return Rejection.TOO_FEW_LANDMARKS, none
    deviation = config.noise_px / observation.focal * layout.noise
    confidence = np.minimum(np.where(usable, observation.confidence, 0.0), 1.0)
    return None, np.sqrt(confidence) / deviation


def _has_numbers(observation: Observation) -> bool:
    """True if the stamp is a time in s and the focal length usable."""
    try:
        is_time = -LATEST_STAMP < observation.stamp < LATEST_STAMP
        return bool(is_time and FOCAL_RANGE[0] < observation.focal < FOCAL_RANGE[1])
    except (TypeError, ValueError):  # None, a text, two numbers
        return False


def _is_empty(observation: Observation) -> bool:
    """True if there is no point: detectors return arrays without values if nobody is in view."""
    arrays = observation.points, observation.confidence
    return all(isinstance(a, np.ndarray) and a.size == 0 for a in arrays)


def _fits(observation: Observation, count: int) -> bool:
    """True if all arrays of an observation are of real numbers and have one row per landmark; count: of these."""
    o, one_each = observation, (count,)
    arrays = [(o.points, (count, 2)), (o.confidence, one_each)]
    arrays += [(array, one_each) for array in (o.depth, o.depth_deviation) if array is not None]
    return all(isinstance(a, np.ndarray) and a.shape == shape and a.dtype.kind in "fiub" for a, shape in arrays)


def visible(observation: Observation, config: TrackerConfig) -> np.ndarray:
    """(l,) bool: landmarks with a usable point and enough confidence."""
    near = np.abs(observation.points) < WIDEST
    return near[:, 0] & near[:, 1] & (observation.confidence >= max(config.min_confidence, 1e-9))
