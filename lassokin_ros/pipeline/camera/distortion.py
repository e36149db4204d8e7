"""The lens models of sensor_msgs/CameraInfo, as OpenCV defines them, and Kalibr's wide lenses as the nearest of them.

A point x, y is the complex number x + iy.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.errors import CameraError

ITERATIONS = 20
"""Newton steps at most. Inside the range of a lens model two or three are enough."""
ACCURACY = 1e-12
"""Residual at which the iteration ends, in normalised units."""
TOLERANCE = 1e-4
"""Largest residual of a result. Next to the limit of a model the iteration converges slowly."""


RADII = np.linspace(0.0, 12.0, 4097)
"""Normalised radii of the table of starting points, to 85 degrees off the optical axis."""
LEAST_RADIUS = 1e-300
"""Avoids a division by zero on the optical axis."""
MISSING = complex(np.nan, np.nan)


class Polynomial:
    """plumb_bob and rational_polynomial: with r^2 = |z|^2 and the radial factor R,

    w = z (R(r^2) + 2 Re(z conj(p))) + p r^2 + s1 r^2 + s2 r^4, R = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + ...)

    and then, for a tilted sensor, a homography. turns_back: distance from the principal point, distorted, at which the
    image of the model turns back; infinite if it does not. Points are (k,) complex, normalised.
    """

    def __init__(self, D: np.ndarray) -> None:
        """D: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]]."""
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y = np.pad(D, (0, 14 - len(D))).tolist()
        self._upper, self._lower = (k1, k2, k3), (k4, k5, k6)
        self._tangential, self._prism = complex(p2, p1), (complex(s1, s3), complex(s2, s4))
        self._tilt = _tilt(tau_x, tau_y) if tau_x or tau_y else None
        bent = RADII * self._radial(RADII**2)[0]
        turn = np.flatnonzero(~(np.diff(bent) > 0))  # where the image of the model turns back
        count = turn[0] + 1 if len(turn) else len(bent)
        self._bent_radii, self._radii = bent[:count], RADII[:count]
        self.turns_back = float(bent[turn[0]]) if len(turn) else np.inf

    def distort(self, straight: np.ndarray) -> np.ndarray:
        """Return the distorted points of straight ones."""
        with np.errstate(invalid="ignore", over="ignore"):
            r2 = straight.real**2 + straight.imag**2
            bent = self._bend(straight, r2, self._factor(straight, self._radial(r2)[0]))
        return bent if self._tilt is None else _mapped(self._tilt, bent)

    def undistort(self, distorted: np.ndarray) -> np.ndarray:
        """Return the points that `distort` moves to the given ones, NaN outside the range of the model.

        Newton's method; the radial part alone gives the starting points.
        """
        with np.errstate(all="ignore"):
            target = distorted if self._tilt is None else _mapped(np.linalg.inv(self._tilt), distorted)
            radius = np.abs(target)
            z = target * (np.interp(radius, self._bent_radii, self._radii) / np.maximum(radius, LEAST_RADIUS))
            for _ in range(ITERATIONS):
                r2 = z.real**2 + z.imag**2
                radial, slope = self._radial(r2)
                factor = self._factor(z, radial)
                missing = target - self._bend(z, r2, factor)
                along, across = self._derivatives(z, r2, factor, slope)
                along_conjugate = along.conj()
                det = (along * along_conjugate - across * across.conj()).real
                if not np.count_nonzero(np.abs(missing) > ACCURACY):
                    break
                z = z + (along_conjugate * missing - across * missing.conj()) / det
            # Beyond the radius at which the image turns back, one of the last two is negative.
            inside = (np.abs(missing) <= TOLERANCE) & (det > 0) & (along.real > 0)
        return np.where(inside, z, MISSING)

    def _radial(self, r2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return R and its derivative by r^2."""
        upper, upper_slope = _cubic(r2, *self._upper)
        if not any(self._lower):
            return upper, upper_slope
        lower, lower_slope = _cubic(r2, *self._lower)
        radial = upper / lower
        return radial, (upper_slope - radial * lower_slope) / lower

    def _factor(self, z: np.ndarray, radial: np.ndarray) -> np.ndarray:
        """Return R + 2 Re(z conj(p))."""
        p = 2 * self._tangential
        factor: np.ndarray = radial + (z.real * p.real + z.imag * p.imag)
        return factor

    def _bend(self, z: np.ndarray, r2: np.ndarray, factor: np.ndarray) -> np.ndarray:
        p, (s1, s2) = self._tangential, self._prism
        bent: np.ndarray = z * factor + r2 * (p + s1 + s2 * r2 if s2 else p + s1)
        return bent

    def _derivatives(
        self, z: np.ndarray, r2: np.ndarray, factor: np.ndarray, slope: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return A and B of the differential dw = A dz + B conj(dz)."""
        p, (s1, s2) = self._tangential, self._prism
        offset = p + s1 + 2 * s2 * r2 if s2 else p + s1
        along = factor + slope * r2 + z * p.conjugate() + z.conj() * offset
        return along, z * (slope * z + p + offset)


def _cubic(r2: np.ndarray, a: float, b: float, c: float) -> tuple[np.ndarray, np.ndarray]:
    """Return 1 + a r^2 + b r^4 + c r^6 and its derivative by r^2."""
    if c == 0:
        return 1 + r2 * (a + r2 * b), a + r2 * (2 * b)
    return 1 + r2 * (a + r2 * (b + r2 * c)), a + r2 * (2 * b + r2 * 3 * c)


class Equidistant:
    """The fisheye model: w = z theta_d / |z|, theta = atan |z|, theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8)."""

    def __init__(self, D: np.ndarray) -> None:
        """D: k1 k2 k3 k4."""
        self._k = D.tolist()
        with np.errstate(all="ignore"):
            bent, slope = self._bent(np.linspace(0.0, np.pi / 2, 1025))
        turn = np.flatnonzero(~(slope > 0))
        self.turns_back = float(bent[turn[0]]) if len(turn) else np.inf

    def distort(self, straight: np.ndarray) -> np.ndarray:
        """See Polynomial.distort."""
        radius = np.abs(straight)
        theta = np.arctan(radius)
        bent = self._bent(theta)[0]
        return straight * (bent / np.maximum(radius, LEAST_RADIUS))

    def undistort(self, distorted: np.ndarray) -> np.ndarray:
        """See Polynomial.undistort. Newton's method in theta."""
        radius = np.abs(distorted)
        theta = np.minimum(radius, np.pi / 2)
        with np.errstate(all="ignore"):
            for _ in range(ITERATIONS):
                bent, slope = self._bent(theta)
                missing = radius - bent
                if not np.count_nonzero(np.abs(missing) > ACCURACY):
                    break
                theta = theta + missing / slope
            inside = (np.abs(missing) <= TOLERANCE) & (slope > 0) & (theta >= 0) & (theta < np.pi / 2)
            scale = np.tan(theta) / np.maximum(radius, LEAST_RADIUS)
        return np.where(inside, distorted * scale, MISSING)

    def _bent(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return theta_d and its derivative by theta."""
        k1, k2, k3, k4 = self._k
        t2 = theta * theta
        bent: np.ndarray = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        slope: np.ndarray = 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
        return bent, slope


def _tilt(tau_x: float, tau_y: float) -> np.ndarray:
    """Return the homography (3, 3) of a sensor that is tilted by tau_x and tau_y, rad."""
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    R = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    return np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]]) @ R


def _mapped(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Apply a homography (3, 3) to complex points (k,)."""
    x, y, w = homography @ np.stack([points.real, points.imag, np.ones(len(points))])
    mapped: np.ndarray = (x + 1j * y) / w
    return mapped


WIDE_PARAMETERS = {"omni": 1, "ds": 2, "eucm": 2}
"""Numbers of parameters before fu, fv, pu, pv."""
WIDE_ANGLES = np.linspace(1e-3, np.radians(100), 1000)
"""rad"""
LARGEST_MISFIT_PX, LARGEST_TANGENTIAL = 0.5, 2e-3
"""Largest error of the equidistant lens within the image, px, and largest p1, p2 of radtan, which it has not."""


def nearest_equidistant(
    model: str, parameters: Sequence[float], radtan: Sequence[float], focal: float, farthest: float, name: str
) -> tuple[float, np.ndarray]:
    """Return the factor of the focal lengths and the coefficients D (4,) of the equidistant lens.

    radtan: k1, k2, p1, p2, or none. focal: px. farthest: px, of the image's corners from the principal point. name: of
    the file, for messages. Raises CameraError if no equidistant lens is near.
    """
    s, c = np.sin(WIDE_ANGLES), np.cos(WIDE_ANGLES)
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
    count = len(WIDE_ANGLES) if rising.all() else int(np.argmin(rising))
    count = min(count, int(np.searchsorted(radius[:count], farthest / focal)) + 1)
    if max(abs(p1), abs(p2)) > LARGEST_TANGENTIAL or count < 20:
        raise CameraError(
            f"camera '{name}': {model} with {list(parameters)} and {list(radtan)} is no lens that can be used"
        )
    theta, radius = WIDE_ANGLES[:count], radius[:count]
    columns = np.stack([theta ** (2 * power + 1) for power in range(5)], axis=1)
    solution, *_ = np.linalg.lstsq(columns, radius, rcond=None)
    misfit = focal * float(np.abs(columns @ solution - radius).max())
    if misfit > LARGEST_MISFIT_PX:
        raise CameraError(
            f"'{name}': {model} with {list(parameters)} is up to {misfit:.1f} px from an equidistant lens; "
            "expected a calibration with camera_model pinhole and distortion_model equidistant"
        )
    return float(solution[0]), solution[1:] / solution[0]
