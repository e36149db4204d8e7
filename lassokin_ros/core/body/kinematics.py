"""Forward kinematics (1)-(2) and differential kinematics (3)-(6) of a tree of ball joints.

Everything is in the camera optical frame (x right, y down, z forward), metres and radians. A joint's frame is
the root's at rest; joint j turns by R_j about its own centre, in its parent's frame. An increment omega_j is
applied on the right, R_j <- R_j exp(hat(omega_j)), so its three angular degrees of freedom are turns about the
axes of the joint's own frame.

Functions take leading batch axes (hypotheses, people) where shapes are written with `...`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.batch import stack_attribute
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential, hat
from lassokin_ros.core.body.skeleton import Skeleton

_IDENTITY = np.eye(3)


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
        ancestors = skeleton.ancestors.astype(float)
        reach = ancestors[layout.joints]
        self._jumps = _pointer_doubling(skeleton.parents)
        # Centres and landmarks alike are sums of vectors fixed to joints: bones to their parents, levers to joints.
        self._carriers = np.concatenate([np.maximum(skeleton.parents, 0), layout.joints])
        self._sums = np.block([[ancestors, np.zeros(reach.T.shape)], [reach, np.eye(len(reach))]])
        self._vectors = np.concatenate([skeleton.offsets, layout.offsets])[:, :, None]
        #: (l, 3 n): 1 where an angular degree of freedom moves a landmark (the joint is its ancestor or its own).
        self.reach = np.repeat(reach, 3, axis=1)
        self._row_reach = np.repeat(self.reach, 2, axis=0)
        self.joint_count, self.landmark_count = n, len(layout.names)
        self._live = np.flatnonzero(self.live)
        #: Indices of the root's live degrees of freedom, which are the first of all live ones.
        self.live_root = self._live[skeleton.parents[self._live // 3] < 0]
        self._live_reach = np.ascontiguousarray(self._row_reach[:, self._live].T)

    @staticmethod
    def stack(several: Sequence[Kinematics]) -> Kinematics:
        """Of several people, whose skeletons differ in lengths alone: for states (people, k, ...)."""
        return stack_attribute(several, "_vectors")

    def reshape(self, skeleton: Skeleton) -> None:
        """Take over the lengths of a skeleton that is otherwise the same (same tree, same landmarks)."""
        self.skeleton = skeleton
        self._vectors = np.concatenate([skeleton.offsets, self.layout.offsets])[:, :, None]

    @cached_property
    def live(self) -> np.ndarray:
        """(3 n,) bool: degrees of freedom that can move a landmark; the other columns of P L are zero in every pose.

        Dead are the joints below the last landmark, and turns about a bone whose far end is all that is seen (the
        forearm's twist, when of the hand only the wrist is). Found at random poses, where no other column vanishes.
        """
        vectors = np.random.default_rng(0).normal(size=(4, self.joint_count, 3))
        L = self.jacobian(self.pose(BodyState(exponential(vectors), np.zeros((4, 3)))))
        return np.any(np.abs(L) > 1e-9, axis=(0, 1))

    def pose(self, state: BodyState, offsets: np.ndarray | None = None) -> BodyPose:
        """Forward kinematics, (1)-(2): orientations, joint centres and landmarks of a state.

        T_i is the product of the joints' transforms from the root down; a landmark is q_i = T_i q_i^0.
        offsets: (..., n, 3) m, those of other skeletons on the same tree, one per state; this skeleton's by default.
        """
        orientations = self._orientations(state.rotations)
        local = self._vectors if offsets is None else self._with_levers(offsets)
        vectors = (orientations.take(self._carriers, axis=-3) @ local)[..., 0]
        places = self._sums @ vectors
        places += state.translation[..., None, :]
        n = self.joint_count
        return BodyPose(orientations, places[..., :n, :], places[..., n:, :])

    def _with_levers(self, offsets: np.ndarray) -> np.ndarray:
        levers = np.broadcast_to(self.layout.offsets, offsets.shape[:-2] + self.layout.offsets.shape)
        return np.concatenate([offsets, levers], axis=-2)[..., None]

    def _orientations(self, rotations: np.ndarray) -> np.ndarray:
        """(..., n, 3, 3): products of the rotations from the root down, in log2(depth) batched steps.

        Pointer doubling: after step k each joint holds the product over its last 2^k ancestors. Above the root stands
        one more joint that does not turn, so that all joints are treated alike.
        """
        product = np.empty(rotations.shape[:-3] + (self.joint_count + 1, 3, 3))
        product[..., :-1, :, :] = rotations
        product[..., -1, :, :] = _IDENTITY
        for first, above in self._jumps:
            below = product[..., first:-1, :, :]
            below[:] = product.take(above, axis=-3) @ below
        return product[..., :-1, :, :]

    def jacobian(self, pose: BodyPose) -> np.ndarray:
        """L of (11), (..., 3 l, 3 n): block (i, j) is J_j(q_i) of (3)-(4), zero where j does not carry q_i (5).

        Column c of J_j(q_i) is the spatial twist of that degree of freedom applied to q_i: w x (q_i - p_j), with w
        its unit axis and p_j the joint's centre, both in the camera frame.
        """
        levers = pose.landmarks[..., :, None, :] - pose.positions[..., None, :, :]
        axes = pose.orientations.swapaxes(-1, -2)
        columns = np.cross(axes[..., None, :, :, :], levers[..., :, :, None, :])
        shape = pose.landmarks.shape[:-2]
        blocks = np.moveaxis(columns, -1, -3).reshape(*shape, self.landmark_count, 3, 3 * self.joint_count)
        return (blocks * self.reach[:, None, :]).reshape(*shape, 3 * self.landmark_count, 3 * self.joint_count)

    def image_jacobian(self, pose: BodyPose, rows: np.ndarray) -> np.ndarray:
        """P L of (9)-(12), (..., 2 l, 3 n), without forming L.

        rows: (..., 2 l, 3), the rows f of P's blocks F(q_i) of (8), possibly weighted. Since
        f . (w x (q - p)) = w . (q x f) - (w x p) . f, all entries are one product of the landmarks' (q x f, f) with
        the degrees of freedom's (w, p x w), and a mask. Lengths are taken from the root, which keeps them small.
        """
        columns = twists(pose, pose.orientations) @ wrenches(pose, pose.landmarks, rows).swapaxes(-1, -2)
        return columns.swapaxes(-1, -2) * self._row_reach

    def live_twists(self, pose: BodyPose, axes: np.ndarray) -> np.ndarray:
        """(..., live, 6): `twists` of the live degrees of freedom; axes: (..., n, 3, 3), see there."""
        return twists(pose, axes).take(self._live, axis=-2)

    def landmark_columns(self, moving: np.ndarray, pose: BodyPose, rows: np.ndarray, out: np.ndarray) -> None:
        """Fill `out` (..., live, m l) with the live columns of `image_jacobian`, as rows.

        moving: (..., live, 6), from `live_twists`; rows: (..., m l, 3), m rows per landmark, in the landmarks' order.
        """
        per_landmark = rows.shape[-2] // self.landmark_count
        reach = self._live_reach if per_landmark == 2 else np.repeat(self.reach, per_landmark, axis=0)[:, self._live].T
        columns = moving @ wrenches(pose, pose.landmarks, rows).swapaxes(-1, -2)
        np.multiply(columns, reach, out=out)

    def joint_columns(
        self, moving: np.ndarray, pose: BodyPose, joints: np.ndarray, rows: np.ndarray, out: np.ndarray
    ) -> None:
        """Fill `out` (..., live, m k) with the derivatives of f . p_j for rows f on the centres of k joints.

        moving: (..., live, 6), from `live_twists`; joints: (k,); rows: (..., m k, 3), m rows per joint.
        """
        carried = np.repeat(self.skeleton.ancestors[joints], 3, axis=1)[:, self._live]
        reach = np.repeat(carried, rows.shape[-2] // len(joints), axis=0).T
        columns = moving @ wrenches(pose, pose.positions.take(joints, axis=-2), rows).swapaxes(-1, -2)
        np.multiply(columns, reach, out=out)


def twists(pose: BodyPose, axes: np.ndarray) -> np.ndarray:
    """(..., 3 n, 6): of each degree of freedom w, and p x w; axes: (..., n, 3, 3), w in each matrix's columns."""
    axes = axes.swapaxes(-2, -1)
    result = np.empty(axes.shape[:-1] + (6,))
    result[..., :3] = axes
    np.matmul(axes, hat(pose.positions[..., :1, :] - pose.positions), out=result[..., 3:])  # w^T hat(-p)
    return result.reshape(*axes.shape[:-3], -1, 6)


def wrenches(pose: BodyPose, points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(..., m k, 6): q x f = f^T hat(-q), and f, for the rows f of rows (..., m k, 3) on points q (..., k, 3), m each.

    Lengths are taken from the root.
    """
    by_point = rows.reshape(*points.shape[:-1], -1, 3)
    result = np.empty(by_point.shape[:-1] + (6,))
    np.matmul(by_point, hat(pose.positions[..., :1, :] - points), out=result[..., :3])
    result[..., 3:] = by_point
    return result.reshape(*rows.shape[:-1], 6)


def _pointer_doubling(parents: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """For every doubling step the first joint with one 2^k levels above it, and from there on those above; n for none.

    Joints before the first are done; in the usual order, from the root outwards, so are few of the others.
    """
    top = len(parents)
    above = np.append(np.where(parents < 0, top, parents), top)
    steps = []
    while np.any(above != top):
        first = int(np.argmax(above != top))
        steps.append((first, above[first:-1]))
        above = above[above]
    return steps
