"""Reasons against messages, in plain words, and what to do about each."""

from __future__ import annotations

REASONS: dict[str, tuple[str, str]] = {
    "too_few_landmarks": (
        "too few landmarks",
        "fewer than `min_landmarks` keypoints had a confidence of `min_confidence` or more: is anybody in the image, "
        "is `landmarks` right for your detector, is `min_confidence` too high?",
    ),
    "person_absent": (
        "the followed person absent, others there",
        "one person is followed until lost for `lost_after`, whoever else is there; `max_people` follows everybody",
    ),
    "not_certified": (
        "no certified answer",
        "the optimum could not be proved, so that nothing was published: try `solver: proxqp`, `warm_start: false`",
    ),
    "too_small": (
        "a body too small to be seen",
        "what was found would be smaller in the image than the noise: are the keypoints pixels, is camera_info theirs?",
    ),
    "not_finite": ("numbers that are not finite", "the camera's focal length or a stamp is no number"),
    "wrong_shape": ("wrong number of values", "the message's shape is not what `keypoints_type` and `landmarks` say"),
    "old_stamp": ("old stamps", "stamps are not monotonic: two detectors on one topic, or messages out of order?"),
    "stamp_jump": (
        "stamps from another time",
        "one message is somebody's mistake, two in a row are taken for a new time",
    ),
    "bad_stamp": ("stamps that are no time", "the detector fills header.stamp with something else"),
    "bad_frame_id": ("a frame_id that is no name", "look at header.frame_id of the keypoints"),
    "no_camera_info": ("no camera_info yet", "camera_info must come before the keypoints; record it from the start"),
    "camera_unusable": ("a lens that cannot be used", "look at camera_info: model, D, K, or P when `rectified` is set"),
    "camera_uncalibrated": ("a camera that is not calibrated", "camera_info has K[0] = 0: calibrate the camera"),
    "camera_matrix": ("a camera matrix that is none", "look at K of camera_info"),
    "camera_distortion": ("a distortion that is not known", "look at D and distortion_model of camera_info"),
    "camera_not_finite": ("a camera_info that is not finite", "look at K and D of camera_info"),
    "no_image_size": (
        "no image size",
        "these keypoints are fractions of the image: camera_info needs width and height",
    ),
    "unknown_id": ("keypoint ids beyond the layout", "`landmarks` is not your detector's layout"),
    "repeated_id": ("keypoint ids that stand twice", "several people in one message need the field `person`"),
    "confidence_range": ("confidences above 1", "confidence is expected as a fraction of 1, not in percent"),
    "wrong_fields": ("fields that are missing", "the PointCloud2 needs x, y, confidence and id"),
    "wrong_datatype": ("fields of a wrong type", "x, y, confidence are float32, id an integer"),
    "wrong_layout": ("a layout of bytes that does not fit", "point_step, row_step and data of the cloud disagree"),
    "too_many_points": ("too many keypoints", "is this topic a cloud of another kind?"),
    "too_many_people": ("too many people", "more people in one message than anybody can follow"),
    "not_deserialised": ("bytes that are no message", "the recording is damaged, or of another message definition"),
}
"""What a message or frame was refused for -> (in words, advice)."""


def words_for(reason: str) -> str:
    """In words; the key itself where there are none."""
    return REASONS.get(reason, (reason.replace("_", " "), ""))[0]


def advice_for(reason: str) -> str:
    """What to do about it; empty where nothing is known."""
    return REASONS.get(reason, ("", ""))[1]
