"""The floor: feet are on it, or they are somewhere else.

Where height and tilt of the camera are known, the height of an ankle above the floor gives the distance, which one
camera hardly observes. The loss is Geman and McClure's: a foot on a stair, in the air or on a chair has hardly any
influence, and no contact has to be detected.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData

ANKLE_HEIGHT = 0.05
"""Height of the ankle of a foot on the floor, in heights of the person."""
DEVIATION = 0.02
"""m: standard deviation of that height."""
SCALE = 2.0
"""Scale of the loss, in standard deviations. A floor that is stated 10 cm too high costs 2 mm; with a scale of 3, it
costs 5."""


class Floor(Evidence):
    """One row per ankle: (ANKLE_HEIGHT - its height above the floor) / DEVIATION."""

    name, count = "feet on the floor", len(ANKLES)

    def __init__(self, kinematics: Kinematics) -> None:
        """The skeleton must have the ankles."""
        self._kinematics = kinematics
        self._ankles = np.array([kinematics.skeleton.index(ankle) for ankle in ANKLES])

    def present(self, frame: FrameData) -> bool:
        """Whether it is known where the floor is."""
        return frame.floor is not None

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows, with the weights of the loss."""
        assert about.frame.floor is not None
        error = self._errors(about.states, about.frame)
        weight = 1 / (1 + error * error / SCALE**2)
        up = about.frame.floor[:3]
        about.joint_columns(self._ankles, (weight / DEVIATION)[..., None, None] * up, columns)
        z[...] = weight * error

    def length_rows(
        self, columns: np.ndarray, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """(2, p): an ankle's motion changes its row as the translation does."""
        return np.asarray((columns[-3:].T[:, None] @ motion.joints[self._ankles])[:, 0])

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) Geman and McClure's loss of each ankle's height."""
        square = self._errors(states, frame) ** 2
        return np.asarray((0.5 * square / (1 + square / SCALE**2)).sum(-1))

    def _errors(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(..., 2) standard deviations by which the ankles are too low."""
        assert frame.floor is not None
        heights = states.pose.positions.take(self._ankles, axis=-2) @ frame.floor[:3] + frame.floor[3]
        return np.asarray((ANKLE_HEIGHT * self._kinematics.skeleton.height - heights) / DEVIATION)
