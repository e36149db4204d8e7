"""The reason why the tracker did not use a frame, in words with the frame's numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.gating import FOCAL_RANGE, visible
from lassokin_ros.core.lasso.solver import KKT_TOLERANCE
from lassokin_ros.core.observation import Observation, Rejection
from lassokin_ros.core.tracker import SMALLEST_PX


def rejection_text(answer: Estimate, observation: Observation, config: TrackerConfig) -> str:
    """One line about a rejected observation: what was wrong, what was expected, what to do."""
    assert answer.rejection is not None
    return _WORDS[answer.rejection](answer, observation, config)


def frozen_text(seconds: float, config: TrackerConfig) -> str:
    """One line about keypoints that have been the same for this time, s."""
    return (
        f"the same keypoints for {seconds:.1f} s, with new stamps; expected new ones within lost_after "
        f"{config.lost_after:g} s: check that the camera's image changes and reaches the detector"
    )


def _too_few_landmarks(_: Estimate, observation: Observation, config: TrackerConfig) -> str:
    seen = visible(observation, config)
    count, expected = np.count_nonzero(seen), f"expected {config.min_landmarks} or more (min_landmarks)"
    found = f"{count} landmark{'' if count == 1 else 's'} at or above min_confidence {config.min_confidence:g}"
    if count >= config.min_landmarks:
        return f"{found}, but some of them are far from their tracks; {expected} near them"
    confident = observation.confidence >= max(config.min_confidence, 1e-9)
    aside = np.count_nonzero(confident & np.isfinite(observation.points).all(axis=1) & ~seen)
    if aside:
        return f"{found}, and {aside} outside any field of view; {expected}: check that camera_info is of this camera"
    return f"{found}; {expected}"


def _too_small(_: Estimate, observation: Observation, config: TrackerConfig) -> str:
    return (
        "the body that fits best would be smaller than the noise, or behind the camera; expected "
        f"{SMALLEST_PX * config.noise_px:g} px ({SMALLEST_PX:g} noise_px) or more: check that the keypoints are in px, "
        "and that camera_info is of their camera"
    )


def _not_certified(answer: Estimate, observation: Observation, config: TrackerConfig) -> str:
    residual = float("nan") if answer.certificate is None else answer.certificate.kkt_residual
    return (
        f"the optimum was not proved, its KKT residual is {residual:.1e}; expected {KKT_TOLERANCE:g} or less: try "
        "solver proxqp"
    )


def _late(_: Estimate, observation: Observation, config: TrackerConfig) -> str:
    return (
        f"the image of {observation.stamp:.3f} s is not newer than the last one used, of another camera; expected "
        "images in the order of their stamps: it only updated the tracks of its keypoints"
    )


def _unplaced(_: Estimate, observation: Observation, config: TrackerConfig) -> str:
    return (
        f"nobody has told where camera '{observation.camera.name}' is; expected its pose, or extrinsics learn and a "
        "person whom it and a camera with a pose see for some seconds"
    )


def _old_stamp(_: Estimate, observation: Observation, config: TrackerConfig) -> str:
    return "the stamp is not newer than the last one; expected a newer one: check for two detectors on one topic"


def _not_finite(_: Estimate, observation: Observation, config: TrackerConfig) -> str:
    low, high = FOCAL_RANGE
    return (
        f"the stamp is {observation.stamp:g} s, the focal length {observation.focal:g} px; expected a time in "
        f"s and {low:g} to {high:g} px: check the stamp and K of camera_info"
    )


def _wrong_shape(_: Estimate, observation: Observation, config: TrackerConfig) -> str:
    arrays = {
        "points": observation.points,
        "confidence": observation.confidence,
        "depth": observation.depth,
        "depth_deviation": observation.depth_deviation,
    }
    shapes = ", ".join(f"{name} {np.shape(values)}" for name, values in arrays.items() if values is not None)
    return f"{shapes}; expected one of each for every landmark of the layout '{config.landmarks}'"


_WORDS: dict[Rejection, Callable[[Estimate, Observation, TrackerConfig], str]] = {
    Rejection.TOO_FEW_LANDMARKS: _too_few_landmarks,
    Rejection.TOO_SMALL: _too_small,
    Rejection.NOT_CERTIFIED: _not_certified,
    Rejection.OLD_STAMP: _old_stamp,
    Rejection.LATE: _late,
    Rejection.UNPLACED: _unplaced,
    Rejection.NOT_FINITE: _not_finite,
    Rejection.WRONG_SHAPE: _wrong_shape,
}
