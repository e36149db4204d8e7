"""Tracks of points in the image, by interacting multiple models (IMM).

A slow motion needs a filter with a small process noise, a fast motion one with a large one. Each landmark therefore has
several constant-velocity Kalman filters ("models") with different white-noise accelerations, combined by the
interacting multiple model algorithm (Blom, Bar-Shalom, The interacting multiple model algorithm for systems with
Markovian switching coefficients, 1988; Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, sec. 11.6.6).

Between frames the state of a model is eight numbers: its probability and, multiplied by the probability and relative
to the track's merged position and velocity, the means of x, y, v_x, v_y and the second moments pp, pv, vv, each summed
over both coordinates. In this form, mixing and prediction are one product with a small matrix each. Landmarks are the
last axis of all arrays, which is fastest in numpy.
"""

from __future__ import annotations

import math
from copy import copy

import numpy as np

from lassokin_ros.core.image.projection import carried
from lassokin_ros.core.kernel import kernel

ACCELERATION_FACTORS = np.array([0.15, 0.5, 1.5, 4.0])
"""Accelerations of the models, as multiples of the typical one."""
SOJOURN_TIME = 0.8
"""s: mean time until a track switches to another model."""
FIRST_VELOCITY = 1.0
"""1/s: standard deviation of a new track's velocity, normalised image coordinates."""
UNUSED_VARIANCE = 1e30
"""Variance of a point that is not used; it then has no influence."""
MAX_SURPRISE = 100.0
"""Upper limit of the negative log-likelihood, so that not all probabilities become 0 at once."""
SHORT = 1e-3
"""s: interval over which velocities are transformed."""
MIN_SWITCHING = 1e-6
"""Smallest switching probability per frame, so that no probability becomes 0 for short steps."""

_MODELS = len(ACCELERATION_FACTORS)
_SAME, _ONES, _HALVES = np.eye(_MODELS), np.ones(_MODELS), np.full(_MODELS, 0.5)
#: Factors of the products pp, pv, vv of p and v; also of gain * covariance, which a correction subtracts from each.
_LEFT, _RIGHT = np.array([0, 0, 1]), np.array([0, 1, 1])


