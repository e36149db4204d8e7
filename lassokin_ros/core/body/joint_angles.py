"""Joint rotations read out as the angles of three revolute joints each, for JointState and the URDF.

A ball joint of order "yxz" stands in the URDF as three revolute joints in a row, R = Ry(a_y) Rx(a_x) Rz(a_z): intrinsic
Tait-Bryan angles. They are for output only; the state itself lives on SO(3).

Gimbal lock. Where the middle angle is +-90 degrees, the first and the last axis are parallel: R tells only their sum
or difference. There the first angle stays as it was and the last one takes the rest, so that the product is still R.
Near lock, a small turn of R may need a large turn of the first and the last angle, in opposite senses: the product is
exact and nothing jumps by 2 pi, but their velocities mean little. The orders in the skeleton's YAML are chosen so that
everyday postures stay away from it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

ROOT_JOINTS = ("root_x", "root_y", "root_z")
"""Names of the three prismatic joints that carry the pelvis' translation, m."""
LOCK = 1e-9
"""Cosine of the middle angle below which the first angle cannot be told from rounding."""

_TURN = 2 * np.pi
_OTHER_WAY = np.array([[1.0], [-1.0], [1.0]])  # the same rotation: the first and the last angle by pi more, pi - middle


class JointAngleReader:
    """Reads angles that are continuous from one call to the next; its only state is the last answer."""

    def __init__(self, axes: Sequence[str]) -> None:
        """axes: n orders, each a permutation of "xyz": the intrinsic order of that joint's three turns."""
        order = np.array([["xyz".index(axis) for axis in word] for word in axes], dtype=int).reshape(-1, 3)
        i, j, k = order.T
        base = 9 * np.arange(len(order))
        even = np.where((j - i) % 3 == 1, 1.0, -1.0)  # x y z and its cyclic shifts turn the same way round
        one = np.ones(len(order))
        # Of the matrices, in rows of n, the entries that are needed: of (row, column) its place, and its sign.
        entries = [(k, k, one), (j, i, even), (j, j, one), (j, k, -even), (k, i, one), (k, j, even), (i, k, even)]
        self._places = np.array([base + 3 * row + column for row, column, _ in entries])
        self._signs = np.array([sign for *_, sign in entries])
        self._to_xyz = len(order) * np.argsort(order, axis=1) + np.arange(len(order))[:, None]
        self.reset()

    def reset(self) -> None:
        """Forget the last answer: the next one is the solution nearest to zero."""
        self._last = np.zeros((3, self._signs.shape[1]))
        self._locked = np.zeros(self._signs.shape[1], dtype=bool)

    @property
    def locked(self) -> np.ndarray:
        """(n,) bool: the joints that were at gimbal lock in the last call."""
        return self._locked

    def read(self, rotations: np.ndarray) -> np.ndarray:
        """Angles (n, 3) rad about x, y and z (columns by axis, whatever the order) of rotations (n, 3, 3).

        Of the two solutions and all their multiples of 2 pi it is the one nearest to the last call's, joint by joint.
        """
        entries = rotations.take(self._places) * self._signs
        angles = np.empty((3, entries.shape[1]))
        first, middle, last = angles
        self._locked = np.hypot(entries[3], entries[0]) < LOCK
        np.arctan2(entries[3], entries[0], out=first)
        np.copyto(first, self._last[0], where=self._locked)
        # Undo the first turn: rows j and k of Rj(middle) Rk(last). Both angles are well conditioned from there on,
        # whatever rounding did to the first one near lock, because the last one absorbs it.
        below = np.cos(first) * entries[:3] + np.sin(first) * entries[3:6]
        np.arctan2(entries[6], below[0], out=middle)
        np.arctan2(below[1], below[2], out=last)
        self._last = self._nearest(angles)
        return self._last.take(self._to_xyz)

    def _nearest(self, angles: np.ndarray) -> np.ndarray:
        """Of the two solutions (3, n), unwrapped, the one nearer to the last; at lock the given one."""
        step = np.array([angles, angles * _OTHER_WAY + np.pi])
        step -= self._last
        step -= _TURN * np.rint(step / _TURN)
        distance = np.add.reduce(step * step, axis=1)
        second = (distance[1] < distance[0]) & ~self._locked
        return self._last + np.where(second, step[1], step[0])
