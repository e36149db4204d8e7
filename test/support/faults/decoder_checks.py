"""Valid results of a decoder for any message: keypoints that a tracker can use, or a refusal with its reason."""

import numpy as np

from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import LARGEST_PIXEL, MAX_POINTS

REASONS = {
    "wrong_fields",
    "wrong_datatype",
    "wrong_layout",
    "wrong_shape",
    "too_many_points",
    "bad_stamp",
    "bad_frame_id",
    "unknown_id",
    "repeated_id",
    "confidence_range",
    "no_image_size",
    "camera_not_finite",
    "camera_uncalibrated",
    "camera_matrix",
    "camera_distortion",
}
LONGEST_TEXT = 1500
"""Limit for the length of the text about a message, for messages of any length."""


def refusal(error):
    assert error.reason in REASONS and 0 < len(str(error)) < LONGEST_TEXT
    return error.reason


def outcome_of(adapter, message, size, landmarks):
    """The reason of the refusal, or "read" if all its content is usable."""
    try:
        keypoints = adapter.decode(message, size)
    except AdapterError as error:
        return refusal(error)
    k = len(keypoints.ids)
    assert k <= MAX_POINTS and keypoints.xy.shape == (k, 2) and keypoints.confidence.shape == (k,)
    assert keypoints.stamp_ns is None or keypoints.stamp_ns > 0
    persons = [] if keypoints.persons is None else np.unique(keypoints.persons)[:5].tolist()
    outcome = "read"
    for person in (None, *persons):
        try:
            points, confidence = keypoints.as_landmarks(landmarks, person)
        except AdapterError as error:
            outcome = refusal(error)
            continue
        seen = confidence > 0
        assert points.shape == (landmarks, 2) and confidence.shape == (landmarks,)
        assert ((confidence >= 0) & (confidence <= 1)).all() and (np.isfinite(points).all(axis=1) == seen).all()
        assert (np.abs(points[seen]) <= LARGEST_PIXEL).all()
    return outcome
