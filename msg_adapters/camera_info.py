"""Decode sensor_msgs/CameraInfo, and check what it says, or a user, about a camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import frame_name

COEFFICIENTS = {"plumb_bob": (4, 5), "rational_polynomial": (8, 12, 14), "equidistant": (4,), "fisheye": (4,)}
"""Distortion model -> allowed numbers of coefficients. `fisheye` is a synonym of `equidistant`."""
OPENCV_COUNTS = {5: "plumb_bob", 8: "rational_polynomial", 12: "rational_polynomial", 14: "rational_polynomial"}
"""Number of coefficients -> model in OpenCV's order. These numbers identify the model, whatever its name."""
OTHER_FAMILIES = ("omni", "unified", "ucm", "sphere", "fov", "inverse", "fisheye", "equi", "kannala")
"""Parts of the names of models that do not have OpenCV's order of coefficients."""
SMALLEST_FOCAL, LARGEST_FOCAL = 0.3, 10.0
"""Limits of the focal length in longer sides of the image: a field of view of 118 degrees, and of 6 degrees."""
SMALLEST_FISHEYE = 0.1
"""The lower limit of an equidistant lens, which has a field of view of up to 220 degrees."""
SMALLEST_FOCAL_PX = 10.0
"""px: the same if the image size is unknown."""
OTHER_SIZES = {0.25: "a quarter of", 1 / 3: "a third of", 0.5: "half", 2 / 3: "two thirds of", 1.5: "1.5 times"}
"""Size for which K may be, as a factor of the image's size -> in words. Larger ones put the principal point outside."""
SAME_FACTOR = 0.05
"""Largest relative difference of both coordinates of the principal point from such a factor."""
UNUSUAL_CENTRE, UNUSUAL_ASPECT = 0.15, 0.1
"""Distance of the principal point from the image centre, as a fraction of the size, and |fx / fy - 1|, from which on
camera_info is suspicious."""
MOST_COEFFICIENTS = 32
LONGEST_NAME = 64
"""Characters of the name of the distortion model that are used."""
LARGEST = 1e7
"""px: upper limit of focal lengths and principal point."""
NOT_CALIBRATED = "the camera is not calibrated"
IDENTITY = np.eye(3)


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """Intrinsics of a camera for the delivered image, after binning and region of interest.

    Attributes
    ----------
    K: (3, 3) px, of the raw image, or of the rectified one if that is decoded.
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


def decode_camera_info(message: Any, rectified: bool = False) -> Intrinsics:
    """Return the intrinsics of a CameraInfo message.

    rectified: those of the rectified image: P in place of K, without distortion. K and D are then not used, unless P
    has no focal length.

    Raises AdapterError with reason `camera_uncalibrated` (K is 0 or cannot belong to the image size),
    `camera_not_finite`, `camera_matrix` (no positive focal length, skew), or `camera_distortion` (unknown model, wrong
    number of coefficients).
    """
    if len(message.d) > MOST_COEFFICIENTS:
        raise AdapterError(
            "camera_distortion", f"{len(message.d)} coefficients D; expected at most {MOST_COEFFICIENTS}"
        )
    K, R, P = (np.array(values, dtype=float).reshape(3, -1) for values in (message.k, message.r, message.p))
    D, model = np.array(message.d, dtype=float), message.distortion_model[:LONGEST_NAME]
    size, frame_id = (message.width, message.height), frame_name(message.header)
    whole = intrinsics_of(K, D, model, P, size, frame_id, rectified, R)
    width, height = _apply_window(message, whole.K, whole.P)
    if min(whole.K[0, 0], whole.K[1, 1]) < 1 or np.abs(whole.K).max() >= LARGEST:
        raise AdapterError(
            "camera_matrix", f"after binning and region of interest K is {whole.K.tolist()}; expected px"
        )
    return replace(whole, width=width, height=height)


def checked_camera(
    K: np.ndarray, D: np.ndarray, model: str, size: tuple[int, int], uncalibrated: str = NOT_CALIBRATED
) -> tuple[np.ndarray, np.ndarray, str, str]:
    """Return K (3, 3), D and the model as in Intrinsics, and why K is unlikely for the image size, in words.

    K: (3, 3) px. D: (c,) coefficients. model: a name in COEFFICIENTS, or another one if the number of coefficients
    identifies the model. size: (width, height) px of the image that K is for, 0 = unknown. uncalibrated: what it means
    that K is 0. Raises AdapterError, see `decode_camera_info`.
    """
    K = np.array(K, dtype=float)
    if not (np.isfinite(K).all() and np.isfinite(D).all()):
        raise AdapterError("camera_not_finite", "camera_info holds a value that is not finite")
    if K[0, 0] == 0:
        raise AdapterError("camera_uncalibrated", f"camera_info has K[0] = 0: {uncalibrated}")
    if not (0 < K[0, 0] and 0 < K[1, 1] and np.abs(K).max() < LARGEST):
        raise AdapterError("camera_matrix", f"K is {K.ravel().tolist()}; expected focal lengths above 0, in px")
    if K[0, 1] or K[1, 0] or K[2, 0] or K[2, 1]:
        raise AdapterError(
            "camera_matrix", f"K is {K.ravel().tolist()}; expected [fx 0 cx, 0 fy cy, 0 0 1], without skew"
        )
    model, D = _distortion(model, D)
    K[2] = 0, 0, 1
    return K, D, model, _check_size(K, size, model == "equidistant")


def intrinsics_of(
    K: np.ndarray,
    D: np.ndarray,
    model: str,
    P: np.ndarray,
    size: tuple[int, int],
    frame_id: str,
    rectified: bool = False,
    R: np.ndarray = IDENTITY,
) -> Intrinsics:
    """Return the intrinsics of a camera without a window. Raises AdapterError, see `decode_camera_info`.

    K, R: (3, 3), D: in the order of `model`, P: (3, 4), px, of an image of size (width, height) px.
    """
    if rectified:
        K, D, model = P[:, :3] if P[0, 0] else K, D[:0], ""
    if not (np.isfinite(R).all() and np.isfinite(P).all()):
        raise AdapterError("camera_not_finite", "camera_info holds a value that is not finite")
    filled = "P is filled: set `rectified` if the detector gets the rectified image"
    K, D, model, warning = checked_camera(K, D, model, size, filled if P[0, 0] > 0 else NOT_CALIBRATED)
    return Intrinsics(K, D, model, R.copy(), P.copy(), *size, frame_id, warning)


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


def _check_size(K: np.ndarray, image: tuple[int, int], fisheye: bool) -> str:
    """Return why K (3, 3) px is unlikely for the full image size, in words. Raises AdapterError if it is impossible."""
    size = np.array(image, dtype=float)
    focal, centre = K[[0, 1], [0, 1]], K[:2, 2]
    numbers = (
        f"fx = {focal[0]:g}, fy = {focal[1]:g}, cx = {centre[0]:g}, cy = {centre[1]:g} px with an image of "
        f"{image[0]} x {image[1]} px"
    )
    known = size.min() > 0
    smallest = SMALLEST_FISHEYE if fisheye else SMALLEST_FOCAL
    if focal.min() < (max(smallest * size.max(), SMALLEST_FOCAL_PX) if known else SMALLEST_FOCAL_PX):
        raise _impossible(numbers, "no camera has so short a focal length; K must be in px of this image")
    if not known:
        return ""
    if focal.max() > LARGEST_FOCAL * size.max():
        raise _impossible(numbers, "a field of view below 6 degrees; K must be in px of this image")
    if (centre <= 0).any() or (centre >= size).any():
        raise _impossible(numbers, "the principal point is outside of the image")
    if words := _other_size(centre / (0.5 * size)):
        raise _impossible(numbers, f"K is that of an image of {words} the size, or of the binned image")
    aspect = focal[0] / focal[1]
    if np.abs(centre / size - 0.5).max() > UNUSUAL_CENTRE:
        return f"camera_info has {numbers}, which may be those of another resolution, or of the binned image"
    if abs(aspect - 1) > UNUSUAL_ASPECT or abs(1 / aspect - 1) > UNUSUAL_ASPECT:
        return f"camera_info has {numbers}: fx and fy differ, as if pixels were not square"
    return ""


def _impossible(numbers: str, why: str) -> AdapterError:
    return AdapterError("camera_uncalibrated", f"camera_info has {numbers}: {why}")


def _other_size(ratios: np.ndarray) -> str:
    """Return the size that K is for, in words; empty if that is none of OTHER_SIZES.

    ratios: (2,) principal point, relative to the centre of the image.
    """
    near = (words for factor, words in OTHER_SIZES.items() if (np.abs(ratios / factor - 1) <= SAME_FACTOR).all())
    return next(near, "")


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