class KeypointTracks:
    """Tracks of l points. All are predicted and corrected at once."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._squares = (ACCELERATION_FACTORS**2)[:, None]
        self.reset()

    def reset(self) -> None:
        """Clear all tracks; `start` begins them again."""
        self._merged = np.zeros((2, 2, self._count))  # (position, velocity), (x, y), landmark
        self.position, self.velocity = self._merged.swapaxes(1, 2)
        """(l, 2) each; views of `_merged`."""
        self.variance = np.zeros(self._count)
        """(l,) variance of each coordinate of the position."""
        self._beliefs = np.zeros((8, _MODELS, self._count))
        self._beliefs[0] = 1 / _MODELS

    def start(self, which: np.ndarray, points: np.ndarray, variance: np.ndarray) -> None:
        """Restart the tracks `which` (l,) bool at points (l, 2) of variance (l,), with unknown velocity."""
        self.position[which], self.velocity[which], self.variance[which] = points[which], 0.0, variance[which]
        self._beliefs[..., which] = 0.0
        self._beliefs[0][:, which] = 1 / _MODELS
        self._beliefs[5][:, which] = 2 / _MODELS * variance[which]
        self._beliefs[7][:, which] = 2 / _MODELS * FIRST_VELOCITY**2

    def carry(self, rotation: np.ndarray, shift: np.ndarray) -> None:
        """Continue in the image of the camera after it has moved; see `projection.carried`."""
        before = self._merged[0].T
        position = carried(before, rotation, shift)
        self._merged[1] = (carried(before + SHORT * self._merged[1].T, rotation, shift) - position).T / SHORT
        self._merged[0] = position.T

    def follow(
        self,
        step: float,
        acceleration: float,
        points: np.ndarray,
        weights: np.ndarray,
        known: np.ndarray,
        unseen: np.ndarray,
        limits: tuple[float, float, float],
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Predict and correct all tracks with the compiled kernel if no track begins and no point is far from its own.

        Returns as `KeypointFilter.update`; None, and nothing has changed, if the kernel does not treat the frame.
        weights: (l,) of the points, 0 = missing. known, unseen: (l,) those of the filter, updated in place. limits:
        largest squared distance over variance of a point from its track, `MAX_GAP`, and the model error.
        """
        if not kernel.active:
            return None
        switching = _switching(step)
        mixing = step, 1 - (_MODELS - 1) * switching, switching, 2 * (acceleration * step) ** 2
        constants = np.array([*mixing, MAX_SURPRISE, UNUSED_VARIANCE, *limits])
        variance, filtered, kept = np.empty(self._count), np.empty((self._count, 2)), np.empty(self._count)
        own = known, unseen, self._beliefs, self._merged, variance, filtered, kept
        if not kernel.follow(points, weights, self._squares, constants, *own):
            return None
        self.variance = variance
        return filtered, kept

    def predict(self, step: float, acceleration: float) -> None:
        """Predict by step, s. acceleration: standard deviation of a typical track's, normalised units / s^2."""
        switching = _switching(step)
        stays = switching + (1 - _MODELS * switching) * _SAME
        mixed = np.empty((9, _MODELS, self._count))
        np.matmul(stays, self._beliefs, out=mixed[:8])
        np.multiply(self._squares, mixed[0], out=mixed[8])
        self._beliefs = _prediction_matrix(step, acceleration).dot(mixed.reshape(9, -1)).reshape(8, _MODELS, -1)
        self._merged[0] += step * self._merged[1]
        self.variance = _HALVES.dot(self._beliefs[5])

    def ahead(self, step: float, acceleration: float) -> tuple[np.ndarray, np.ndarray]:
        """(positions (l, 2), variances (l,)) predicted by step, s, as by `predict`; the tracks do not change."""
        other = copy(self)
        other._merged = self._merged.copy()
        other.predict(step, acceleration)
        return other._merged[0].T.copy(), other.variance

    def correct(self, used: np.ndarray, innovation: np.ndarray, variance: np.ndarray) -> None:
        """Correct the tracks `used` (l,) bool by points of variance (l,). innovation: (l, 2), point - position."""
        beliefs = self._beliefs
        chances, rows = beliefs[0], beliefs[1:] / beliefs[0]
        means, covariance = rows[:4].reshape(2, 2, _MODELS, -1), rows[4:]  # (pv, xy, model, l); (pp pv vv, model, l)
        covariance -= _moments(means)
        own = innovation.T[:, None] - means[0]
        spread = covariance[0] + np.where(used, 2 * variance, UNUSED_VARIANCE)
        squares = own * own
        surprise = (squares[0] + squares[1]) / spread
        chances *= np.exp(-np.minimum(surprise, MAX_SURPRISE)) / spread
        chances /= _ONES.dot(chances)
        gains = covariance[:2] / spread
        means += gains[:, None] * own
        covariance -= gains.take(_LEFT, axis=0) * covariance.take(_RIGHT, axis=0)
        merged = _ONES @ (chances * means)
        means -= merged[:, :, None]
        covariance += _moments(means)
        np.multiply(chances, rows, out=beliefs[1:])
        self._merged += merged
        self.variance = _HALVES.dot(beliefs[5])


def _prediction_matrix(step: float, acceleration: float) -> np.ndarray:
    """(8, 9) prediction matrix for the eight numbers of a model and probability * relative acceleration^2."""
    transition, noise = np.eye(8, 9), 2 * (acceleration * step) ** 2
    transition[1, 3] = transition[2, 4] = transition[6, 7] = step
    transition[5, 6], transition[5, 7] = 2 * step, step * step
    transition[5, 8], transition[6, 8], transition[7, 8] = noise * step * step / 4, noise * step / 2, noise
    return transition


def _switching(step: float) -> float:
    """Probability, not 0, that a track has switched to a certain other model after step, s."""
    return max(1 - math.exp(-step / SOJOURN_TIME), MIN_SWITCHING) / (_MODELS - 1)


def _moments(means: np.ndarray) -> np.ndarray:
    """(3, ...): contribution of the means (2, 2, ...), (position, velocity) x (x, y), to pp, pv, vv."""
    products = means.take(_LEFT, axis=0) * means.take(_RIGHT, axis=0)
    return np.asarray(products[:, 0] + products[:, 1])
