"""The reasons for which messages are rejected: a name, what to do, and a frame's numbers in words."""

from __future__ import annotations

from typing import NamedTuple

from lassokin_ros.pipeline.concerns.catalogue import FROZEN_ADVICE


class Reason(NamedTuple):
    """A reason in words; remedy: what it may mean, and what to do."""

    name: str
    remedy: str


LAYOUT = "set `landmarks` to the layout of your detector"
UNIT_OF_DEPTH = "depth images must be 16UC1 (mm) or 32FC1 (m)"
OF_CAMERA = "check K, D and distortion_model of camera_info, or P if `rectified` is set"

REASONS: dict[str, Reason] = {
    "too_few_landmarks": Reason(
        "too few landmarks",
        "check that a person is in the image, that `landmarks` fits your "
        "detector and that `min_confidence` is not too high",
    ),
    "person_absent": Reason(
        "tracked person absent, other people present",
        "another person is followed `forget_after` "
        "after the first one has left, and not at all if `lock` is set; set `max_people` to follow several people",
    ),
    "not_certified": Reason("no certified solution", "try `solver: proxqp`"),
    "too_small": Reason(
        "body too small in the image", "check that the keypoints are in px, and that camera_info is of their camera"
    ),
    "not_finite": Reason("values not finite", "check the stamp and K of camera_info"),
    "wrong_shape": Reason("wrong number of values", "check that the message fits `keypoints_type` and `landmarks`"),
    "old_stamp": Reason(
        "stamp not newer than the previous one",
        "check that the detector copies the stamp of each "
        "image, that no second detector uses the topic, and that messages come in order",
    ),
    "late": Reason(
        "image of another camera was used already",
        "give the images of several cameras in the order of their stamps; check the delay of this camera",
    ),
    "unplaced": Reason(
        "camera without a pose",
        "give its pose by TF or a calibration file, or set `extrinsics: "
        "learn`, and let a person move in view of it and of a camera with a pose",
    ),
    "no_transform": Reason("camera without a pose in TF", "publish the pose of its optical frame on /tf or /tf_static"),
    "stamp_jump": Reason(
        "stamp jump",
        "a single jump is ignored; two in a row reset the tracker to the new time. If "
        "every message jumps, check the unit of header.stamp",
    ),
    "frozen": Reason("keypoints repeated for longer than lost_after", FROZEN_ADVICE),
    "other_layout": Reason("bodies with another number of keypoints", f"{LAYOUT} (ZED: body_format)"),
    "bad_stamp": Reason("invalid stamp", "fill header.stamp with the time of the image; nanosec is below 1e9"),
    "bad_frame_id": Reason("invalid frame_id", "set header.frame_id to the camera's optical frame"),
    "other_size": Reason(
        "camera_info of an image of another size",
        "give the camera_info of the detector's image, in its size (ZED: `pub_resolution: NATIVE`)",
    ),
    "percent": Reason("coordinates in percent", "multiply x by the image's width / 100 and y by its height / 100"),
    "no_camera_info": Reason(
        "no camera_info received",
        "camera_info must come before the keypoints; record it from the start, or replay with `--camera-info FILE`",
    ),
    "camera_unusable": Reason("unusable lens", OF_CAMERA),
    "camera_uncalibrated": Reason(
        "camera not calibrated", "K[0] is 0, or K cannot be of this image: calibrate the camera at this image size"
    ),
    "camera_matrix": Reason("invalid camera matrix", OF_CAMERA),
    "camera_distortion": Reason("unknown distortion model", OF_CAMERA),
    "camera_not_finite": Reason("camera_info not finite", OF_CAMERA),
    "no_image_size": Reason(
        "no image size", "these keypoints are relative to the image size: fill width and height of camera_info"
    ),
    "fractions": Reason(
        "fractions in place of px", "multiply the coordinates by the width and the height of the image"
    ),
    "unknown_id": Reason("keypoint id outside the layout", LAYOUT),
    "repeated_id": Reason("repeated keypoint id", "several people in one message need the field `person`"),
    "confidence_range": Reason(
        "confidences in another unit",
        "confidence must be between 0 and 1: divide percentages by 100, convert logits with the sigmoid",
    ),
    "wrong_fields": Reason("missing fields", "the PointCloud2 needs the fields x, y, confidence and id"),
    "wrong_datatype": Reason(
        "wrong field type", "x, y, confidence and depth must be float32 or float64, id and person integers"
    ),
    "wrong_layout": Reason(
        "inconsistent cloud layout", "check point_step, row_step and data of the cloud: they do not match"
    ),
    "too_many_points": Reason("too many keypoints", "check that this topic carries keypoints, no other point cloud"),
    "too_many_people": Reason("too many people", "check that this topic carries keypoints of one image per message"),
    "depth_data": Reason(
        "damaged compressed depth image", "the image cannot be unpacked; check how it was sent or recorded"
    ),
    "no_opencv": Reason("OpenCV is absent", "for compressed depth images in PNG: pip install opencv-python-headless"),
    "depth_encoding": Reason("unknown encoding of a depth image", UNIT_OF_DEPTH),
    "depth_layout": Reason("inconsistent depth image", "check height, width, step and data: they do not match"),
    "image_encoding": Reason(
        "unknown encoding of an image", "images must be 8-bit RGB, BGR or grey, YUV 4:2:2, JPEG or PNG"
    ),
    "image_layout": Reason("inconsistent image", "check height, width, step and data: they do not match"),
    "not_deserialised": Reason("malformed message", "the recording is damaged, or has another message definition"),
    "internal_error": Reason("internal error", "the log has the error; please report it with the recording"),
}
"""Key of a reason -> its words."""


def reason_text(reason: str) -> str:
    """Return the name of a reason; the key itself for an unknown reason."""
    return REASONS[reason].name if reason in REASONS else reason.replace("_", " ")


def advice_for(reason: str) -> str:
    """Return the advice for a reason; empty for an unknown reason."""
    return REASONS[reason].remedy if reason in REASONS else ""
