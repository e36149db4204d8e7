"""The pose of one camera relative to another one, by the person whom both see.

A correction of a camera's pose, x_c' = exp(w) x_c + v, minimises the distances of the landmarks from the epipolar lines
of the other camera's (Sampson's approximation), with a prior around the given pose. The person's size fixes the scale,
which epipolar lines do not show.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.image.frame_data import View
from lassokin_ros.core.image.projection import MEDIAN_OF_NORMAL
from lassokin_ros.core.learned.height import SizeCheck
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.rig.setup import rays, sampson

GIVEN_DEVIATION = np.array([0.035, 0.035, 0.035, 0.03, 0.03, 0.03])
"""rad and m: standard deviation of a given pose, for rotation and translation."""


class Pairs(NamedTuple):
    """Frames that two cameras have seen; one frame without the first axis.

    a, b: (f, l, 2) normalised points of both. weights: (f, l) of their difference. rotation: (f, 3, 3) and translation:
    (f, 3) m, from the first to the second camera.
    """

    a: np.ndarray
    b: np.ndarray
    weights: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray


class EpipolarFit:
    """Fits corrections to pairs of views of one person."""

    def __init__(self, size: SizeCheck) -> None:
        """size: of the person's body."""
        self._size = size

    def solved(
        self, pairs: Pairs, correction: np.ndarray, deviation: np.ndarray, sized: bool, steps: int = 3
    ) -> np.ndarray:
        """Return the correction (6,) that fits all frames best, by Gauss-Newton from a start.

        deviation: (6,) of the given pose. sized: whether the size of the body in use counts: it is given, or was
        measured by other cameras.
        """
        share = math.sqrt(1 / len(pairs.a))  # all frames count as one: the errors of a detector last
        seen, step = pairs.weights.reshape(-1) > 0, 1e-5
        for _ in range(steps):
            base = self.residuals(pairs, correction)
            moved = [self.residuals(pairs, correction + step * unit) for unit in np.eye(6)]
            J = np.stack([(one[0] - base[0]) / step for one in moved], axis=-1).reshape(-1, 6)
            r = base[0].reshape(-1)
            # Errors that are larger than configured count less.
            scale = max(1.0, float(np.median(np.abs(r[seen]))) / MEDIAN_OF_NORMAL)
            J, r = J / scale, r / scale
            robust = share * np.minimum(1.0, 3 / np.maximum(np.abs(r), 1e-9))  # beyond 3 deviations less, with r^-2
            J, r = J * robust[:, None], r * robust
            H, g = J.T @ J, J.T @ r
            H[np.arange(6), np.arange(6)] += 1 / deviation**2
            g += correction / deviation**2
            if sized:
                # The logarithm of the person's size, with that of the proportions, has the deviation 0.1.
                row = np.array([(one[1] - base[1]) / step for one in moved]) / 0.1
                H += np.outer(row, row)
                g += row * base[1] / 0.1
            correction = correction - np.linalg.solve(H, g)
        return correction

    def misfit(self, pairs: Pairs, sized: bool) -> float:
        """Return the misfit of a pose; infinite if half of the limbs have no plausible length.

        It is the median distance from the epipolar lines, as a fraction of the person's size in the image, and half the
        logarithm of the size in space if that counts (`sized`).
        """
        distances, size, plausible = self.residuals(pairs, np.zeros(6))
        seen = pairs.weights > 0
        if plausible < 0.5:
            return math.inf
        shown = np.where(seen[..., None], pairs.b, np.nan)
        extent = np.linalg.norm(np.nanmax(shown, axis=1) - np.nanmin(shown, axis=1), axis=-1)[:, None]
        apart = float(np.median((np.abs(distances) / np.maximum(pairs.weights, 1e-9) / extent)[seen]))
        return apart + 0.5 * abs(size) * sized

    def residuals(self, pairs: Pairs, correction: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Return (f, l) distances from epipolar lines in standard deviations, and what `_log_size` returns."""
        weights, turn = pairs.weights, exponential(correction[None, :3])[0]
        R, t = turn @ pairs.rotation, pairs.translation @ turn.T + correction[3:]
        x, y = rays(pairs.a), rays(pairs.b)
        return weights * sampson(x, y, R, t), *self._log_size(x @ R.swapaxes(1, 2), y, t, weights > 0)

    def _log_size(self, turned: np.ndarray, y: np.ndarray, t: np.ndarray, seen: np.ndarray) -> tuple[float, float]:
        """Return the median logarithm of measured / given length of the limbs, and the share of limbs before both
        cameras and with a plausible length. A landmark is where its lines of sight meet, p = s R x + t and q = u y.
        """
        xx, yy, xy = (turned * turned).sum(-1), (y * y).sum(-1), (turned * y).sum(-1)
        xt, yt = (turned * t[:, None]).sum(-1), (y * t[:, None]).sum(-1)
        u = (xx * yt - xy * xt) / np.maximum(xx * yy - xy * xy, 1e-9)
        s = (xy * yt - yy * xt) / np.maximum(xx * yy - xy * xy, 1e-9)  # p = s R x + t is before the first camera, too
        found = self._size.ratios(u[..., None] * y, seen & (u > 0) & (s > 0))
        plausible = len(found) / max(self._size.limb_count(seen), 1)
        return (math.log(float(np.median(found))) if len(found) else 0.0), plausible


def stacked(frames: Iterable[Pairs]) -> Pairs:
    """Join frames."""
    return Pairs(*(np.stack(parts) for parts in zip(*frames)))


def pair_of(a: View, b: View, pose: CameraPose, first: CameraPose) -> Pairs | None:
    """The landmarks that both views show; None for too few. pose, first: of their cameras."""
    both = (a.weights > 0) & (b.weights > 0)
    if np.count_nonzero(both) < 6:
        return None
    weights = np.where(both, 1 / np.hypot(1 / np.maximum(a.weights, 1e-9), 1 / np.maximum(b.weights, 1e-9)), 0.0)
    relative = pose.relative_to(first)
    return Pairs(a.points, b.points, weights, relative.rotation, relative.translation)


def moved_by(pose: CameraPose, correction: np.ndarray) -> CameraPose:
    """Apply a correction (6,) to a pose."""
    turn = exponential(correction[None, :3])[0]
    return CameraPose(
        pose.name, turn @ pose.rotation, turn @ pose.translation + correction[3:], deviation=pose.deviation
    )


def relative_size(correction: np.ndarray) -> float:
    """Return the size of a correction (6,), in GIVEN_DEVIATION."""
    return float(np.linalg.norm(correction / GIVEN_DEVIATION))


def size_of(correction: np.ndarray) -> tuple[float, float]:
    """rad and m, of a correction (6,)."""
    return float(np.linalg.norm(correction[:3])), float(np.linalg.norm(correction[3:]))
