"""Convert joint rotations to the angles of three revolute joints each, for the URDF, and to joint states.

The URDF represents a ball joint of order "yxz" by three revolute joints in series, R = Ry(a_y) Rx(a_x) Rz(a_z)
(intrinsic Tait-Bryan angles). The angles are for output only; the state itself is on SO(3).

Gimbal lock: if the middle angle is +-90 degrees, the first and the last axis are parallel, and R determines only the
sum or the difference of their angles. The reader then keeps the first angle and computes the last one, so that the
product is still R. Near lock, a small rotation of R may need large and opposite changes of the first and the last
angle. The product stays exact and no angle jumps by 2 pi, but the angular velocities are not meaningful. The orders in
the skeleton's YAML file keep everyday postures away from gimbal lock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState

LOCK = 1e-9
"""Cosine of the middle angle below which the first angle is lost in rounding errors."""

SHORTEST_NS = 1_000_000
"""ns: velocities are differences over stamps. Over a shorter step, as stamps in another unit have, there are none."""
_TURN = 2 * np.pi
_OTHER_WAY = np.array([[1.0], [-1.0], [1.0]])  # same rotation: first + pi, pi - middle, last + pi


class JointAngleReader:
    """Compute angles that are continuous from one call to the next. The only state is the last result."""

    def __init__(self, axes: Sequence[str]) -> None:
        """axes: n orders, each a permutation of "xyz": the intrinsic order of the joint's three rotations."""
        order = np.array([["xyz".index(axis) for axis in word] for word in axes], dtype=int).reshape(-1, 3)
        i, j, k = order.T
        base = 9 * np.arange(len(order))
        even = np.where((j - i) % 3 == 1, 1.0, -1.0)  # 1 for xyz and its cyclic shifts, -1 for the others
        one = np.ones(len(order))
        # The entries of the rotation matrices that `read` uses: (row, column, sign), each (n,).
        entries = [(k, k, one), (j, i, even), (j, j, one), (j, k, -even), (k, i, one), (k, j, even), (i, k, even)]
        self._places = np.array([base + 3 * row + column for row, column, _ in entries])
        self._signs = np.array([sign for *_, sign in entries])
        self._to_xyz = len(order) * np.argsort(order, axis=1) + np.arange(len(order))[:, None]
        self.reset()

    def reset(self) -> None:
        """Forget the last result. The next result is the solution nearest to zero."""
        self._last = np.zeros((3, self._signs.shape[1]))

    def read(self, rotations: np.ndarray) -> np.ndarray:
        """Angles (n, 3) rad of rotations (n, 3, 3). The columns are x, y and z, independent of the order.

        Each rotation has two solutions, plus multiples of 2 pi. For each joint the one nearest to the last call's is
        returned.
        """
        entries = rotations.take(self._places) * self._signs
        angles = np.empty((3, entries.shape[1]))
        first, middle, last = angles
        locked = np.hypot(entries[3], entries[0]) < LOCK
        np.arctan2(entries[3], entries[0], out=first)
        np.copyto(first, self._last[0], where=locked)
        # Remove the first rotation; this leaves rows j and k of Rj(middle) Rk(last). Both angles are then well
        # conditioned: near lock, the last angle compensates the rounding error of the first one.
        below = np.cos(first) * entries[:3] + np.sin(first) * entries[3:6]
        np.arctan2(entries[6], below[0], out=middle)
        np.arctan2(below[1], below[2], out=last)
        self._last = self._nearest(angles, locked)
        return self._last.take(self._to_xyz)

    def _nearest(self, angles: np.ndarray, locked: np.ndarray) -> np.ndarray:
        """The solution (3, n), unwrapped, that is nearer to the last result; the given one of the `locked` (n,)."""
        step = np.array([angles, angles * _OTHER_WAY + np.pi])
        step -= self._last
        step -= _TURN * np.rint(step / _TURN)
        distance = np.add.reduce(step * step, axis=1)
        second = (distance[1] < distance[0]) & ~locked
        return self._last + np.where(second, step[1], step[0])


class Moment(NamedTuple):
    """The published state of one frame. stamp_ns: ns; begins: the state was initialised in this frame."""

    stamp_ns: int
    state: BodyState
    begins: bool


class JointStates:
    """Reads angles that are continuous from one requested frame to the next."""

    def __init__(self, axes: Sequence[str]) -> None:
        """axes: see JointAngleReader."""
        self._reader = JointAngleReader(axes)
        self._last: tuple[Moment | None, np.ndarray] = None, np.empty(0)

    def read(self, moment: Moment, before: Moment | None) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (3 + 3 n,) in m and rad, and velocities as differences over stamps.

        before: the frame before, None for the first one. Velocities are 0 after initialisation, and over a step below
        SHORTEST_NS.
        """
        if moment.begins or before is None:
            positions = self._positions(moment)
            return positions, np.zeros_like(positions)
        if self._last[0] is not before:
            self._positions(before)
        earlier = self._last[1]
        positions, step_ns = self._positions(moment), moment.stamp_ns - before.stamp_ns
        if step_ns < SHORTEST_NS:
            return positions, np.zeros_like(positions)
        return positions, (positions - earlier) / (step_ns * 1e-9)

    def _positions(self, moment: Moment) -> np.ndarray:
        if moment.begins:
            self._reader.reset()
        angles = self._reader.read(moment.state.rotations)
        positions = np.concatenate([moment.state.translation, angles.ravel()])
        self._last = moment, positions
        return positions


@dataclass(eq=False)
class Angles:
    """The joint angles of one frame, computed at the first access. They are continuous to the frame that was read last.

    before: the frame before, None for the first one.
    """

    states: JointStates
    moment: Moment
    before: Moment | None

    @cached_property
    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """See `JointStates.read`."""
        return self.states.read(self.moment, self.before)
