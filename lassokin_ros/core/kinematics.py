"""Forward kinematics (1)-(2) and differential kinematics (3)-(6) of a tree of ball joints.

Everything is in the camera optical frame (x right, y down, z forward), metres and radians. A joint's frame is
the root's at rest; joint j turns by R_j about its own centre, in its parent's frame. An increment omega_j is
applied on the right, R_j <- R_j exp(hat(omega_j)), so its three angular degrees of freedom are turns about the
axes of the joint's own frame.

Functions take leading batch axes (hypotheses, people) where shapes are written with `...`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.landmarks import Layout
from lassokin_ros.core.rotations import exponential
from lassokin_ros.core.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class BodyState:
    """What moves: local rotations (..., n, 3, 3) and the root's position (..., 3) in the camera frame, m."""

    rotations: np.ndarray
    translation: np.ndarray

    def retract(self, omega: np.ndarray, translation_step: np.ndarray) -> BodyState:
        """The state after the increment: R_j exp(hat(omega_j)), translation + x.

        omega: (..., 3 n) rad, the seed's Omega; translation_step: (..., 3) m, its x.
        """
        steps = exponential(omega.reshape(self.rotations.shape[:-1]))
        return BodyState(self.rotations @ steps, self.translation + translation_step)


@dataclass(frozen=True, eq=False)
class BodyPose:
    """Where everything is: joint orientations (..., n, 3, 3), centres (..., n, 3) and landmarks q (..., l, 3)."""

    orientations: np.ndarray
    positions: np.ndarray
    landmarks: np.ndarray


class Kinematics:
    """The kinematics of one skeleton with one landmark layout; holds tables that depend on nothing else."""

    def __init__(self, skeleton: Skeleton, layout: Layout) -> None:
        self.skeleton = skeleton
        self.layout = layout
        n = skeleton.joint_count
        self._ancestors = skeleton.ancestors.astype(float)
        self._bone_parent = np.maximum(skeleton.parents, 0)
        self._offsets = skeleton.offsets
        self._jumps = _pointer_doubling(skeleton.parents)
        #: (l, 3 n): 1 where an angular degree of freedom moves a landmark (the joint is its ancestor or its own).
        self.reach = np.repeat(self._ancestors[layout.joints], 3, axis=1)
        self._row_reach = np.repeat(self.reach, 2, axis=0)
        self.joint_count, self.landmark_count = n, len(layout.names)

    def reshape(self, skeleton: Skeleton) -> None:
        """Take over the lengths of a skeleton that is otherwise the same (same tree, same landmarks)."""
        self.skeleton = skeleton
        self._offsets = skeleton.offsets

    @cached_property
    def live(self) -> np.ndarray:
        """(3 n,) bool: degrees of freedom that can move a landmark; the other columns of P L are zero in every pose.

        Dead are the joints below the last landmark, and turns about a bone whose far end is all that is seen (the
        forearm's twist, when of the hand only the wrist is). Found at random poses, where no other column vanishes.
        """
        vectors = np.random.default_rng(0).normal(size=(4, self.joint_count, 3))
        L = self.jacobian(self.pose(BodyState(exponential(vectors), np.zeros((4, 3)))))
        return np.any(np.abs(L) > 1e-9, axis=(0, 1))

    def pose(self, state: BodyState) -> BodyPose:
        """Forward kinematics, (1)-(2): orientations, joint centres and landmarks of a state.

        T_i is the product of the joints' transforms from the root down; a landmark is q_i = T_i q_i^0.
        """
        orientations = self._orientations(state.rotations)
        bones = (orientations[..., self._bone_parent, :, :] @ self._offsets[:, :, None])[..., 0]
        positions = self._ancestors @ bones + state.translation[..., None, :]
        joints = self.layout.joints
        levers = (orientations[..., joints, :, :] @ self.layout.offsets[:, :, None])[..., 0]
        return BodyPose(orientations, positions, positions[..., joints, :] + levers)

    def _orientations(self, rotations: np.ndarray) -> np.ndarray:
        """(..., n, 3, 3): products of the rotations from the root down, in log2(depth) batched steps.

        Pointer doubling: after step k each joint holds the product over its last 2^k ancestors.
        """
        product = rotations
        for joints, above in self._jumps:
            lengthened = product.copy()
            lengthened[..., joints, :, :] = product[..., above, :, :] @ product[..., joints, :, :]
            product = lengthened
        return product

    def jacobian(self, pose: BodyPose) -> np.ndarray:
        """L of (11), (..., 3 l, 3 n): block (i, j) is J_j(q_i) of (3)-(4), zero where j does not carry q_i (5).

        Column c of J_j(q_i) is the spatial twist of that degree of freedom applied to q_i: w x (q_i - p_j), with w
        its unit axis and p_j the joint's centre, both in the camera frame.
        """
        levers = pose.landmarks[..., :, None, :] - pose.positions[..., None, :, :]
        axes = np.swapaxes(pose.orientations, -1, -2)
        columns = np.cross(axes[..., None, :, :, :], levers[..., :, :, None, :])
        shape = pose.landmarks.shape[:-2]
        blocks = np.moveaxis(columns, -1, -3).reshape(*shape, self.landmark_count, 3, 3 * self.joint_count)
        return (blocks * self.reach[:, None, :]).reshape(*shape, 3 * self.landmark_count, 3 * self.joint_count)

    def image_jacobian(self, pose: BodyPose, rows: np.ndarray, axes: np.ndarray | None = None) -> np.ndarray:
        """P L of (9)-(12), (..., 2 l, 3 n), without forming L.

        axes: (..., n, 3, 3), in each matrix's columns the axes (camera frame) about which the joint's three degrees of
        freedom turn; the joint's own by default.

        rows: (..., 2 l, 3), the rows f of P's blocks F(q_i) of (8), possibly weighted. Since
        f . (w x (q - p)) = w . (q x f) - (w x p) . f, all entries are one product of the landmarks' (q x f, f) with
        the degrees of freedom's (w, p x w), and a mask. Lengths are taken from the root, which keeps them small.
        """
        root = pose.positions[..., :1, :]
        axes = np.swapaxes(pose.orientations if axes is None else axes, -1, -2)
        shape = axes.shape[:-3]
        centres = (pose.positions - root)[..., :, None, :]
        twists = np.empty(shape + (self.joint_count, 3, 6))
        twists[..., :3] = axes
        _cross(centres, axes, twists[..., 3:])
        wrenches = np.empty(shape + (2 * self.landmark_count, 6))
        _cross(np.repeat(pose.landmarks - root, 2, axis=-2), rows, wrenches[..., :3])
        wrenches[..., 3:] = rows
        flat = twists.reshape(*shape, 3 * self.joint_count, 6)
        result: np.ndarray = wrenches @ np.swapaxes(flat, -1, -2)
        result *= self._row_reach
        return result


def _cross(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """out = a x b on the last axis; numpy's own cross costs several times as much on arrays this small."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    out[..., 0] = ay * bz - az * by
    out[..., 1] = az * bx - ax * bz
    out[..., 2] = ax * by - ay * bx


def _pointer_doubling(parents: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Index pairs (joints, the joint 2^k levels above each) of every doubling step."""
    above = parents.copy()
    steps = []
    while np.any(above >= 0):
        joints = np.flatnonzero(above >= 0)
        steps.append((joints, above[joints]))
        above = np.where(above >= 0, above[np.maximum(above, 0)], -1)
    return steps
