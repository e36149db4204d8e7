"""Uprightness: a weak prior that people stand, walk and sit upright.

It is used for a tree whose root is the pelvis, as a hand alone may point anywhere. One camera hardly observes a lean
towards it. The residual compares the pelvis' y axis with the vertical. The loss is Cauchy's, so that the weight
decreases for large leans: a person may lie. Without it, the first frame of the validation people has 46.8 instead of
44.7 mm.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.roles import PELVIS
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import squared_norm

LEAN_DEVIATION = 0.12
"""rad: standard deviation of the lean."""


class Upright(Evidence):
    """Rows for the root's rotation."""

    name, count = "upright", 3

    def __init__(self, kinematics: Kinematics) -> None:
        self.deviation = LEAN_DEVIATION if kinematics.skeleton.joint_names[0] == PELVIS else np.inf
        """rad: infinite, so that the rows are 0, unless the root is the pelvis."""

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows. They depend on the root's rotation only."""
        rows, z[...] = upright_rows(about.states.state.rotations[..., 0, :, :], about.frame.up, self.deviation)
        if about.increment_jacobian is not None:
            rows = rows @ about.increment_jacobian[..., 0, :, :]
        root = about.kinematics.live_root
        columns[..., : len(root), :] = rows.swapaxes(-1, -2).take(root, axis=-2)
        columns[..., len(root) :, :] = 0.0

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) Cauchy's loss, 2 log(1 + lean^2 / (2 deviation)^2), which gives the rows' weights."""
        lean = states.state.rotations[..., 0, :, 1] - frame.up
        return np.asarray(2 * np.log1p(squared_norm(lean) / (4 * self.deviation**2)))


def upright_rows(root: np.ndarray, up: np.ndarray, deviation: float = LEAN_DEVIATION) -> tuple[np.ndarray, np.ndarray]:
    """(A, z): rows (..., 3, 3) for the root's increment and right sides (..., 3), in standard deviations.

    root: (..., 3, 3); up: (3,). The lean is R e_y - up; with R exp(hat(w)) it changes by -R hat(e_y) w =
    [R e_z, 0, -R e_x] w.
    """
    lean = root[..., :, 1] - up
    weight = 1 / np.sqrt(deviation**2 + 0.25 * squared_norm(lean))[..., None]
    return root[..., ::-1] * (weight * [1.0, 0.0, -1.0])[..., None, :], -weight * lean
