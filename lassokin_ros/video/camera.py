"""The camera of a video: a calibration file, or a field of view."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.calibration_file import Calibration, read_calibration

DEFAULT_FOV = 60.0
"""deg: field of view along the longer side of the image, assumed without a calibration."""


def from_fov(degrees: float, size: tuple[int, int]) -> Calibration:
    """Return a camera without distortion. degrees: field of view along the longer side. size: (width, height) px.

    Raises CameraError.
    """
    if not 1.0 <= degrees <= 170.0:
        raise CameraError(f"--fov {degrees:g}; expected 1 to 170 degrees")
    focal = max(size) / 2 / np.tan(np.radians(degrees) / 2)
    K = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
    return Calibration(K, np.zeros(5), size=size)


def from_file(path: Path, size: tuple[int, int]) -> Calibration:
    """Read a calibration file and scale it to the image size (width, height) px. Raises CameraError."""
    return read_calibration(path).scaled(size)
