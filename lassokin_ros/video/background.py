"""How the camera turns from image to image, by the background: points of small grey images, followed by optical flow.

A far point at x (normalised) moves to zoom * project(R (x, 1)). R and the zoom are fitted to pairs of points, first by
RANSAC over pairs of them, then by Gauss-Newton with robust weights. Points are followed from a key image on, so that a
still camera does not drift; a new key image is taken when many of them are lost. No homography is fitted: it would also
explain the motion of a person.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lassokin_ros.core.body.rotations import exponential

LONGEST_SIDE = 400
"""px: the small images' longer side at most; they are smaller than the image by a whole number, which is fast."""
CONTRAST_PX = 21
"""px: size of the window in which the local contrast is made even, which takes out flicker and exposure."""
MOST_POINTS, FEWEST_POINTS, FEWEST_INLIERS = 100, 12, 8
INLIER_PX, BACK_PX = 1.2, 0.7
"""px: residual of a point that fits; distance between a point and where it comes back to, forth and back."""
PAIRS = 40
"""Pairs of points tried by RANSAC."""
GROWN, ABOVE = 0.12, 0.16
"""Shares of a person's size by which the box is grown to the sides and below, and above, where the head's top is."""
LOST = 0.5
"""Share of the points of a key image that must be left."""
_FLOW: Any = {"winSize": (15, 15), "maxLevel": 3, "criteria": (3, 12, 0.03)}


@dataclass(frozen=True, eq=False)
class Turn:
    """The camera at an image: rotation (3, 3) of points from the first image's frame to this one's, and log zoom.

    points: number of points of the image before.
    """

    rotation: np.ndarray
    zoom: float
    points: int


