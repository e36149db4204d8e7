"""All that one frame says of a state, or of several at once: rows of image, prior, limits, uprightness and balance.

Tracker, challengers, initialisation and calibration linearise the same problem,

    || z - J [Omega; x] ||^2,   Omega the live degrees of freedom, x the translation,

each with its own view of points that fit badly.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Callable

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.evidence.balance import Balance
from lassokin_ros.core.evidence.pose_prior import Posture, PriorRows
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.core.image.projection import project, project_with_jacobian
from lassokin_ros.core.image.robust_loss import capped_cost, norm, squared_norm


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """States with what follows from each by itself, needed by a frame that leads to them and by the next."""

    state: BodyState
    pose: BodyPose
    posture: Posture

    def __getitem__(self, index: int | np.ndarray) -> Hypotheses:
        """One, or those of several indices."""
        state, pose = self.state, self.pose
        return Hypotheses(
            BodyState(state.rotations[index], state.translation[index]),
            BodyPose(pose.orientations[index], pose.positions[index], pose.landmarks[index]),
            Posture(self.posture.theta[index], self.posture.residual[index]),
        )

    def __setitem__(self, index: int, one: Hypotheses) -> None:
        for mine, theirs in ((self.state, one.state), (self.pose, one.pose), (self.posture, one.posture)):
            for name, array in vars(mine).items():
                array[index] = getattr(theirs, name)


@dataclass(frozen=True, eq=False)
class Rows:
    """columns: (..., live + 3, r), J with its columns as rows; z: (..., r); the first 2 l of r rows are the image's."""

    columns: np.ndarray
    z: np.ndarray


class FrameModel:
    """The rows for one kinematics; `prior` and `upright` are the tracker's own, which learns; `balance` goes by it."""

    def __init__(self, kinematics: Kinematics, prior: PriorRows, upright: Upright) -> None:
        self.kinematics, self.prior, self.upright = kinematics, prior, upright
        self.balance = Balance(kinematics, upright)
        #: Indices of the degrees of freedom that are asked for; the root's come first, which the prior does not know.
        self.live = np.flatnonzero(kinematics.live)

    @staticmethod
    def stack(several: Sequence[FrameModel]) -> FrameModel:
        """Of several people, each by what was learned of them: for k states of each, (people, k, ...)."""
        whole = copy(several[0])
        whole.kinematics = Kinematics.stack([rows.kinematics for rows in several])
        whole.prior = PriorRows.stack([rows.prior for rows in several])
        whole.upright = Upright.stack([rows.upright for rows in several])
        whole.balance = whole.balance.by(whole.upright)
        return whole

    def hypotheses(self, state: BodyState) -> Hypotheses:
        """Of states (..., n, 3, 3) and (..., 3), for the skeleton as it is now."""
        return Hypotheses(state, self.kinematics.pose(state), self.prior.posture(state.rotations))

    def linearise(
        self,
        about: Hypotheses,
        points: np.ndarray,
        weights: np.ndarray,
        robust: Callable[[np.ndarray], np.ndarray],
        turn: np.ndarray | None = None,
    ) -> Rows:
        """The rows about each hypothesis.

        points: (..., l, 2) normalised, any finite value where the weight is 0; weights: (..., l), 1 / standard
        deviation, 0 = missing; robust: factors on the landmarks' squared errors, of their sizes in standard deviations
        (see `robust.py`); turn: (..., n, 3, 3), the right Jacobian of an increment already made, of which Omega then
        is the total.
        """
        pose, count, first = about.pose, len(self.live), self.prior.first
        shape, images = pose.landmarks.shape[:-2], 2 * self.kinematics.landmark_count
        places, F = project_with_jacobian(pose.landmarks)
        error = points - places
        weights = weights * np.sqrt(robust(norm(error) * weights))
        F *= weights[..., None, None]
        error *= weights[..., None]
        upright, upright_z = self.upright.linearise(about.state.rotations[..., 0, :, :])
        axes = None
        if turn is not None:
            axes, upright = pose.orientations @ turn, upright @ turn[..., 0, :, :]
        balance, balance_z = self.balance.linearise(pose, axes)
        own = images + self.prior.count  # the upright rows come after these, and last the balance's
        columns = np.empty((*shape, count + 3, own + self.upright.count + self.balance.count))
        self.image_columns(pose, F, axes, columns[..., :images])
        columns[..., :first, images:own] = columns[..., count:, images:] = columns[..., first:count, own:-3] = 0.0
        columns[..., first:count, images:own] = self.prior.live_columns(about.posture, turn)
        columns[..., :first, own:-3] = upright.swapaxes(-1, -2).take(self.live[:first], axis=-2)
        columns[..., :count, -3:] = balance
        z = np.concatenate([error.reshape(*shape, images), about.posture.residual, upright_z, balance_z], axis=-1)
        return Rows(columns, z)

    def but_prior(self, count: int) -> np.ndarray:
        """Which of all `count` rows are not the prior's, nor its limits'."""
        images = 2 * self.kinematics.landmark_count
        return np.delete(np.arange(count), slice(images, images + self.prior.count))

    def image_columns(self, pose: BodyPose, F: np.ndarray, axes: np.ndarray | None, out: np.ndarray) -> None:
        """Fill `out` (..., live + 3, 2 l) with the image's columns, by weighted blocks F (..., l, 2, 3) of P."""
        rows, count = F.reshape(*F.shape[:-3], -1, 3), len(self.live)
        self.kinematics.live_columns(pose, rows, axes, out[..., :count, :])
        out[..., count:, :] = rows.swapaxes(-1, -2)

    def image_costs(self, pose: BodyPose, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(..., l) of each landmark, robust (see `capped_cost`)."""
        error = points - project(pose.landmarks)
        return capped_cost(norm(error) * weights)

    def own_cost(self, hypotheses: Hypotheses) -> np.ndarray:
        """(...,) by prior, uprightness and balance, whatever the image."""
        upright = self.upright.cost(hypotheses.state.rotations[..., 0, :, :])
        balance = self.balance.cost(self.balance.offset(hypotheses.pose.positions))
        return np.asarray(0.5 * squared_norm(hypotheses.posture.residual) + upright + balance)

    def cost(self, hypotheses: Hypotheses, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(...,) negative log-likelihood by image, prior, uprightness and balance."""
        return np.asarray(self.image_costs(hypotheses.pose, points, weights).sum(-1) + self.own_cost(hypotheses))
