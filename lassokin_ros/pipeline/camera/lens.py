"""Conversion between pixels and normalised image coordinates. All later steps use normalised coordinates only."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from lassokin_ros.core.errors import CameraError
from msg_adapters.camera_info import Intrinsics

ITERATIONS, ACCURACY_PX = 100, 1e-9
LARGEST_MISS_PX = 0.5
"""px: an undistorted point must distort back to within this distance of its pixel. Otherwise the pixel lies outside the
range of the lens model."""


COUNTS = {
    "plumb_bob": (4, 5, 8, 12, 14),
    "rational_polynomial": (4, 5, 8, 12, 14),
    "equidistant": (4,),
}
"""Model -> numbers of coefficients that OpenCV takes."""


class Lens:
    """Camera matrix and distortion of one camera: pixels to the normalised coordinates of equation (7).

    K: (3, 3) px. D: coefficients in OpenCV's order. model: "plumb_bob", "rational_polynomial", "equidistant", or "" for
    no distortion (OpenCV is not needed then). Raises CameraError.
    """

    def __init__(self, K: np.ndarray, D: np.ndarray | None = None, model: str = "") -> None:
        self.K = np.array(K, dtype=float)
        self.D = np.zeros(0) if D is None else np.array(D, dtype=float)
        self.model = model
        if self.K.shape != (3, 3) or not np.isfinite(self.K).all() or self.K[0, 0] <= 0 or self.K[1, 1] <= 0:
            raise CameraError(f"K is {self.K.tolist()}; expected a finite 3 x 3 matrix with focal lengths above 0")
        _check_distortion(model, self.D)
        self._focal_lengths = self.K[[0, 1], [0, 1]]
        self._centre = self.K[:2, 2]
        self.size = (0, 0)
        """(width, height) px of the image, 0 if unknown."""
        if model:
            self._opencv  # noqa: B018  (a missing OpenCV is reported here, not in the first frame)

    @classmethod
    def from_intrinsics(cls, intrinsics: Intrinsics, rectified: bool = False) -> Lens:
        """Return the lens of the raw image, or of the rectified image (P, no distortion). Raises CameraError.

        With the rectified image the skeleton is expressed in the frame of the rectified camera. The baseline of the
        right camera of a stereo pair (P[3]) is not added.
        """
        if rectified and not intrinsics.P[0, 0] > 0:
            raise CameraError("camera_info has P[0] = 0; parameter 'rectified' needs a rectified camera's P")
        lens = cls(intrinsics.P[:, :3]) if rectified else cls(intrinsics.K, intrinsics.D, intrinsics.model)
        lens.size = intrinsics.width, intrinsics.height
        return lens

    @cached_property
    def focal(self) -> float:
        """px per normalised unit: geometric mean of fx and fy."""
        return float(np.sqrt(self._focal_lengths.prod()))

    @cached_property
    def _opencv(self) -> Any:
        """OpenCV, imported at the first lens with distortion. The import is slow and most cameras do not need it."""
        try:
            import cv2
        except ModuleNotFoundError:
            raise CameraError(
                f"the camera has a {self.model} lens, which needs OpenCV: pip install opencv-python-headless, or "
                "apt install python3-opencv"
            ) from None
        except (ImportError, MemoryError) as error:  # a library is missing, or there is no memory for it
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise CameraError(
                f"the camera has a {self.model} lens, which needs OpenCV; OpenCV is installed but cannot be loaded: "
                f"{reason}"
            ) from None
        return cv2

    def normalise(self, pixels: np.ndarray) -> np.ndarray:
        """Undistort pixels (l, 2) to normalised coordinates (l, 2). NaN stays NaN.

        A pixel outside the range of the lens model gives NaN.
        """
        if not self.model:
            normalised: np.ndarray = (pixels - self._centre) / self._focal_lengths
            return normalised
        seen = np.isfinite(pixels).all(axis=1)
        if 0 < np.count_nonzero(seen) == len(seen):
            return self._undistort_checked(pixels)
        result = np.full(pixels.shape, np.nan)
        if seen.any():
            result[seen] = self._undistort_checked(pixels[seen])
        return result

    def _undistort_checked(self, points: np.ndarray) -> np.ndarray:
        """Undistort finite pixels (k, 2); NaN outside the range of the lens model."""
        straight = self._undistort(points)
        with np.errstate(invalid="ignore"):
            good = (np.abs(self.distort(straight) - points) < LARGEST_MISS_PX).all(axis=1)
        if np.count_nonzero(good) < len(good):
            straight[~good] = np.nan
        return straight

    def _undistort(self, points: np.ndarray) -> np.ndarray:
        """Undistort finite pixels (k, 2) with OpenCV."""
        cv2 = self._opencv
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, ITERATIONS, ACCURACY_PX)
        source = points[:, None, :]
        if self.model == "equidistant":
            straight = cv2.fisheye.undistortPoints(source, self.K, self.D, criteria=criteria)
        elif hasattr(cv2, "undistortPointsIter"):  # OpenCV 3 and 4; in 5 its argument moved to undistortPoints
            straight = cv2.undistortPointsIter(source, self.K, self.D, None, None, criteria)
        else:
            straight = cv2.undistortPoints(source, self.K, self.D, criteria=criteria)
        result: np.ndarray = straight[:, 0, :]
        return result

    def distort(self, normalised: np.ndarray) -> np.ndarray:
        """Distort normalised coordinates (k, 2) to pixels (k, 2), the inverse of `normalise`."""
        if not self.model:
            return normalised * self._focal_lengths + self._centre
        cv2, zero = self._opencv, np.zeros(3)
        rays = np.ones((len(normalised), 1, 3))
        rays[:, 0, :2] = normalised
        np.copyto(rays, 1e9, where=~np.isfinite(rays))  # np.nan_to_num takes several times as long
        project = cv2.fisheye.projectPoints if self.model == "equidistant" else cv2.projectPoints
        pixels: np.ndarray = project(rays, zero, zero, self.K, self.D)[0].reshape(-1, 2)
        return pixels


def _check_distortion(model: str, D: np.ndarray) -> None:
    """Raise CameraError unless OpenCV can use the coefficients D with this model."""
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
