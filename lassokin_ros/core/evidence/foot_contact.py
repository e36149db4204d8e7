"""Feet in contact: a foot that stands does not move, so its ankle stays where it has been.

One camera hardly observes the distance, so the feet of the fitted body slide although their keypoints stand still. The
rows hold the ankle of each foot in contact (see `learned.foot_contacts`) at its anchor. The loss is Geman and
McClure's: an anchor that the image contradicts has hardly any influence.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import squared_norm
from lassokin_ros.core.observation import AXES

SCALE = 3.0
"""Scale of the loss, in standard deviations."""


class FootContact(Evidence):
    """Rows (anchor - ankle) / deviation, three per foot; 0 for a foot without an anchor."""

    name, count = "foot contact", 3 * len(ANKLES)

    def __init__(self, kinematics: Kinematics) -> None:
        """The skeleton must have the ankles."""
        self._ankles = np.array([kinematics.skeleton.index(ankle) for ankle in ANKLES])

    def present(self, frame: FrameData) -> bool:
        """Whether a foot is in contact."""
        return frame.anchors is not None

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows, with the weights of the loss."""
        error, stiffness = self._errors(about.states, about.frame)
        weight = 1 / (1 + squared_norm(error)[..., None] / SCALE**2)
        about.joint_columns(self._ankles, (weight * stiffness)[..., None] * AXES, columns)
        z[...] = (weight * error).reshape(z.shape)

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) Geman and McClure's loss of each ankle's distance from its anchor."""
        square = squared_norm(self._errors(states, frame)[0])
        return np.asarray((0.5 * square / (1 + square / SCALE**2)).sum(-1))

    def _errors(self, states: EvaluatedState, frame: FrameData) -> tuple[np.ndarray, np.ndarray]:
        """(..., 2, 3) errors in standard deviations, and (2, 1) 1 / m: 1 / standard deviation; 0 without an anchor."""
        assert frame.anchors is not None and frame.anchor_deviation is not None
        held = np.isfinite(frame.anchors[:, :1])
        anchors, stiffness = np.where(held, frame.anchors, 0.0), held / frame.anchor_deviation[:, None]
        places = states.pose.positions.take(self._ankles, axis=-2)
        return stiffness * (anchors - places), stiffness
