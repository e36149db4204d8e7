"""The camera of a video: a calibration file, or a field of view, which black bars do not count for."""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from pathlib import Path

import numpy as np

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera.calibration_file import Calibration, read_calibration

DEFAULT_FOV = 60.0
"""deg: field of view along the longer side of the image, assumed without a calibration."""
Size = tuple[int, int]
BLACK, NOISE = 32, 0.02
"""Grey value of a black bar's pixels at most (codecs have noise), and the share of pixels that may be brighter."""
LEAST_BAR, UNEVEN_BAR = 0.02, 0.01
"""Least width of a bar, and the largest difference of the two, as shares of the image."""


def assumed_fov_warning(remedy: str) -> str:
    """Return the warning for an unknown camera. remedy: the names of the settings that make it known."""
    return (
        f"no calibration: a field of view of {DEFAULT_FOV:g} degrees is assumed. If it is wrong, distances from the "
        f"camera are wrong by the same factor as the focal length; set {remedy}."
    )


def from_fov(degrees: float, size: Size, content: Size | None = None, fisheye: bool = False) -> Calibration:
    """Return a camera without distortion. degrees: field of view along the longer side of the content (None: of size).

    size, content: (width, height) px. fisheye: the distance from the image's middle grows with the angle to the
    optical axis, not with its tangent (equidistant). Raises CameraError.
    """
    if not 1.0 <= degrees <= 170.0:
        raise CameraError(f"the field of view is {degrees:g} degrees; expected 1 to 170 degrees")
    half = np.radians(degrees) / 2
    focal = max(content or size) / 2 / (half if fisheye else np.tan(half))
    K = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
    return Calibration(K, np.zeros(4 if fisheye else 5), "equidistant" if fisheye else "plumb_bob", size)


def from_file(path: Path, size: Size) -> Calibration:
    """Read a calibration file (see session.camera.calibration_file) and scale it to the image size (width, height) px.

    Raises CameraError for another form, and for an image with another aspect ratio.
    """
    return read_calibration(path).scaled_to(size, str(path))


def content_size(image: np.ndarray) -> tuple[int, int]:
    """Return the (width, height) px between black bars of equal width on two opposite sides of an image.

    A letterboxed video has them. The optical axis stays in the middle, but the field of view is that of the content.
    Dark surroundings on all four sides are no bars: they are those of a lit stage.
    """
    bright = image.max(axis=2) > BLACK
    size = []
    for axis in (0, 1):  # columns, rows
        filled = np.flatnonzero(bright.mean(axis=axis) > NOISE)
        full = image.shape[1 - axis]
        first, last = (int(filled[0]), full - 1 - int(filled[-1])) if len(filled) else (0, 0)
        are_bars = min(first, last) > LEAST_BAR * full and abs(first - last) <= UNEVEN_BAR * full
        size.append(full - first - last if are_bars else full)
    full_width, full_height = image.shape[1], image.shape[0]
    around = size[0] < full_width and size[1] < full_height
    return (full_width, full_height) if around else (size[0], size[1])


def common_content(first: np.ndarray, others: Iterator[np.ndarray]) -> tuple[int, int]:
    """Return the content of some images: only what is black in all of them is a bar.

    others: read if the first image has bars, or shows nothing.
    """
    size = first.shape[1], first.shape[0]
    if content_size(first) == size and first.max() > BLACK:
        return size
    return content_size(reduce(np.maximum, (image for image in others if image.shape == first.shape), first))
