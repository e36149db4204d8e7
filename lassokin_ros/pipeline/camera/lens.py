"""Conversion between pixels and normalised image coordinates. All later steps use normalised coordinates only."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera.distortion import Equidistant, Polynomial
from msg_adapters.camera_info import Intrinsics, checked_camera
from msg_adapters.errors import AdapterError

LARGEST_STRETCH, UNUSUAL_STRETCH = 2.0, 1.3
"""Ratio of a point's distance from the principal point with and without distortion, from which no lens has it, and from
which it is a warning. Lenses with a cushion shape have up to 1.1; the others are below 1."""
INNER, USUAL = 0.5, 0.8
"""Share of the way from the principal point to the borders within which a model must be usable, and within which it
usually is: the models of wide lenses turn back near the borders."""


class Lens:
    """Camera matrix and distortion of one camera: pixels to the normalised coordinates of equation (7).

    K: (3, 3) px. D: coefficients in OpenCV's order. model: "plumb_bob", "rational_polynomial", "equidistant"; "" for no
    distortion, or for 5 coefficients or more, whose number tells the model. size: (width, height) px of the image, 0 if
    unknown. Raises CameraError for what the node refuses in camera_info: coefficients that no lens has, or a K that
    cannot be that of an image of this size.
    """

    def __init__(
        self, K: np.ndarray, D: np.ndarray | None = None, model: str = "", size: tuple[int, int] = (0, 0)
    ) -> None:
        try:
            K, D = np.array(K, dtype=float), np.zeros(0) if D is None else np.array(D, dtype=float)
        except (TypeError, ValueError) as error:
            raise CameraError(f"K or D are no arrays of numbers: {error}; expected (3, 3) and (c,)") from None
        if D.size == max(D.shape, default=0):
            D = D.ravel()  # OpenCV gives (1, c)
        if K.shape != (3, 3) or D.ndim != 1:
            raise CameraError(f"K has the shape {K.shape}, D {D.shape}; expected (3, 3) and a list of coefficients")
        try:
            self._set(*checked_camera(K, D, model, size), size)
        except AdapterError as error:
            raise CameraError(str(error)) from None

    def _set(self, K: np.ndarray, D: np.ndarray, model: str, warning: str, size: tuple[int, int]) -> None:
        """Use the result of `checked_camera`. Raises CameraError for a distortion that no lens has."""
        self.K, self.D, self.model = K, D, model
        self.in_pixels = False
        """True once keypoints were seen with it that are px for certain, and not percent of the image."""
        self._focal_lengths = self.K[[0, 1], [0, 1]]
        self._centre = self.K[:2, 2]
        self.size = int(size[0]), int(size[1])
        """(width, height) px of the image, 0 if unknown."""
        self._distortion: Polynomial | Equidistant | None = None
        if model:
            self._distortion = Equidistant(self.D) if model == "equidistant" else Polynomial(self.D)
        impossible, unusual = ("", "") if self._distortion is None else self._faults(self._distortion)
        words = f"D = {self.D.tolist()} ({self.model})"
        if impossible:
            raise CameraError(
                f"{words} is not the distortion of a lens: {impossible}; expected coefficients of a calibration, in "
                "OpenCV's order"
            )
        unusual = unusual and f"{words} is unusual for a lens: {unusual}; check the calibration"
        self.warning = warning or unusual
        """What is unusual about K or the distortion, in words; empty if nothing is."""

    @classmethod
    def from_intrinsics(cls, intrinsics: Intrinsics, rectified: bool = False) -> Lens:
        """Return the lens of the raw image, or of the rectified image (P, no distortion). Raises CameraError.

        With the rectified image the skeleton is expressed in the frame of the rectified camera. The baseline of the
        right camera of a stereo pair (P[3]) is not added.
        """
        if rectified and not intrinsics.P[0, 0] > 0:
            raise CameraError("camera_info has P[0] = 0; parameter 'rectified' needs a rectified camera's P")
        size = intrinsics.width, intrinsics.height
        lens = cls.__new__(cls)  # what `checked_camera` checks is that of the whole sensor; this may be a window of it
        if rectified:
            lens._set(intrinsics.P[:, :3], np.zeros(0), "", intrinsics.warning, size)
        else:
            lens._set(intrinsics.K, intrinsics.D, intrinsics.model, intrinsics.warning, size)
        return lens

    def scaled(self, factor: float) -> Lens:
        """Return the lens of the same image in another size: `factor` times as many pixels along each side."""
        K = np.diag([factor, factor, 1.0]) @ self.K
        K[:2, 2] += 0.5 * (factor - 1)  # the middle of the first pixel is (0, 0)
        size = round(factor * self.size[0]), round(factor * self.size[1])
        lens = Lens.__new__(Lens)
        lens._set(K, self.D, self.model, self.warning, size)
        return lens

    def _faults(self, distortion: Polynomial | Equidistant) -> tuple[str, str]:
        """Return why no lens has this distortion, and what is unusual about it, in words; empty if nothing is."""
        fisheye = self.model == "equidistant"
        far = np.where(np.array(self.size) > 0, self.size, 2 * self._centre) - self._centre
        (left, above), (right, below) = self._centre / self._focal_lengths, far / self._focal_lengths
        border = np.array([-left, -1j * above, right, 1j * below])  # beside, above and below the principal point
        points = np.concatenate([INNER * border, border])
        distances, straight = np.abs(points), np.abs(distortion.undistort(points))
        # A fisheye's image may end within the borders.
        beyond = distances > distortion.turns_back if fisheye else np.isnan(straight)
        if beyond[: len(border)].any():
            return "its image turns back near the principal point", ""
        straight = np.where(straight > 0, np.arctan(straight) if fisheye else straight, np.inf)  # NaN, too
        stretch = float((distances / straight).max())
        if stretch > LARGEST_STRETCH:
            return f"it moves points away from the principal point by a factor of {stretch:.3g}", ""
        if (USUAL * distances[len(border) :] > distortion.turns_back).any():
            return "", "its image turns back within the borders, so that points near these are lost"
        if stretch > UNUSUAL_STRETCH:
            return "", f"it moves points away from the principal point by a factor of {stretch:.2f}"
        return "", ""

    @property
    def intrinsics(self) -> Intrinsics:
        """The same camera as the session takes it."""
        P = np.hstack([self.K, np.zeros((3, 1))])
        return Intrinsics(self.K, self.D, self.model, np.eye(3), P, *self.size, frame_id="", warning=self.warning)

    @cached_property
    def focal(self) -> float:
        """px per normalised unit: geometric mean of fx and fy."""
        return float(np.sqrt(self._focal_lengths.prod()))

    @property
    def extent(self) -> tuple[float, float]:
        """(width, height) px of the image; twice the principal point if it is unknown."""
        width, height = self.size if min(self.size) > 0 else 2 * self._centre
        return float(width), float(height)

    def normalise(self, pixels: np.ndarray) -> np.ndarray:
        """Undistort pixels (l, 2) to normalised coordinates (l, 2). NaN stays NaN.

        A pixel outside the range of the lens model gives NaN; so does one whose coordinates are both 0 or -1, which
        detectors write for a point that they did not find.
        """
        x, y = pixels[:, 0], pixels[:, 1]
        if np.count_nonzero(missing := (x == y) & ((x == 0) | (x == -1))):
            pixels = np.where(missing[:, None], np.nan, pixels)
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
