"""The base class of the pieces of evidence that make up a frame's lasso, each with its rows and its cost.

A frame's problem is || z - J [Omega; x] ||^2 plus the l1 term, with Omega the live degrees of freedom and x the
translation (the paper's lasso, rebuilt in docs/method.md). Each `Evidence` gives some rows of J and z, in units of its
own standard deviation, and the matching cost: a negative log-likelihood. First frame, increment, certificate, learning
and uncertainty use the same pieces.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.image.frame_data import FrameData


@dataclass(eq=False)
class Posture:
    """theta: (..., joints, 3) rad, rotation vectors of the prior's joints. residual: (..., k), of the prior's rows."""

    theta: np.ndarray
    residual: np.ndarray


@dataclass(eq=False)
class EvaluatedState:
    """One or several states with pose and posture, which both the cost and the next linearisation use."""

    state: BodyState
    pose: BodyPose
    posture: Posture


@dataclass(eq=False)
class LinearisationPoint:
    """The states about which a frame is linearised, its measurements, and the robust weights.

    states: one state or several, shape (...). robust: factors (..., l) on the landmarks' squared errors, given their
    sizes in standard deviations. increment_jacobian: (..., n, 3, 3) right Jacobian of an increment already applied;
    Omega is then the total increment.
    """

    kinematics: Kinematics
    states: EvaluatedState
    frame: FrameData
    robust: Callable[[np.ndarray], np.ndarray]
    increment_jacobian: np.ndarray | None = None

    @cached_property
    def axes(self) -> np.ndarray:
        """(..., n, 3, 3): axes of each joint's three rotations in the matrix columns, in the frame of the skeleton."""
        orientations = self.states.pose.orientations
        return orientations if self.increment_jacobian is None else orientations @ self.increment_jacobian

    @cached_property
    def twists(self) -> np.ndarray:
        """(..., live, 6) spatial twists of the live degrees of freedom, see `kinematics.twists`."""
        return self.kinematics.live_twists(self.states.pose, self.axes)

    def landmark_columns(self, F: np.ndarray, columns: np.ndarray) -> None:
        """Fill `columns` (..., live + 3, m l) with the derivatives of F q_i, F (..., l, m, 3)."""
        self._point_columns(self.states.pose.landmarks, self.kinematics.layout.joints, F, columns)

    def joint_columns(self, joints: np.ndarray, F: np.ndarray, columns: np.ndarray) -> None:
        """Fill `columns` (..., live + 3, m k) with the derivatives of F p_j of k joints, F (..., k, m, 3)."""
        self._point_columns(self.states.pose.positions.take(joints, axis=-2), joints, F, columns)

    def _point_columns(self, points: np.ndarray, joints: np.ndarray, F: np.ndarray, columns: np.ndarray) -> None:
        root = self.states.pose.positions[..., 0, :]
        self.kinematics.point_columns(self.twists, root, points, joints, F, columns)


class Evidence(ABC):
    """One piece of evidence about a body's state, as rows of the frame's lasso.

    name: unique among the pieces of a tracker. count: number of its rows. Arrays may have leading axes (several
    states).
    """

    name: str
    count: int

    def present(self, frame: FrameData) -> bool:
        """Whether the frame has the data that this evidence needs. If not, it has no rows and no cost."""
        return True

    @abstractmethod
    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Write the rows about a state, in standard deviations, into both outputs.

        columns: (..., live + 3, count), J transposed, with the translation last. z: (..., count), the right sides.
        """

    @abstractmethod
    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) negative log-likelihood of each state, up to a constant."""

    def length_rows(
        self, columns: np.ndarray, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray | float:
        """(count, p) derivative of the rows' right sides, negative, with respect to the log-lengths, for one state.

        columns: (live + 3, count) as `linearise` wrote them. Zero for evidence from which calibration learns nothing.
        """
        return 0.0
