"""Feet: they are on the floor, or somewhere else; and one that stands does not move.

One camera hardly observes the distance. Where height and tilt of the camera are known, the height of an ankle above the
floor gives it. And the feet of the fitted body slide although their keypoints stand still: the ankle of each foot in
contact (see `learned.foot_contacts`) is held at its anchor. Both losses are Geman and McClure's: a foot on a stair, in
the air or on a chair, or an anchor that the image contradicts, has hardly any influence.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import squared_norm
from lassokin_ros.core.observation import AXES

ANKLE_HEIGHT = 0.05
"""Height of the ankle of a foot on the floor, in heights of the person."""
FLOOR_DEVIATION = 0.02
"""m: standard deviation of that height."""


class _Feet(Evidence):
    """Rows for both ankles, with Geman and McClure's loss of each one's error."""

    scale: float
    """Scale of the loss, in standard deviations."""

    def __init__(self, kinematics: Kinematics) -> None:
        """The skeleton must have the ankles."""
        self._kinematics = kinematics
        self._ankles = np.array([kinematics.skeleton.index(ankle) for ankle in ANKLES])

    @abstractmethod
    def _errors(self, states: EvaluatedState, frame: FrameData) -> tuple[np.ndarray, np.ndarray]:
        """(..., 2, d) errors in standard deviations; (2, d, 3) their negative derivatives by the ankles' places."""

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows, with the weights of the loss."""
        error, rows = self._errors(about.states, about.frame)
        weight = 1 / (1 + squared_norm(error)[..., None] / self.scale**2)
        about.joint_columns(self._ankles, weight[..., None] * rows, columns)
        z[...] = (weight * error).reshape(z.shape)

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) loss of both ankles."""
        square = squared_norm(self._errors(states, frame)[0])
        return np.asarray((0.5 * square / (1 + square / self.scale**2)).sum(-1))


class Floor(_Feet):
    """One row per ankle: (ANKLE_HEIGHT - its height above the floor) / FLOOR_DEVIATION.

    A floor that is stated 10 cm too high costs 2 mm; with a scale of 3, it costs 5.
    """

    name, count, scale = "feet on the floor", len(ANKLES), 2.0

    def present(self, frame: FrameData) -> bool:
        """Whether it is known where the floor is."""
        return frame.floor is not None

    def length_rows(
        self, columns: np.ndarray, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """(2, p): an ankle's motion changes its row as the translation does."""
        return np.asarray((columns[-3:].T[:, None] @ motion.joints[self._ankles])[:, 0])

    def _errors(self, states: EvaluatedState, frame: FrameData) -> tuple[np.ndarray, np.ndarray]:
        assert frame.floor is not None
        heights = states.pose.positions.take(self._ankles, axis=-2) @ frame.floor[:3] + frame.floor[3]
        error = (ANKLE_HEIGHT * self._kinematics.skeleton.height - heights) / FLOOR_DEVIATION
        return error[..., None], frame.floor[:3] / FLOOR_DEVIATION * np.ones((len(ANKLES), 1, 1))


class FootContact(_Feet):
    """Rows stiffness (anchor - ankle), three per foot; 0 for a foot that does not stand."""

    name, count, scale = "foot contact", 3 * len(ANKLES), 3.0

    def __init__(self, kinematics: Kinematics) -> None:
        super().__init__(kinematics)
        self._tables = self._ankles, kinematics.reach_of(self._ankles, 3), self.scale

    def kernel_input(self, frame: FrameData, row: int) -> tuple[Any, ...]:
        """Tables and data of a frame for the kernel, and the first of the rows."""
        return *self._tables, frame.anchors, frame.stiffness, row

    def present(self, frame: FrameData) -> bool:
        """Whether a foot is in contact."""
        return frame.anchors is not None

    def _errors(self, states: EvaluatedState, frame: FrameData) -> tuple[np.ndarray, np.ndarray]:
        assert frame.anchors is not None and frame.stiffness is not None
        away = frame.anchors - states.pose.positions.take(self._ankles, axis=-2)
        return frame.stiffness[:, None] * away, frame.stiffness[:, None, None] * AXES
