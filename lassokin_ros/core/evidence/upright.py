"""A weak belief that people stand, walk and sit upright: one camera hardly sees how far a body leans towards it.

The belief is about the pelvis' own vertical, compared with the vertical as the camera sees it. That one begins as the
camera's -y axis (a camera held level), or where its mount has it, and is learned from the tracked person, so a camera
that looks up or down is no lasting error. Its weight falls off for large leans, in the manner of Cauchy's loss: whoever
lies down, lies down.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from lassokin_ros.core.batch import stack_attribute
from lassokin_ros.core.body.rotations import exponential, hat
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import squared_norm

SPREAD = 0.12
"""rad: standard deviation of the lean."""
LEARNED_IN = 5.0
"""s: time constant with which the vertical follows the tracked person's."""
FIRST_LEARNED_IN = 0.5
"""s: the same at first; it grows with the time that a person has been seen. What is known at first, the camera's mount,
is often off by more than a person leans."""

TILT = 0.45
"""rad: how far up or down a camera may look of which nobody has said so. With flatter and steeper ones beside it, first
frames of cameras tilted by 30 degrees were worse, of those tilted by 15 or 45 hardly better."""
TILT_COST = 4.0
"""Negative log-likelihood of that beside the mount as it was said. With less, people who lean before a level camera are
taken for upright ones; with more, upright ones before a tilted camera for people who lean."""

LONGEST_STEP = 0.2
"""s: the most that one frame counts for, however long nobody was seen before it."""

_RIGHT, _SIGHT = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
_ACROSS = np.array([1.0, 0.0, -1.0])  # of [e_z, e_y, e_x], what turns the vertical


class Upright(Evidence):
    """Rows for the root's rotation, and the learned vertical (3,), a unit vector in the camera frame."""

    count = 3

    def __init__(self, roll: float = 0.0, pitch: float = 0.0) -> None:
        self.mounted(roll, pitch)

    @classmethod
    def stack(cls, several: Sequence[Upright]) -> Upright:
        """Of several people, each with the vertical that was learned from them: for roots (people, k, 3, 3)."""
        return stack_attribute(several, "vertical")

    def mounted(self, roll: float, pitch: float) -> None:
        """Believe in a camera mounted like that, see `vertical_of`, and forget what was learned."""
        self._first = vertical_of(roll, pitch)
        self.reset()

    def reset(self) -> None:
        """Believe in the camera's mount again."""
        self.vertical = self._first
        self._seen = 0.0  # s

    @property
    def mount(self) -> np.ndarray:
        """(3,) the vertical by the camera's mount."""
        return self._first

    @property
    def learned_for(self) -> float:
        """Time in s for which the vertical has been learned."""
        return self._seen

    def adopt(self, others: Iterable[Upright]) -> None:
        """Take over what was learned by that one of others, behind the same camera, who saw people the longest."""
        longest = max(others, key=lambda other: other._seen, default=self)
        if longest._seen > 0:
            self.vertical, self._seen = longest.vertical, longest._seen

    def candidates(self) -> list[tuple[np.ndarray, float]]:
        """The verticals (3,) by which a first state may be sought, and what each costs, a negative log-likelihood.

        They are the mount's and those of cameras that look up or down from there; the learned one, when there is one.
        """
        if self._seen > 0:
            return [(self.vertical, 0.0)]
        across = hat(self._first) @ _SIGHT
        size = math.sqrt(across.dot(across))
        axis = across / size if size > 1e-3 else _RIGHT  # a camera that looks straight down has no other
        tilts = exponential(np.outer((TILT, -TILT), axis))
        return [(self._first, 0.0), *((tilt @ self._first, TILT_COST) for tilt in tilts)]

    def learn(self, root: np.ndarray, step: float) -> None:
        """Let the vertical follow the pelvis' orientation (3, 3), held for `step` s, unless upside down."""
        up, step = root[:, 1], min(step, LONGEST_STEP)
        if up.dot(self.vertical) > 0.5:
            self._seen += step
            share = min(step / min(FIRST_LEARNED_IN + self._seen, LEARNED_IN), 1.0)
            moved = self.vertical + share * (up - self.vertical)
            self.vertical = moved / math.sqrt(moved.dot(moved))

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows, which move with the root alone."""
        rows, z[...] = self.rows(about.states.state.rotations[..., 0, :, :])
        if about.turn is not None:
            rows = rows @ about.turn[..., 0, :, :]
        root = about.kinematics.live_root
        columns[..., : len(root), :] = rows.swapaxes(-1, -2).take(root, axis=-2)
        columns[..., len(root) :, :] = 0.0

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) cost of the states' leans."""
        return self.lean_cost(states.state.rotations[..., 0, :, :])

    def rows(self, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(A, z): rows (..., 3, 3) for the root's increment and right sides (..., 3), in standard deviations.

        The lean is up - vertical; with root R and R exp(hat(w)) it changes by -R hat(e_y) w = [R e_z, 0, -R e_x] w.
        """
        lean = root[..., :, 1] - self.vertical
        weight = 1 / np.sqrt(SPREAD**2 + 0.25 * squared_norm(lean))[..., None]
        return root[..., ::-1] * (weight * _ACROSS)[..., None, :], -weight * lean

    def lean_cost(self, root: np.ndarray) -> np.ndarray:
        """(...,) what the rows' weights are the derivative of: 2 log(1 + lean^2 / (2 SPREAD)^2); root (..., 3, 3)."""
        lean = root[..., :, 1] - self.vertical
        return np.asarray(2 * np.log1p(squared_norm(lean) / (4 * SPREAD**2)))


def levelling(roll: float, pitch: float) -> np.ndarray:
    """(3, 3) from the optical frame of a camera mounted with these angles, rad, to that of a level one in its place.

    They are those of the camera's body frame (x forward, y left, z up) by fixed axes, as in a URDF's rpy: positive roll
    has its right side down, positive pitch looks down. Yaw stays. It is Ry(pitch) Rx(roll) there; the body frame's x is
    the optical frame's z, its y the other one's -x (REP 103).
    """
    about_right, about_sight = exponential(np.array([[-pitch, 0.0, 0.0], [0.0, 0.0, roll]]))
    return np.asarray(about_right @ about_sight)


def vertical_of(roll: float, pitch: float) -> np.ndarray:
    """(3,) up, in the optical frame of a camera mounted with these angles, rad, see `levelling`."""
    return -levelling(roll, pitch)[1]
