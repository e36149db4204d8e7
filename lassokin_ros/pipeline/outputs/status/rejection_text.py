"""The reason why the tracker did not use a frame, in words with the frame's numbers."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.gating import FOCAL_RANGE, visible
from lassokin_ros.core.lasso.solver import KKT_TOLERANCE
from lassokin_ros.core.observation import Observation, Rejection
from lassokin_ros.core.tracker import SMALLEST_PX
from lassokin_ros.pipeline.concerns.rejections import advice_for

FOUND = {
    Rejection.TOO_SMALL: "the body that fits best would be smaller than the noise, or behind the camera; expected "
    "{least_px:g} px ({SMALLEST_PX:g} noise_px) or more",
    Rejection.NOT_CERTIFIED: "the optimum was not proved, its KKT residual is {residual:.1e}; expected "
    "{KKT_TOLERANCE:g} or less",
    Rejection.LATE: "the image of {image.stamp:.3f} s is not newer than the last one used, of another camera; it only "
    "updated the tracks of its keypoints; expected images in the order of their stamps",
    Rejection.UNPLACED: "the pose of camera '{image.camera.name}' is unknown; expected one",
    Rejection.OLD_STAMP: "the stamp is not newer than the last one; expected a newer one",
    Rejection.NOT_FINITE: "the stamp is {image.stamp:g} s, the focal length {image.focal:g} px; expected finite "
    "numbers, and {FOCAL_RANGE[0]:g} to {FOCAL_RANGE[1]:g} px",
    Rejection.WRONG_SHAPE: "{shapes}; expected one of each for every landmark of the layout '{config.landmarks}'",
}
"""What was found and what was expected, with the names of figures in braces."""


def rejection_text(answer: Estimate, observation: Observation, config: TrackerConfig) -> str:
    """One line about a rejected observation: what was wrong, what was expected, what to do."""
    assert answer.rejection is not None
    if answer.rejection is Rejection.TOO_FEW_LANDMARKS:
        found = _too_few_landmarks(observation, config)
    else:
        found = FOUND[answer.rejection].format(
            image=observation,
            config=config,
            least_px=SMALLEST_PX * config.noise_px,
            residual=float("nan") if answer.certificate is None else answer.certificate.kkt_residual,
            shapes=_shapes(observation),
            SMALLEST_PX=SMALLEST_PX,
            KKT_TOLERANCE=KKT_TOLERANCE,
            FOCAL_RANGE=FOCAL_RANGE,
        )
    return f"{found}: {advice_for(answer.rejection.value)}"


def frozen_text(seconds: float, config: TrackerConfig) -> str:
    """One line about keypoints that have been the same for this time, s."""
    return (
        f"the same keypoints for {seconds:.1f} s, with new stamps; expected new ones within lost_after "
        f"{config.lost_after:g} s: {advice_for('frozen')}"
    )


def _too_few_landmarks(observation: Observation, config: TrackerConfig) -> str:
    seen = visible(observation, config)
    count, expected = np.count_nonzero(seen), f"expected {config.min_landmarks} or more (min_landmarks)"
    found = f"{count} landmark{'' if count == 1 else 's'} at or above min_confidence {config.min_confidence:g}"
    if count >= config.min_landmarks:
        return f"{found}, but some of them are far from their tracks; {expected} near them"
    confident = observation.confidence >= max(config.min_confidence, 1e-9)
    aside = np.count_nonzero(confident & np.isfinite(observation.points).all(axis=1) & ~seen)
    beside = f", and {aside} outside any field of view, as with camera_info of another camera" if aside else ""
    return f"{found}{beside}; {expected}"


def _shapes(observation: Observation) -> str:
    arrays = {name: getattr(observation, name) for name in ("points", "confidence", "depth", "depth_deviation")}
    return ", ".join(f"{name} {np.shape(values)}" for name, values in arrays.items() if values is not None)
