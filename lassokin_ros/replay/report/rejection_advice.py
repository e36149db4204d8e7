"""The reasons for which messages are rejected: a plain text and advice for each."""

from __future__ import annotations

REASONS: dict[str, tuple[str, str]] = {
    "too_few_landmarks": (
        "too few landmarks",
        "fewer than `min_landmarks` keypoints had a confidence of `min_confidence` or more: check that a person is in "
        "the image, that `landmarks` fits your detector and that `min_confidence` is not too high",
    ),
    "person_absent": (
        "tracked person absent, other people present",
        "another person is followed `forget_after` after the first one has left, under a new id, and not at all if "
        "`lock` is set; set `max_people` to track several people",
    ),
    "not_certified": (
        "no certified solution",
        "optimality could not be proved, so nothing was published: try `solver: proxqp`",
    ),
    "too_small": (
        "body too small in the image",
        "the estimated body is smaller in the image than the noise: check that the keypoints are in pixels and that "
        "camera_info belongs to them",
    ),
    "not_finite": ("values not finite", "the focal length of the camera or a stamp is not a finite number"),
    "wrong_shape": ("wrong number of values", "the message does not fit `keypoints_type` and `landmarks`"),
    "old_stamp": (
        "stamp not newer than the previous one",
        "the stamps do not increase: check that the detector copies the stamp of each image, that no second detector "
        "uses the topic, and that messages come in order",
    ),
    "late": (
        "image of another camera was used already",
        "the images of several cameras must come in the order of their stamps; check the delay of this camera",
    ),
    "unplaced": (
        "camera without a pose",
        "nobody told where the camera is: give its pose by TF or a calibration file, or set `extrinsics: learn`, and "
        "let a person move in view of it and of a camera with a pose",
    ),
    "stamp_jump": (
        "stamp jump",
        "a single jump is ignored; two in a row reset the tracker to the new time. If every message jumps, check the "
        "unit of header.stamp",
    ),
    "frozen": (
        "keypoints repeated for longer than lost_after",
        "the camera's image does not change, or the detector repeats its last result with new stamps",
    ),
    "other_layout": (
        "bodies with another number of keypoints",
        "`landmarks` is not the layout of your detector (ZED: body_format)",
    ),
    "bad_stamp": ("invalid stamp", "the detector fills header.stamp with a value that is not a time"),
    "bad_frame_id": ("invalid frame_id", "check header.frame_id of the keypoints"),
    "other_size": (
        "camera_info of an image of another size",
        "give the camera_info of the detector's image, in its size (ZED: `pub_resolution: NATIVE`)",
    ),
    "percent": ("coordinates in percent", "multiply x by the image's width / 100 and y by its height / 100"),
    "no_camera_info": (
        "no camera_info received",
        "camera_info must come before the keypoints; record it from the start, or replay with `--camera-info FILE`",
    ),
    "camera_unusable": ("unusable lens", "check camera_info: distortion_model, D, K, or P if `rectified` is set"),
    "camera_uncalibrated": (
        "camera not calibrated",
        "camera_info has K[0] = 0, or a K that cannot be of this image: calibrate the camera at this image size",
    ),
    "camera_matrix": ("invalid camera matrix", "check K of camera_info"),
    "camera_distortion": ("unknown distortion model", "check D and distortion_model of camera_info"),
    "camera_not_finite": ("camera_info not finite", "check K and D of camera_info"),
    "no_image_size": (
        "no image size",
        "these keypoints are relative to the image size: camera_info needs width and height",
    ),
    "fractions": (
        "fractions in place of px",
        "all coordinates are between 0 and 1: multiply them by the width and height of the image",
    ),
    "unknown_id": ("keypoint id outside the layout", "`landmarks` is not the layout of your detector"),
    "repeated_id": ("repeated keypoint id", "several people in one message need the field `person`"),
    "confidence_range": (
        "confidences in another unit",
        "confidence must be between 0 and 1: divide percentages by 100, convert logits with the sigmoid",
    ),
    "wrong_fields": ("missing fields", "the PointCloud2 needs the fields x, y, confidence and id"),
    "wrong_datatype": (
        "wrong field type",
        "x, y, confidence and depth must be float32 or float64, id and person integers",
    ),
    "wrong_layout": ("inconsistent cloud layout", "point_step, row_step and data of the cloud do not match"),
    "too_many_points": ("too many keypoints", "check that this topic does not carry another kind of point cloud"),
    "too_many_people": ("too many people", "the message contains more people than can be tracked"),
    "depth_data": ("damaged compressed depth image", "the image cannot be unpacked; check how it was sent"),
    "no_opencv": ("OpenCV is absent", "compressed depth images in PNG need OpenCV: pip install opencv-python-headless"),
    "depth_encoding": ("unknown encoding of a depth image", "depth images must be 16UC1 (mm) or 32FC1 (m)"),
    "depth_layout": ("inconsistent depth image", "height, width, step and data of the depth image do not match"),
    "image_encoding": ("unknown encoding of an image", "images must be 8-bit RGB, BGR or grey, YUV 4:2:2, JPEG or PNG"),
    "image_layout": ("inconsistent image", "height, width, step and data of the image do not match"),
    "not_deserialised": ("malformed message", "the recording is damaged, or has another message definition"),
}
"""Key of a rejection reason -> (plain text, advice)."""


def reason_text(reason: str) -> str:
    """Return the plain text of a reason; the key itself for an unknown reason."""
    return REASONS.get(reason, (reason.replace("_", " "), ""))[0]


def advice_for(reason: str) -> str:
    """Return the advice for a reason; empty for an unknown reason."""
    return REASONS.get(reason, ("", ""))[1]