def small(rgb: np.ndarray) -> np.ndarray:
    """Return an image (height, width, 3) uint8 with a longer side of up to LONGEST_SIDE."""
    import cv2

    factor = -(-max(rgb.shape[:2]) // LONGEST_SIDE)
    height, width = (max(1, side // factor) for side in rgb.shape[:2])
    inside = rgb[: height * factor, : width * factor]
    return np.asarray(cv2.resize(inside, (width, height), interpolation=cv2.INTER_AREA))


def even_grey(rgb: np.ndarray) -> np.ndarray:
    """Return a small image as a grey one (height, width) uint8 with even local contrast."""
    import cv2

    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    window = (CONTRAST_PX, CONTRAST_PX)
    apart = grey - cv2.blur(grey, window)
    spread = np.sqrt(np.maximum(cv2.blur(apart * apart, window), 0.0)) + 8.0
    return np.asarray(np.clip(128 + 40 * apart / spread, 0, 255).astype(np.uint8))


def background(shape: tuple[int, int], boxes: np.ndarray, margins: np.ndarray) -> np.ndarray:
    """Return 255 where the background is, 0 at people and black bars.

    shape: of the small image. boxes: (p, 2, 2) px of it, first and last corner of each person. margins: (2,) px of the
    bars at each side, x and y.
    """
    mask = np.zeros(shape, np.uint8)
    left, top = (int(np.ceil(margin + 4)) if margin > 1 else 0 for margin in margins)
    mask[top : shape[0] - top, left : shape[1] - left] = 255
    for low, high in boxes:
        size = float((high - low).max())
        x0, y0 = np.floor(low - size * np.array([GROWN, ABOVE])).astype(int)
        x1, y1 = np.ceil(high + size * GROWN).astype(int)
        mask[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = 0
    return mask


class Background:
    """The points of the background of one shot."""

    def __init__(self, focal: float, centre: np.ndarray) -> None:
        """focal: px and centre: (2,) px, of the small images."""
        self._focal, self._centre = focal, centre
        self._random = np.random.default_rng(0)
        self._grey: np.ndarray | None = None
        self._rotation, self._zoom = np.eye(3), 0.0
        self._key = self._since = (np.eye(3), 0.0)  # rotation and log zoom up to the key image, and since it
        self._first = self._points = np.zeros((0, 2), np.float32)  # in the key image, and in the last one
        self._count = 0

    def step(self, grey: np.ndarray, mask: np.ndarray) -> Turn:
        """Use the next image."""
        if self._grey is None:
            self._take_key(grey, mask)
            return Turn(self._rotation, self._zoom, len(self._points))
        followed, good = _followed(self._grey, grey, self._points)
        count = len(self._points)
        before, after = self._normalised(self._points[good]), self._normalised(followed[good])
        turn, zoom, fits = self._fitted(before, after, np.eye(3), 0.0, True)
        inside = good.copy()
        at = followed.round().astype(int)
        inside[good] &= mask[at[good, 1], at[good, 0]] > 0
        key, now = self._normalised(self._first[inside]), self._normalised(followed[inside])
        if fits.sum() >= FEWEST_INLIERS:
            self._since = turn @ self._since[0], zoom + self._since[1]
        fits_key = np.zeros(0, bool)
        if len(key) >= FEWEST_INLIERS:
            rotation, size, fits_key = self._fitted(key, now, *self._since, False)
            if fits_key.sum() >= FEWEST_INLIERS:
                self._since = rotation, size
        self._rotation, self._zoom = self._since[0] @ self._key[0], self._since[1] + self._key[1]
        self._first, self._points, self._grey = self._first[inside], followed[inside], grey
        few = len(self._points) < max(LOST * self._count, FEWEST_POINTS)
        if few or (len(fits_key) and fits_key.mean() < 0.6):
            self._take_key(grey, mask)
        return Turn(self._rotation, self._zoom, count)

    def _take_key(self, grey: np.ndarray, mask: np.ndarray) -> None:
        self._key, self._since = (self._rotation, self._zoom), (np.eye(3), 0.0)
        self._first = self._points = points_of(grey, mask)
        self._count, self._grey = len(self._points), grey

    def _normalised(self, points: np.ndarray) -> np.ndarray:
        """Return points (k, 2) px as normalised, without the zoom up to the key image."""
        return np.asarray((points - self._centre) / self._focal)

    def _fitted(
        self, x: np.ndarray, y: np.ndarray, rotation: np.ndarray, zoom: float, search: bool
    ) -> tuple[np.ndarray, float, np.ndarray]:
        """Return rotation, log zoom and which points fit, from a start. x, y: (k, 2). search: by RANSAC first."""
        tolerance = INLIER_PX / self._focal
        if len(x) < 6:
            return rotation, zoom, np.zeros(len(x), bool)
        weights = np.ones(len(x))
        if search:
            J, apart = _jacobian(x), y - x
            i, j = self._random.integers(0, len(x), (2, PAIRS))
            rows = np.concatenate([J[i], J[j]], axis=1)
            right = np.concatenate([apart[i], apart[j]], axis=1)
            square = rows.swapaxes(1, 2) @ rows + 1e-12 * np.eye(4)
            steps = np.linalg.solve(square, rows.swapaxes(1, 2) @ right[..., None])[..., 0]
            steps = np.vstack([np.zeros(4), steps])
            error = np.linalg.norm(np.einsum("nij,kj->kni", J, steps) - apart, axis=2)
            best = int(np.minimum(error, 2 * tolerance).sum(axis=1).argmin())
            rotation, zoom = exponential(steps[best, None, :3])[0], float(steps[best, 3])
            weights = (error[best] < 2 * tolerance).astype(float)
        for number in range(4):
            moved = _moved(x, rotation, zoom)
            apart = y - moved
            robust = 1 / (1 + ((apart**2).sum(axis=1) / tolerance**2)) ** 2
            J = _jacobian(moved)
            weighted = (robust * weights if number == 0 else robust)[:, None, None] * J
            H = np.einsum("nij,nik->jk", weighted, J) + np.diag([1e-9, 1e-9, 1e-9, 1e-6])
            step = np.linalg.solve(H, np.einsum("nij,ni->j", weighted, apart))
            rotation, zoom = exponential(step[None, :3])[0] @ rotation, zoom + float(step[3])
        return rotation, zoom, np.linalg.norm(y - _moved(x, rotation, zoom), axis=1) < tolerance


def followed_share(first: np.ndarray, second: np.ndarray, least: int) -> float:
    """Return the share of the points of an image, people included, that another one shows; 1 with less than `least`."""
    points = points_of(first, np.full(first.shape, 255, np.uint8))
    return float(_followed(first, second, points)[1].mean()) if len(points) >= least else 1.0


def points_of(grey: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return points (k, 2) px that can be followed."""
    import cv2

    found = cv2.goodFeaturesToTrack(grey, MOST_POINTS, 0.02, 8, mask=mask, blockSize=5)
    return np.zeros((0, 2), np.float32) if found is None else np.asarray(found[:, 0])


def _followed(first: np.ndarray, second: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (k, 2) px in the second image, and whether they were found, come back, and are inside."""
    import cv2

    if len(points) == 0:
        return points, np.zeros(0, bool)
    there: Any
    back: Any
    there, found, _ = cv2.calcOpticalFlowPyrLK(  # type: ignore[call-overload]
        first, second, points[:, None], None, **_FLOW
    )
    back, again, _ = cv2.calcOpticalFlowPyrLK(
        second, first, there, points[:, None].copy(), flags=cv2.OPTFLOW_USE_INITIAL_FLOW, **_FLOW
    )
    there = there[:, 0]
    good = (found.ravel() == 1) & (again.ravel() == 1) & (np.linalg.norm(back[:, 0] - points, axis=1) < BACK_PX)
    limits = np.array([second.shape[1], second.shape[0]]) - 1
    return there, good & (there >= 0).all(axis=1) & (there.round() <= limits).all(axis=1)


def _jacobian(x: np.ndarray) -> np.ndarray:
    """Return the derivative (k, 2, 4) of far points by the rotation vector of the points, rad, and the log zoom."""
    u, v = x.T
    J = np.empty((len(x), 2, 4))
    J[:, 0, 0], J[:, 0, 1], J[:, 0, 2], J[:, 0, 3] = -u * v, 1 + u * u, -v, u
    J[:, 1, 0], J[:, 1, 1], J[:, 1, 2], J[:, 1, 3] = -(1 + v * v), u * v, u, v
    return J


def _moved(x: np.ndarray, rotation: np.ndarray, zoom: float) -> np.ndarray:
    turned = np.column_stack([x, np.ones(len(x))]) @ rotation.T
    return np.asarray(np.exp(zoom) * turned[:, :2] / turned[:, 2:])
