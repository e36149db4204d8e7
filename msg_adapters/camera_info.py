"""sensor_msgs/CameraInfo to numbers, refused with a reason when they cannot be a camera's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import frame_name

COEFFICIENTS = {
    "plumb_bob": (4, 5),
    "rational_polynomial": (8, 12, 14),
    "equidistant": (4,),
    "fisheye": (4,),
}
"""Distortion model -> numbers of coefficients that it may have; `fisheye` is another word for `equidistant`."""
MOST_COEFFICIENTS = 32
LONGEST_NAME = 64
"""Characters of the distortion model's name that are looked at."""
LARGEST = 1e7
"""px: no focal length or centre is this large."""


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A camera's intrinsics for the image as it is delivered (binning and region of interest are taken into account).

    Attributes
    ----------
    K: (3, 3) px, of the raw image.
    D: distortion coefficients in the order of `model`; empty when there is no distortion.
    model: "plumb_bob", "rational_polynomial", "equidistant" or "" when there is no distortion.
    R: (3, 3), P: (3, 4) px, of the rectified image.
    width, height: px, of the image; frame_id: the camera's optical frame.
    """

    K: np.ndarray
    D: np.ndarray
    model: str
    R: np.ndarray
    P: np.ndarray
    width: int
    height: int
    frame_id: str


def decode_camera_info(message: Any) -> Intrinsics:
    """The camera of a CameraInfo message.

    Raises AdapterError with reason `camera_uncalibrated` (K[0] is 0), `camera_not_finite`, `camera_matrix` (no
    positive focal length, skew) or `camera_distortion` (unknown model, wrong number of coefficients).
    """
    K, R, P = (np.array(values, dtype=float) for values in (message.k, message.r, message.p))
    if len(message.d) > MOST_COEFFICIENTS:
        raise AdapterError(
            "camera_distortion", f"{len(message.d)} coefficients D; expected at most {MOST_COEFFICIENTS}"
        )
    D = np.array(message.d, dtype=float)
    if not all(np.isfinite(values).all() for values in (K, R, P, D)):
        raise AdapterError("camera_not_finite", "camera_info holds a value that is not finite")
    if K[0] == 0:
        raise AdapterError("camera_uncalibrated", "camera_info has K[0] = 0: the camera is not calibrated")
    if not (0 < K[0] and 0 < K[4] and np.abs(K).max() < LARGEST):
        raise AdapterError("camera_matrix", f"K is {K.tolist()}; expected focal lengths above 0, in px")
    if K[1] or K[3] or K[6] or K[7]:
        raise AdapterError("camera_matrix", f"K is {K.tolist()}; expected [fx 0 cx, 0 fy cy, 0 0 1], without skew")
    model, D = _distortion(message.distortion_model[:LONGEST_NAME], D)
    frame_id = frame_name(message.header)
    K, P = K.reshape(3, 3), P.reshape(3, 4)
    K[2] = 0, 0, 1
    width, height = _apply_window(message, K, P)
    if min(K[0, 0], K[1, 1]) < 1 or np.abs(K).max() >= LARGEST:
        raise AdapterError("camera_matrix", f"after binning and region of interest K is {K.tolist()}; expected px")
    return Intrinsics(K, D, model, R.reshape(3, 3), P, width, height, frame_id)


def _distortion(model: str, D: np.ndarray) -> tuple[str, np.ndarray]:
    """Model and coefficients; ("", empty) where they bend nothing.

    An equidistant lens bends rays even with all coefficients 0, so it stays.
    """
    model = "equidistant" if model == "fisheye" else model
    if model == "equidistant" and len(D) == 0:
        D = np.zeros(4)
    if model != "equidistant" and not D.any():
        return "", D[:0]
    if model not in COEFFICIENTS:
        known = ", ".join(COEFFICIENTS)
        raise AdapterError("camera_distortion", f"distortion_model is '{model}'; expected one of: {known}")
    if len(D) not in COEFFICIENTS[model]:
        expected = " or ".join(map(str, COEFFICIENTS[model]))
        raise AdapterError("camera_distortion", f"{model} with {len(D)} coefficients D; expected {expected}")
    return model, D


def _apply_window(message: Any, K: np.ndarray, P: np.ndarray) -> tuple[int, int]:
    """Shift and scale K and P, in place, to the delivered image's pixels; its width and height.

    CameraInfo describes the full sensor; `roi` cuts a window out of it and binning merges its pixels.
    """
    roi, width, height = message.roi, message.width, message.height
    if roi.width and roi.height:
        shift, width, height = (roi.x_offset, roi.y_offset), roi.width, roi.height
    else:
        shift = (0, 0)
    binning = max(1, message.binning_x), max(1, message.binning_y)
    for axis in (0, 1):
        K[axis, 2] -= shift[axis]
        P[axis, 2] -= shift[axis]
        K[axis] /= binning[axis]
        P[axis] /= binning[axis]
    return width // binning[0], height // binning[1]
