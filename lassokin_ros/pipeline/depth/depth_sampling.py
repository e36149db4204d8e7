"""Sample a depth image at keypoints: one depth per keypoint, robust against holes, noise and the background."""

from __future__ import annotations

import numpy as np

from msg_adapters.depth_image import DepthImage

RADIUS = 0.004
"""Half of the window's side, by the width of the depth image; at least SMALLEST_RADIUS px."""
SMALLEST_RADIUS = 2
MEASURED_SHARE = 0.2
"""Least share of the window's pixels with a measurement."""
NEAR_QUANTILE = 0.25
"""Quantile of the window's depths about which the sample is taken. The body is in front of the background, so
a keypoint at the edge of a limb gets the depth of the limb."""
SAME_SURFACE = 0.1
"""m: depths this near to the quantile are of the same surface."""


def sample_depth(image: DepthImage, xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the depth of the surface at keypoints (k, 2) px, as (k,) m, NaN = not measured.

    size: (width, height) px of the image of the keypoints. The depth image may have another resolution.
    """
    width, height = image.size
    scale = np.array([width / size[0], height / size[1]])
    with np.errstate(invalid="ignore"):
        centre = np.floor((xy + 0.5) * scale)  # pixel i covers [i, i + 1) of the scaled image
        inside = ((centre >= 0) & (centre < [width, height])).all(axis=1)
    result = np.full(len(xy), np.nan)
    if not inside.any():
        return result
    radius = max(SMALLEST_RADIUS, round(RADIUS * width))
    steps = np.arange(-radius, radius + 1)
    columns, rows = (centre[inside].astype(int)[:, :, None] + steps).swapaxes(0, 1)
    windows = image.metres(rows.clip(0, height - 1)[:, :, None], columns.clip(0, width - 1)[:, None, :])
    result[inside] = _nearest_surface(windows.reshape(len(windows), -1))
    return result


def _nearest_surface(windows: np.ndarray) -> np.ndarray:
    """Return the mean depth (k,) of the nearest surface in windows (k, n), m, NaN = missing."""
    ordered = np.sort(windows, axis=1)  # NaN last
    count = np.count_nonzero(np.isfinite(ordered), axis=1)
    enough = count >= max(1.0, MEASURED_SHARE * windows.shape[1])
    quantile = ordered[np.arange(len(ordered)), (NEAR_QUANTILE * np.maximum(count - 1, 0)).astype(int)]
    with np.errstate(invalid="ignore"):
        same = np.abs(ordered - quantile[:, None]) <= SAME_SURFACE
    total = np.where(same, ordered, 0.0).sum(axis=1)
    return np.where(enough, total / np.maximum(np.count_nonzero(same, axis=1), 1), np.nan)
