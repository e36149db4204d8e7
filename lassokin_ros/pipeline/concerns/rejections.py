"""The reasons for which messages are rejected: a name, what to do, and a frame's numbers in words."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.gating import FOCAL_RANGE, visible
from lassokin_ros.core.lasso.solver import KKT_TOLERANCE
from lassokin_ros.core.observation import Observation, Rejection
from lassokin_ros.core.tracker import SMALLEST_PX
from lassokin_ros.pipeline.concerns.catalogue import FROZEN_ADVICE


class Reason(NamedTuple):
    """A reason in words; remedy: what it may mean, and what to do."""

    name: str
    remedy: str


LAYOUT = "set `landmarks` to the layout of your detector"
UNIT_OF_DEPTH = "depth images must be 16UC1 (mm) or 32FC1 (m)"
OF_CAMERA = "check K, D and distortion_model of camera_info, or P if `rectified` is set"

_TEXTS = {
    "too_few_landmarks": "too few landmarks: check that a person is in the image, that `landmarks` fits your detector "
    "and that `min_confidence` is not too high",
    "person_absent": "tracked person absent, other people present: another person is followed `forget_after` after the"
    " first one has left, and not at all if `lock` is set; set `max_people` to follow several people",
    "not_certified": "no certified solution: try `solver: proxqp`",
    "too_small": "body too small in the image: check that the keypoints are in px, and that camera_info is of their "
    "camera",
    "not_finite": "values not finite: check the stamp and K of camera_info",
    "wrong_shape": "wrong number of values: check that the message fits `keypoints_type` and `landmarks`",
    "old_stamp": "stamp not newer than the previous one: check that the detector copies the stamp of each image, that "
    "no second detector uses the topic, and that messages come in order",
    "late": "image of another camera was used already: give the images of several cameras in the order of their "
    "stamps; check the delay of this camera",
    "unplaced": "camera without a pose: give its pose by TF or a calibration file, or set `extrinsics: learn`, and let"
    " a person move in view of it and of a camera with a pose",
    "no_transform": "camera without a pose in TF: publish the pose of its optical frame on /tf or /tf_static",
    "stamp_jump": "stamp jump: a single jump is ignored; two in a row reset the tracker to the new time. If every "
    "message jumps, check the unit of header.stamp",
    "frozen": f"keypoints repeated for longer than lost_after: {FROZEN_ADVICE}",
    "other_layout": f"bodies with another number of keypoints: {LAYOUT} (ZED: body_format)",
    "bad_stamp": "invalid stamp: fill header.stamp with the time of the image; nanosec is below 1e9",
    "bad_frame_id": "invalid frame_id: set header.frame_id to the camera's optical frame",
    "other_size": "camera_info of an image of another size: give the camera_info of the detector's image, in its size "
    "(ZED: `pub_resolution: NATIVE`)",
    "percent": "coordinates in percent: multiply x by the image's width / 100 and y by its height / 100",
    "no_camera_info": "no camera_info received: camera_info must come before the keypoints; record it from the start, "
    "or replay with `--camera-info FILE`",
    "camera_unusable": f"unusable lens: {OF_CAMERA}",
    "camera_uncalibrated": "camera not calibrated: K[0] is 0, or K cannot be of this image: calibrate the camera at "
    "this image size",
    "camera_matrix": f"invalid camera matrix: {OF_CAMERA}",
    "camera_distortion": f"unknown distortion model: {OF_CAMERA}",
    "camera_not_finite": f"camera_info not finite: {OF_CAMERA}",
    "no_image_size": "no image size: these keypoints are relative to the image size: fill width and height of "
    "camera_info",
    "fractions": "fractions in place of px: multiply the coordinates by the width and the height of the image",
    "unknown_id": f"keypoint id outside the layout: {LAYOUT}",
    "repeated_id": "repeated keypoint id: several people in one message need the field `person`",
    "confidence_range": "confidences in another unit: confidence must be between 0 and 1: divide percentages by 100, "
    "convert logits with the sigmoid",
    "wrong_fields": "missing fields: the PointCloud2 needs the fields x, y, confidence and id",
    "wrong_datatype": "wrong field type: x, y, confidence and depth must be float32 or float64, id and person integers",
    "wrong_layout": "inconsistent cloud layout: check point_step, row_step and data of the cloud: they do not match",
    "too_many_points": "too many keypoints: check that this topic carries keypoints, no other point cloud",
    "too_many_people": "too many people: check that this topic carries keypoints of one image per message",
    "depth_data": "damaged compressed depth image: the image cannot be unpacked; check how it was sent or recorded",
    "no_opencv": "OpenCV is absent: for compressed depth images in PNG: pip install opencv-python-headless",
    "depth_encoding": f"unknown encoding of a depth image: {UNIT_OF_DEPTH}",
    "depth_layout": "inconsistent depth image: check height, width, step and data: they do not match",
    "image_encoding": "unknown encoding of an image: images must be 8-bit RGB, BGR or grey, YUV 4:2:2, JPEG or PNG",
    "image_layout": "inconsistent image: check height, width, step and data: they do not match",
    "not_deserialised": "malformed message: the recording is damaged, or has another message definition",
    "internal_error": "internal error: the log has the error; please report it with the recording",
}  # fmt: skip
REASONS = {key: Reason(*text.split(": ", 1)) for key, text in _TEXTS.items()}
"""Key of a reason -> its words."""


def reason_text(reason: str) -> str:
    """Return the name of a reason; the key itself for an unknown reason."""
    return REASONS[reason].name if reason in REASONS else reason.replace("_", " ")


def advice_for(reason: str) -> str:
    """Return the advice for a reason; empty for an unknown reason."""
    return REASONS[reason].remedy if reason in REASONS else ""


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
