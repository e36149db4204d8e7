"""Triangulation: places of landmarks that several cameras see at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.image.frame_data import View

LEAST_CONDITION = 1e-3
"""Ratio of the smallest to the largest eigenvalue of a landmark's normal equations below which its place is unknown."""


def triangulate(given: Sequence[View]) -> np.ndarray:
    """(l, 3) m, by weighted least squares on x_i + t_i = u (z + t_z) of the given views; NaN if fewer than two see a
    landmark, or from the same direction.
    """
    count = len(given[0].points)
    H, g, views = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count)
    for view in given:
        rows = view.ray_rows()
        right = -(rows @ view.camera.translation)
        rows = rows @ view.camera.rotation
        H += rows.swapaxes(-1, -2) @ rows
        g += (rows.swapaxes(-1, -2) @ right[..., None])[..., 0]
        views += view.weights > 0
    values = np.linalg.eigvalsh(H)
    known = (views > 1) & (values[:, 0] > LEAST_CONDITION * values[:, 2])
    places = np.full((count, 3), np.nan)
    places[known] = np.linalg.solve(H[known], g[known][..., None])[..., 0]
    return places
