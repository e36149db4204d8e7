"""The prior of a limb's angles, conditional on the rest of the body: a few rows instead of those of the whole body.

If only a limb of t joints rotates, W (mean - theta) changes in 3 t directions only. With the QR decomposition of the
limb's columns, W_limb = Q C, its squared length is || C (m - theta_limb) ||^2 plus a constant. C^T C is the precision
of the limb's conditional distribution; its mean m is linear in theta of the other joints. The rows of the limb's limits
are those of `pose_prior`.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.rotations import logarithm, right_jacobian_inverse
from lassokin_ros.core.evidence.evidence import Posture
from lassokin_ros.core.evidence.pose_prior import PosePrior


class LimbPrior:
    """Rows of h limbs of up to t joints. Each limb has r rows; the last ones are 0 if a limb has fewer limits."""

    def __init__(self, prior: PosePrior, places: np.ndarray, known: np.ndarray) -> None:
        """places: (h, t) indices among the prior's joints. known: (h, t) bool, False if the prior has no such joint."""
        h, t = places.shape
        self._places, self._angles = places, 3 * t
        gaussian = np.zeros((h, 3 * t, 3 * t))
        #: C m = fixed - linear theta, with theta of all the prior's joints.
        self._fixed, linear = np.zeros((h, 3 * t)), np.zeros((h, 3 * t, prior.W.shape[1]))
        limits = []
        for limb in range(h):
            mine = np.flatnonzero(np.repeat(known[limb], 3))
            columns = (3 * places[limb][:, None] + np.arange(3)).reshape(-1)[mine]
            Q, C = np.linalg.qr(prior.W[:, columns])
            gaussian[limb][np.ix_(mine, mine)] = C
            linear[limb, mine] = Q.T @ prior.W
            linear[limb][np.ix_(mine, columns)] -= C
            self._fixed[limb, mine] = Q.T @ prior.whitened_mean
            rows = np.flatnonzero(prior.limits[:, columns].any(axis=1))
            limits.append((rows, mine, prior.limits[np.ix_(rows, columns)]))
        self._linear = np.ascontiguousarray(linear.reshape(-1, prior.W.shape[1]).T)
        self._stack(prior, gaussian, limits)

    def _stack(
        self, prior: PosePrior, gaussian: np.ndarray, limits: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    ) -> None:
        """Set the rows, and the ranges of the limits' values without cost."""
        h, angles, _ = gaussian.shape
        most = max(len(rows) for rows, *_ in limits)
        count = angles + most
        self._rows, self._low, self._high = np.zeros((h, count, angles)), np.zeros((h, most)), np.zeros((h, most))
        self._rows[:, :angles] = gaussian
        for limb, (rows, mine, axes) in enumerate(limits):
            own = np.arange(len(rows))
            self._rows[limb][np.ix_(angles + own, mine)] = axes
            self._low[limb, own], self._high[limb, own] = prior.low[rows], prior.high[rows]
        #: (h, t, 3, r).
        self._columns = self._rows.swapaxes(-1, -2).reshape(h, -1, 3, count).copy()

    def linearise(self, published: Posture, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transposed rows (..., h, 3 t, r), and right sides (2, ..., h, r): of the limbs, and of the published limbs.

        published: posture of the whole body. rotations: (..., h, t, 3, 3), local rotations of the limbs.
        """
        limbs, angles = rotations.shape[:-4] + self._fixed.shape, self._angles
        theta = np.empty((2, *rotations.shape[:-1]))
        theta[0], theta[1] = logarithm(rotations), published.theta.take(self._places, axis=-2)
        values = (self._rows @ theta.reshape(2, *limbs, 1))[..., 0]
        whole = published.theta.reshape(*limbs[:-2], -1)
        between = np.empty(values.shape)
        between[..., :angles] = self._fixed - whole.dot(self._linear).reshape(limbs)
        between[0, ..., angles:], between[1, ..., angles:] = self._low, self._high
        z = np.minimum(np.maximum(values, between[0]), between[1]) - values
        inner = right_jacobian_inverse(theta[0])
        columns = (inner.swapaxes(-1, -2) @ self._columns).reshape(*limbs, -1)
        np.copyto(columns[..., angles:], 0.0, where=z[0][..., None, angles:] == 0)
        return columns, z
