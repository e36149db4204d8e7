"""The camera of a video: a calibration file of ROS, or a field of view."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.yaml_files import load_mapping, read_text

DEFAULT_FOV = 60.0
"""deg: field of view along the longer side of the image, assumed without a calibration."""
Size = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Calibration:
    """Intrinsics of an image. K: (3, 3) px. D: coefficients of `model`."""

    K: np.ndarray
    D: np.ndarray
    model: str = "plumb_bob"


def assumed_fov_warning(remedy: str) -> str:
    """Return the warning for an unknown camera. remedy: the names of the settings that make it known."""
    return (
        f"no calibration: a field of view of {DEFAULT_FOV:g} degrees is assumed. If it is wrong, distances from the "
        f"camera are wrong by the same factor as the focal length; set {remedy}."
    )


def choose_camera(file: Path | None, fov: float | None, size: Size, content: Size) -> Calibration:
    """Return the camera of a file if there is one, else that of a field of view (degrees; None: DEFAULT_FOV).

    size: (width, height) px of the images; content: of the part between black bars. Raises CameraError.
    """
    return from_file(file, size) if file is not None else from_fov(DEFAULT_FOV if fov is None else fov, size, content)


def from_fov(degrees: float, size: Size, content: Size | None = None) -> Calibration:
    """Return a camera without distortion. degrees: field of view along the longer side of the content (None: of size).

    size, content: (width, height) px. Raises CameraError.
    """
    if not 1.0 <= degrees <= 170.0:
        raise CameraError(f"the field of view is {degrees:g} degrees; expected 1 to 170 degrees")
    focal = max(content or size) / 2 / np.tan(np.radians(degrees) / 2)
    K = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
    return Calibration(K, np.zeros(5))


def from_file(path: Path, size: Size) -> Calibration:
    """Read a calibration file of ROS (ost.yaml) and scale it to the image size (width, height) px.

    Raises CameraError for another form, and for an image with another aspect ratio.
    """
    data = load_mapping(read_text(path, CameraError), str(path), CameraError)
    try:
        K = np.array(data["camera_matrix"]["data"], dtype=float).reshape(3, 3)
        D = np.array(data["distortion_coefficients"]["data"], dtype=float).ravel()
        calibrated = int(data["image_width"]), int(data["image_height"])
        model = str(data.get("distortion_model", "plumb_bob"))
    except (KeyError, TypeError, ValueError) as error:
        raise CameraError(f"'{path}' is no calibration file of ROS: {type(error).__name__} {error}") from None
    if min(calibrated) < 1:
        raise CameraError(f"'{path}' is for an image of {calibrated[0]} x {calibrated[1]} px")
    scale = np.array(size) / np.array(calibrated)
    if abs(scale[0] / scale[1] - 1) > 0.01:
        raise CameraError(
            f"'{path}' is for {calibrated[0]} x {calibrated[1]} px, the images have {size[0]} x {size[1]} px; expected "
            "the same aspect ratio"
        )
    K[:2] *= scale[:, None]
    return Calibration(K, D, model)
