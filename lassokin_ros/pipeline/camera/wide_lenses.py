"""Kalibr's wide lenses (omni, ds, eucm) as the equidistant lens that is nearest to them.

All three are functions of the angle theta from the optical axis; r is the distance from the principal point in the
image, for a unit focal length:

omni (Mei):            r = s / (c + xi)
ds (double sphere):    r = s / (alpha d + (1 - alpha) (xi + c)), d = sqrt(s^2 + (xi + c)^2)
eucm:                  r = s / (alpha d + (1 - alpha) c),        d = sqrt(beta s^2 + c^2)

with s = sin theta, c = cos theta. r is then distorted by k1, k2 of radtan. The equidistant lens has r = f theta (1 + k1
theta^2 + ... + k4 theta^8).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.errors import CameraError

PARAMETERS = {"omni": 1, "ds": 2, "eucm": 2}
"""Numbers of parameters before fu, fv, pu, pv."""
ANGLES = np.linspace(1e-3, np.radians(100), 1000)
"""rad"""
LARGEST_MISFIT_PX, LARGEST_TANGENTIAL = 0.5, 2e-3
"""Largest error of the equidistant lens within the image, px, and largest p1, p2 of radtan, which it has not."""


def equidistant(
    model: str, parameters: Sequence[float], radtan: Sequence[float], focal: float, farthest: float, name: str
) -> tuple[float, np.ndarray]:
    """Return the factor of the focal lengths and the coefficients D (4,) of the equidistant lens.

    radtan: k1, k2, p1, p2, or none. focal: px. farthest: px, of the image's corners from the principal point. name: of
    the file, for messages. Raises CameraError if no equidistant lens is near.
    """
    s, c = np.sin(ANGLES), np.cos(ANGLES)
    first, second = (*parameters, 0.0)[:2]
    with np.errstate(all="ignore"):
        if model == "omni":
            radius = s / (c + first)
        elif model == "ds":
            radius = s / (second * np.hypot(s, first + c) + (1 - second) * (first + c))
        else:
            radius = s / (first * np.sqrt(second * s**2 + c**2) + (1 - first) * c)
        k1, k2, p1, p2 = (*radtan, 0.0, 0.0, 0.0, 0.0)[:4]
        radius = radius * (1 + k1 * radius**2 + k2 * radius**4)
    rising = np.concatenate([[True], np.diff(radius) > 0]) & np.isfinite(radius) & (radius > 0)
    count = len(ANGLES) if rising.all() else int(np.argmin(rising))
    count = min(count, int(np.searchsorted(radius[:count], farthest / focal)) + 1)
    if max(abs(p1), abs(p2)) > LARGEST_TANGENTIAL or count < 20:
        raise CameraError(
            f"camera '{name}': {model} with {list(parameters)} and {list(radtan)} is no lens that can be used"
        )
    theta, radius = ANGLES[:count], radius[:count]
    columns = np.stack([theta ** (2 * power + 1) for power in range(5)], axis=1)
    solution, *_ = np.linalg.lstsq(columns, radius, rcond=None)
    misfit = focal * float(np.abs(columns @ solution - radius).max())
    if misfit > LARGEST_MISFIT_PX:
        raise CameraError(
            f"'{name}': {model} with {list(parameters)} is up to {misfit:.1f} px from an equidistant lens; "
            "expected a calibration with camera_model pinhole and distortion_model equidistant"
        )
    return float(solution[0]), solution[1:] / solution[0]
