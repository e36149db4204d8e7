"""Decode and check sensor_msgs/CameraInfo."""

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
"""Distortion model -> allowed numbers of coefficients. `fisheye` is a synonym of `equidistant`."""
OPENCV_COUNTS = {5: "plumb_bob", 8: "rational_polynomial", 12: "rational_polynomial", 14: "rational_polynomial"}
"""Number of coefficients -> model in OpenCV's order. These numbers identify the model, whatever its name."""
OTHER_FAMILIES = ("omni", "unified", "ucm", "sphere", "fov", "inverse", "fisheye", "equi", "kannala")
"""Parts of the names of models that do not have OpenCV's order of coefficients."""
SMALLEST_FOCAL = 0.1
"""A focal length below this fraction of the image size is impossible: a field of view above 157 degrees."""
SMALLEST_FOCAL_PX = 10.0
"""px: the same if the image size is unknown."""
FARTHEST_CENTRE = 1.0
"""A principal point farther from the image centre than this fraction of the image size is impossible."""
UNUSUAL_CENTRE, UNUSUAL_ASPECT = 0.15, 0.1
"""Distance of the principal point from the image centre, as a fraction of the size, and |fx / fy - 1|, from which on
camera_info is suspicious."""
UNUSUAL_FOCAL = 20.0
"""Focal length in sides of the image from which K is probably in another unit than px."""
MOST_COEFFICIENTS = 32
LONGEST_NAME = 64
"""Characters of the name of the distortion model that are used."""
LARGEST = 1e7
"""px: upper limit of focal lengths and principal point."""


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """Intrinsics of a camera for the delivered image, after binning and region of interest.

    Attributes
    ----------
    K: (3, 3) px, of the raw image.
    D: distortion coefficients in the order of `model`; empty when there is no distortion.
    model: "plumb_bob", "rational_polynomial", "equidistant" or "" when there is no distortion.
    R: (3, 3), P: (3, 4) px, of the rectified image.
    width, height: px, of the image; frame_id: the optical frame of the camera.
    warning: why K is unlikely for the image size, with numbers; empty if it is usual.
    """

    K: np.ndarray
    D: np.ndarray
    model: str
    R: np.ndarray
    P: np.ndarray
    width: int
    height: int
    frame_id: str
    warning: str = ""


def decode_camera_info(message: Any) -> Intrinsics:
    """Return the intrinsics of a CameraInfo message.

    Raises AdapterError with reason `camera_uncalibrated` (K is 0 or cannot belong to the image size),
    `camera_not_finite`, `camera_matrix` (no positive focal length, skew) or `camera_distortion` (unknown model, wrong
    number of coefficients).
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
    warning = _check_size(K, message)
    width, height = _apply_window(message, K, P)
    if min(K[0, 0], K[1, 1]) < 1 or np.abs(K).max() >= LARGEST:
        raise AdapterError("camera_matrix", f"after binning and region of interest K is {K.tolist()}; expected px")
    return Intrinsics(K, D, model, R.reshape(3, 3), P, width, height, frame_id, warning)


def _distortion(model: str, D: np.ndarray) -> tuple[str, np.ndarray]:
    """Return model and coefficients; ("", empty) without distortion.

    An equidistant lens has distortion even if all coefficients are 0. Surplus trailing zeros are dropped. A number of
    coefficients in OPENCV_COUNTS identifies the model, unless its name belongs to another family.
    """
    model = "equidistant" if model == "fisheye" else model
    if model == "equidistant" and len(D) == 0:
        D = np.zeros(4)
    if model != "equidistant" and not D.any():
        return "", D[:0]
    D = _without_surplus_zeros(model, D)
    if len(D) in OPENCV_COUNTS and not any(part in model.lower() for part in OTHER_FAMILIES):
        model = OPENCV_COUNTS[len(D)]
    if model not in COEFFICIENTS:
        known = ", ".join(COEFFICIENTS)
        raise AdapterError("camera_distortion", f"distortion_model is '{model}'; expected one of: {known}")
    if len(D) not in COEFFICIENTS[model]:
        expected = " or ".join(map(str, COEFFICIENTS[model]))
        raise AdapterError("camera_distortion", f"{model} with {len(D)} coefficients D; expected {expected}")
    return model, D


def _without_surplus_zeros(model: str, D: np.ndarray) -> np.ndarray:
    """Return D with the largest allowed number of coefficients, if only zeros are dropped for it."""
    counts = COEFFICIENTS.get(model, tuple(OPENCV_COUNTS))
    if len(D) in counts or len(D) in OPENCV_COUNTS and D[max(counts) :].any():
        return D
    fitting = [count for count in counts if count < len(D) and not D[count:].any()]
    return D[: max(fitting)] if fitting else D


def _check_size(K: np.ndarray, message: Any) -> str:
    """Return why K (3, 3) px is unlikely for the full image size, in words. Raises AdapterError if it is impossible."""
    size = np.array([message.width, message.height], dtype=float)
    focal, centre = K[[0, 1], [0, 1]], K[:2, 2]
    numbers = (
        f"fx = {focal[0]:g}, fy = {focal[1]:g}, cx = {centre[0]:g}, cy = {centre[1]:g} px with an image of "
        f"{message.width} x {message.height} px"
    )
    known = size.min() > 0
    if focal.min() < (max(SMALLEST_FOCAL * size.max(), SMALLEST_FOCAL_PX) if known else SMALLEST_FOCAL_PX):
        raise AdapterError("camera_uncalibrated", f"camera_info has {numbers}: no camera has so short a focal length")
    aspect = focal[0] / focal[1]
    if not known:
        return ""
    away = np.abs(centre / size - 0.5)
    if away.max() > FARTHEST_CENTRE:
        raise AdapterError("camera_uncalibrated", f"camera_info has {numbers}: the principal point is far outside")
    if away.max() > UNUSUAL_CENTRE:
        return f"camera_info has {numbers}, which may be those of another resolution, or of the binned image"
    if focal.max() > UNUSUAL_FOCAL * size.max():
        return f"camera_info has {numbers}: a field of view below 3 degrees; K must be in px"
    if abs(aspect - 1) > UNUSUAL_ASPECT or abs(1 / aspect - 1) > UNUSUAL_ASPECT:
        return f"camera_info has {numbers}: fx and fy differ, as if pixels were not square"
    return ""


def _apply_window(message: Any, K: np.ndarray, P: np.ndarray) -> tuple[int, int]:
    """Shift and scale K and P, in place, to pixels of the delivered image. Return its width and height.

    CameraInfo describes the full sensor. `roi` selects a window of it, and binning merges its pixels.
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
