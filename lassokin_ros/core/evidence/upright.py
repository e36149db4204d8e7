"""Uprightness: a weak prior that people stand, walk and sit upright.

One camera hardly observes a lean towards it. The residual compares the pelvis' y axis with the vertical in the camera
frame. At first the vertical is the camera's -y axis (a level camera) or follows from the camera's mount. Then it is
learned from the tracked person, so that an unknown tilt of the camera causes no constant error. The loss is Cauchy's,
so that the weight decreases for large leans: a person may lie down.
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
"""s: initial time constant. It grows with the time for which a person has been tracked. It is short at first, because
the error of the camera's mount is often larger than the lean of a person."""

TILT = 0.45
"""rad: pitch of the alternative verticals, for a camera whose tilt is not configured. With more alternatives, smaller
and larger, first frames were worse for cameras tilted by 30 degrees and hardly better for 15 or 45 degrees."""
TILT_COST = 4.0
"""Negative log-likelihood of an alternative vertical relative to the configured mount. With a smaller value, people who
lean in front of a level camera are estimated as upright. With a larger one, upright people in front of a tilted camera
are estimated as leaning."""

LEAST_TILT = 1e-4
"""rad: a mount that differs by less is the same."""
LONGEST_STEP = 0.2
"""s: largest weight of one frame, also after a gap."""

_RIGHT, _SIGHT = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
_ACROSS = np.array([1.0, 0.0, -1.0])  # signs of [e_z, e_y, e_x] in the derivative of the vertical


class Upright(Evidence):
    """Rows for the root's rotation, and the learned vertical (3,), a unit vector in the camera frame."""

    count = 3
    vertical: np.ndarray
    _observed_s: float

    def __init__(self, roll: float = 0.0, pitch: float = 0.0) -> None:
        self.set_mount(roll, pitch)

    @classmethod
    def stack(cls, several: Sequence[Upright]) -> Upright:
        """Stack the verticals of several people, each learned from that person, for roots (people, k, 3, 3)."""
        return stack_attribute(several, "vertical")

    def set_mount(self, roll: float, pitch: float) -> None:
        """Set the camera's mount, see `vertical_of`, and forget the learned vertical."""
        self._first = vertical_of(roll, pitch)
        self.configured = bool(roll or pitch)
        """True if the mount is known, and not assumed to be level."""
        self.reset()

    def move_mount(self, roll: float, pitch: float) -> None:
        """Set the measured mount of a camera that may move. The learned vertical is rotated with the camera."""
        first = vertical_of(roll, pitch)
        if not self.configured or np.abs(first - self._first).max() > LEAST_TILT:
            self.vertical = first if self._observed_s == 0 else _rotate_between(self.vertical, self._first, first)
            self._first, self.configured = first, True

    def reset(self) -> None:
        """Return to the vertical of the camera's mount."""
        self.vertical = self._first
        self._observed_s = 0.0

    @property
    def mount(self) -> np.ndarray:
        """(3,) the vertical that follows from the camera's mount."""
        return self._first

    @property
    def learned_for(self) -> float:
        """Time in s for which the vertical has been learned."""
        return self._observed_s

    def adopt(self, others: Iterable[Upright]) -> None:
        """Copy the vertical from the one of `others`, for the same camera, that has learned it for the longest time."""
        longest = max(others, key=lambda other: other._observed_s, default=self)
        if longest._observed_s > 0:
            self.vertical, self._observed_s = longest.vertical, longest._observed_s

    def candidates(self) -> list[tuple[np.ndarray, float]]:
        """The verticals (3,) to try in the first frame, each with its cost (negative log-likelihood).

        They are the mount's vertical and those of cameras pitched up and down from it, or only the learned vertical.
        """
        if self._observed_s > 0:
            return [(self.vertical, 0.0)]
        across = hat(self._first) @ _SIGHT
        size = math.sqrt(across.dot(across))
        axis = across / size if size > 1e-3 else _RIGHT  # the camera looks straight up or down
        tilts = exponential(np.outer((TILT, -TILT), axis))
        return [(self._first, 0.0), *((tilt @ self._first, TILT_COST) for tilt in tilts)]

    def learn(self, root: np.ndarray, step: float) -> None:
        """Move the vertical towards the pelvis' y axis.

        root: (3, 3), the orientation during the last `step` s; ignored if it is more than 60 degrees from the vertical.
        """
        up, step = root[:, 1], min(step, LONGEST_STEP)
        if up.dot(self.vertical) > 0.5:
            self._observed_s += step
            share = min(step / min(FIRST_LEARNED_IN + self._observed_s, LEARNED_IN), 1.0)
            moved = self.vertical + share * (up - self.vertical)
            self.vertical = moved / math.sqrt(moved.dot(moved))

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows. They depend on the root's rotation only."""
        rows, z[...] = self.rows(about.states.state.rotations[..., 0, :, :])
        if about.turn is not None:
            rows = rows @ about.turn[..., 0, :, :]
        root = about.kinematics.live_root
        columns[..., : len(root), :] = rows.swapaxes(-1, -2).take(root, axis=-2)
        columns[..., len(root) :, :] = 0.0

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) cost of each state's lean."""
        return self.lean_cost(states.state.rotations[..., 0, :, :])

    def rows(self, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(A, z): rows (..., 3, 3) for the root's increment and right sides (..., 3), in standard deviations.

        The lean is up - vertical; with root R and R exp(hat(w)) it changes by -R hat(e_y) w = [R e_z, 0, -R e_x] w.
        """
        lean = root[..., :, 1] - self.vertical
        weight = 1 / np.sqrt(SPREAD**2 + 0.25 * squared_norm(lean))[..., None]
        return root[..., ::-1] * (weight * _ACROSS)[..., None, :], -weight * lean

    def lean_cost(self, root: np.ndarray) -> np.ndarray:
        """(...,) Cauchy's loss, 2 log(1 + lean^2 / (2 SPREAD)^2), which gives the rows' weights; root (..., 3, 3)."""
        lean = root[..., :, 1] - self.vertical
        return np.asarray(2 * np.log1p(squared_norm(lean) / (4 * SPREAD**2)))


def _rotate_between(vector: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Rotate a vector (3,) by the smallest rotation that takes `before` to `after`, unit vectors (3,)."""
    axis, cosine = hat(before) @ after, float(before.dot(after))
    if cosine < -0.999:  # any axis would do
        return after
    return np.asarray(cosine * vector + hat(axis) @ vector + axis * (axis.dot(vector) / (1 + cosine)))


def level_from_camera(roll: float, pitch: float) -> np.ndarray:
    """Rotation (3, 3) from the optical frame of a camera with this mount, rad, to the optical frame of a level camera.

    The angles are fixed-axis angles of the camera's body frame (x forward, y left, z up), as in a URDF's rpy: with
    positive roll the camera's right side is down, with positive pitch the camera looks down. Yaw does not change. In
    the body frame the rotation is Ry(pitch) Rx(roll); its x is the optical frame's z, its y is the optical frame's -x
    (REP 103).
    """
    about_right, about_sight = exponential(np.array([[-pitch, 0.0, 0.0], [0.0, 0.0, roll]]))
    return np.asarray(about_right @ about_sight)


def vertical_of(roll: float, pitch: float) -> np.ndarray:
    """(3,) the up direction in the optical frame of a camera with this mount, rad; see `level_from_camera`."""
    return -level_from_camera(roll, pitch)[1]
