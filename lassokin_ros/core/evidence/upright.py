"""Uprightness and balance: weak priors that people stand, walk and sit upright, with the centre of mass above the feet.

One camera hardly observes a lean towards it: a leaning body with straight legs looks the same as a squatting one. Both
losses are Cauchy's, so that the weight decreases for a person who lies, or sits.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.roles import BALANCE_JOINTS, BONES, FEET, PELVIS
from lassokin_ros.core.body.rotations import hat
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import squared_norm
from lassokin_ros.core.observation import AXES

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


OFFSET_DEVIATION = 0.1
"""m: standard deviation of each horizontal coordinate of the centre of mass about the middle of the feet."""


class Balance(Evidence):
    """Rows for the increment of all live degrees of freedom. They are 0 for a skeleton without the `BALANCE_JOINTS`."""

    name, count = "balance", 3

    def __init__(self, kinematics: Kinematics) -> None:
        self._live = kinematics.live_index
        #: (n,) weights of the joint centres in (centre of mass - middle of the feet); their sum is 0.
        self.shares = _shares(kinematics.skeleton.joint_names)
        carried = kinematics.skeleton.ancestors.T * self.shares
        #: (n, n): weights of the joint centres in the lever arms.
        self.lever_shares = carried - np.diag(carried.sum(axis=1))

    def offset(self, positions: np.ndarray, up: np.ndarray) -> np.ndarray:
        """(..., 3) m: horizontal vector from the middle of the feet to the centre of mass.

        positions: (..., n, 3) m, joint centres; up: (3,) the vertical.
        """
        return np.asarray(self.shares.dot(positions).dot(_horizontal(up)))

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows. They do not depend on the translation."""
        columns[..., :-3, :], z[...] = self.rows(about.states.pose, about.frame.up, about.axes)
        columns[..., -3:, :] = 0.0

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) Cauchy's loss of the offset, 2 log(1 + offset^2 / (2 OFFSET_DEVIATION)^2)."""
        offset = self.offset(states.pose.positions, frame.up)
        return np.asarray(2 * np.log1p(squared_norm(offset) / (4 * OFFSET_DEVIATION**2)))

    def rows(self, pose: BodyPose, up: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(columns, z): rows (..., live, 3) and right sides (..., 3), in standard deviations.

        axes: (..., n, 3, 3) axes of the joints' increments. A rotation w of joint k changes the offset by w x a_k, with
        the lever arm a_k of all that the joint moves; along h by w^T hat(a_k) h.
        """
        offset = self.offset(pose.positions, up)
        weight = 1 / np.sqrt(OFFSET_DEVIATION**2 + 0.25 * squared_norm(offset))[..., None]
        torques = axes.swapaxes(-1, -2) @ hat(self.lever_shares @ pose.positions)
        torques = torques.reshape(*torques.shape[:-3], -1, 3).take(self._live, axis=-2)
        return torques @ (weight[..., None] * _horizontal(up)), -weight * offset


def _horizontal(up: np.ndarray) -> np.ndarray:
    """(3, 3) projection onto the horizontal plane."""
    return np.asarray(AXES - up[:, None] * up)


def _shares(names: tuple[str, ...]) -> np.ndarray:
    """(n,) weights of the joint centres in (centre of mass - middle of the feet); zeros if a joint is missing."""
    shares = np.zeros(len(names))
    if not set(names) >= BALANCE_JOINTS:
        return shares
    for bone in BONES:
        shares[names.index(bone.first)] += bone.mass * (1 - bone.centre)
        shares[names.index(bone.last)] += bone.mass * bone.centre
    shares /= shares.sum()
    shares[[names.index(joint) for joint in FEET]] -= 1 / len(FEET)
    return shares
