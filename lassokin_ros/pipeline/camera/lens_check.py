"""Whether a lens model can be that of a lens, over its image. A calibration with absurd coefficients is noticed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

LARGEST_STRETCH, UNUSUAL_STRETCH = 2.0, 1.3
"""Ratio of a point's distance from the principal point with and without distortion, from which no lens has it, and from
which it is a warning. Lenses with a cushion shape have up to 1.1; the others are below 1."""
INNER, USUAL = 0.5, 0.8
"""Share of the way from the principal point to the borders within which a model must be usable, and within which it
usually is: the models of wide lenses turn back near the borders."""


def border_points(K: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(4, 2) normalised: of the borders' points left, above, right and below of the principal point.

    K: (3, 3) px. size: (width, height) px; 0 = unknown, then the principal point is in the middle.
    """
    centre, focal = K[:2, 2], K[[0, 1], [0, 1]]
    far = np.where(np.array(size) > 0, size, 2 * centre) - centre
    (left, above), (right, below) = centre / focal, far / focal
    return np.array([[-left, 0.0], [0.0, -above], [right, 0.0], [0.0, below]])


def faults_of(
    undistort: Callable[[np.ndarray], np.ndarray], border: np.ndarray, turns_back: float, fisheye: bool
) -> tuple[str, str]:
    """Return why no lens has this distortion, and what is unusual about it, in words; empty if nothing is.

    undistort: of normalised points (k, 2), NaN where the model has none. border: see `border_points`. turns_back:
    normalised distance from the principal point beyond which the model's image turns back.
    """
    points = np.concatenate([INNER * border, border])
    distances, straight = np.linalg.norm(points, axis=1), np.linalg.norm(undistort(points), axis=1)
    beyond = distances > turns_back if fisheye else np.isnan(straight)  # a fisheye's image may end within the borders
    if beyond[: len(border)].any():
        return "its image turns back near the principal point", ""
    straight = np.where(straight > 0, np.arctan(straight) if fisheye else straight, np.inf)  # NaN, too
    stretch = float((distances / straight).max())
    if stretch > LARGEST_STRETCH:
        return f"it moves points away from the principal point by a factor of {stretch:.3g}", ""
    if (USUAL * distances[len(border) :] > turns_back).any():
        return "", "its image turns back within the borders, so that points near these are lost"
    if stretch > UNUSUAL_STRETCH:
        return "", f"it moves points away from the principal point by a factor of {stretch:.2f}"
    return "", ""
