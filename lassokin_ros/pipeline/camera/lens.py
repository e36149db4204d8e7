"""Conversion between pixels and normalised image coordinates. All later steps use normalised coordinates only."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera.distortion import Distortion, make_distortion
from lassokin_ros.pipeline.camera.lens_check import border_points, faults_of
from msg_adapters.camera_info import Intrinsics

COUNTS = {
    "plumb_bob": (4, 5, 8, 12, 14),
    "rational_polynomial": (4, 5, 8, 12, 14),
    "equidistant": (4,),
}
"""Model -> numbers of coefficients."""


class Lens:
    """Camera matrix and distortion of one camera: pixels to the normalised coordinates of equation (7).

    K: (3, 3) px. D: coefficients in OpenCV's order. model: "plumb_bob", "rational_polynomial", "equidistant", or "" for
    no distortion. size: (width, height) px of the image, 0 if unknown. Raises CameraError, also for coefficients that
    no lens has.
    """

    def __init__(
        self, K: np.ndarray, D: np.ndarray | None = None, model: str = "", size: tuple[int, int] = (0, 0)
    ) -> None:
        self.K = np.array(K, dtype=float)
        self.D = np.zeros(0) if D is None else np.array(D, dtype=float)
        self.model = model
        if self.K.shape != (3, 3) or not np.isfinite(self.K).all() or self.K[0, 0] <= 0 or self.K[1, 1] <= 0:
            raise CameraError(f"K is {self.K.tolist()}; expected a finite 3 x 3 matrix with focal lengths above 0")
        _check_distortion(model, self.D)
        self._focal_lengths = self.K[[0, 1], [0, 1]]
        self._centre = self.K[:2, 2]
        self.size = int(size[0]), int(size[1])
        """(width, height) px of the image, 0 if unknown."""
        self._distortion = make_distortion(model, self.D) if model else None
        self.warning = "" if self._distortion is None else self._check_image(self._distortion)
        """What is unusual about the distortion, in words; empty if nothing is."""

    @classmethod
    def from_intrinsics(cls, intrinsics: Intrinsics, rectified: bool = False) -> Lens:
        """Return the lens of the raw image, or of the rectified image (P, no distortion). Raises CameraError.

        With the rectified image the skeleton is expressed in the frame of the rectified camera. The baseline of the
        right camera of a stereo pair (P[3]) is not added.
        """
        if rectified and not intrinsics.P[0, 0] > 0:
            raise CameraError("camera_info has P[0] = 0; parameter 'rectified' needs a rectified camera's P")
        size = intrinsics.width, intrinsics.height
        if rectified:
            return cls(intrinsics.P[:, :3], size=size)
        return cls(intrinsics.K, intrinsics.D, intrinsics.model, size)

    def _check_image(self, distortion: Distortion) -> str:
        """Return what is unusual about the distortion, see `lens_check`. Raises CameraError if no lens has it."""
        impossible, unusual = faults_of(
            lambda points: _pairs(distortion.undistort(_complex(points))),
            border_points(self.K, self.size),
            distortion.turns_back,
            self.model == "equidistant",
        )
        words = f"D = {self.D.tolist()} ({self.model})"
        if impossible:
            raise CameraError(
                f"{words} is not the distortion of a lens: {impossible}; expected coefficients of a calibration, in "
                "OpenCV's order"
            )
        return unusual and f"{words} is unusual for a lens: {unusual}; check the calibration"

    @property
    def intrinsics(self) -> Intrinsics:
        """The same camera as the session takes it."""
        P = np.hstack([self.K, np.zeros((3, 1))])
        return Intrinsics(self.K, self.D, self.model, np.eye(3), P, *self.size, frame_id="", warning=self.warning)

    @cached_property
    def focal(self) -> float:
        """px per normalised unit: geometric mean of fx and fy."""
        return float(np.sqrt(self._focal_lengths.prod()))

    def normalise(self, pixels: np.ndarray) -> np.ndarray:
        """Undistort pixels (l, 2) to normalised coordinates (l, 2). NaN stays NaN.

        A pixel outside the range of the lens model gives NaN.
        """
        normalised: np.ndarray = (pixels - self._centre) / self._focal_lengths
        if self._distortion is None:
            return normalised
        return _pairs(self._distortion.undistort(_complex(normalised)))

    def distort(self, normalised: np.ndarray) -> np.ndarray:
        """Distort normalised coordinates (k, 2) to pixels (k, 2), the inverse of `normalise`. NaN stays NaN."""
        if self._distortion is not None:
            normalised = _pairs(self._distortion.distort(_complex(normalised)))
        pixels: np.ndarray = normalised * self._focal_lengths + self._centre
        return pixels


def _complex(points: np.ndarray) -> np.ndarray:
    """Return points (k, 2) as complex numbers (k,)."""
    return np.ascontiguousarray(points, dtype=float).view(complex)[:, 0]


def _pairs(points: np.ndarray) -> np.ndarray:
    """Return complex numbers (k,) as points (k, 2)."""
    return points.view(float).reshape(-1, 2)


def _check_distortion(model: str, D: np.ndarray) -> None:
    """Raise CameraError unless the coefficients D fit the model."""
    if model not in ("", *COUNTS):
        raise CameraError(f"lens model '{model}'; expected plumb_bob, rational_polynomial or equidistant")
    if D.ndim != 1 or not np.isfinite(D).all():
        raise CameraError(f"D is {D.tolist()}; expected a list of finite distortion coefficients")
    if not model and D.any():
        raise CameraError(
            f"D has {len(D)} distortion coefficients but no lens model; expected Lens(K, D, model) with plumb_bob, "
            "rational_polynomial or equidistant"
        )
    if model and len(D) not in COUNTS[model]:
        expected = ", ".join(map(str, COUNTS[model]))
        raise CameraError(f"{model} with {len(D)} distortion coefficients D; expected {expected}")
