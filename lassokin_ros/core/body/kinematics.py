"""Forward kinematics (1)-(2) and differential kinematics (3)-(6) of a tree of ball joints.

All quantities are in metres and radians, in the frame of the skeleton: the first camera's optical frame (x right, y
down, z forward), or a fixed frame in which the cameras' places are given. At rest, every joint frame is parallel to the
root's. Joint j rotates by R_j about its own centre, in its parent's frame. An increment omega_j is applied on the
right, R_j <- R_j exp(hat(omega_j)): rotations about the axes of the joint's own frame.

Functions take leading batch axes (several states) where shapes are written with `...`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential, hat, logarithm
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.kernel import kernel


@dataclass(eq=False)
class BodyState:
    """The moving state: local rotations (..., n, 3, 3), root position (..., 3) m, in the frame of the skeleton."""

    rotations: np.ndarray
    translation: np.ndarray

    def retract(self, omega: np.ndarray, translation_step: np.ndarray) -> BodyState:
        """The state after the increment: R_j exp(hat(omega_j)), translation + x.

        omega: (..., 3 n) rad, the paper's Omega; translation_step: (..., 3) m, its x.
        """
        if kernel.active:
            moved = np.empty(self.rotations.shape)
            if kernel.retract(self.rotations, omega, moved):
                return BodyState(moved, self.translation + translation_step)
        steps = exponential(omega.reshape(self.rotations.shape[:-1]))
        return BodyState(self.rotations @ steps, self.translation + translation_step)

    def scaled_about(self, centre: np.ndarray, ratio: float) -> BodyState:
        """The state in which the root is `ratio` times as far from a centre (3,) m."""
        return BodyState(self.rotations, centre + ratio * (self.translation - centre))

    def towards(self, other: BodyState, share: float) -> BodyState:
        """The state at a share, 0 to 1, of the way to another one, by the shortest rotation of each joint."""
        turns = logarithm(self.rotations.swapaxes(-1, -2) @ other.rotations)
        omega = turns.reshape(*turns.shape[:-2], -1)
        return self.retract(share * omega, share * (other.translation - self.translation))


@dataclass(eq=False)
class BodyPose:
    """The result of forward kinematics, in the frame of the skeleton.

    orientations: (..., n, 3, 3). positions: (..., n, 3) m, joint centres. landmarks: (..., l, 3) m, q.
    """

    orientations: np.ndarray
    positions: np.ndarray
    landmarks: np.ndarray


class Kinematics:
    """Kinematics of one skeleton with one landmark layout, and the tables that depend only on these two."""

    def __init__(self, skeleton: Skeleton, layout: Layout) -> None:
        self.skeleton = skeleton
        self.layout = self._given_layout = layout
        self._given_height = skeleton.height
        ancestors = skeleton.ancestors.astype(float)
        reach = ancestors[layout.joints]
        depth = skeleton.ancestors.sum(axis=1)
        #: Parents and joints of each level of the tree; a slice, which is faster, if the joints follow each other.
        self._levels: list[tuple[np.ndarray, np.ndarray | slice]] = []
        for joints in (np.flatnonzero(depth == level) for level in range(2, depth.max() + 1)):
            one, last = joints[[0, -1]].tolist()
            own = slice(one, last + 1) if last - one + 1 == len(joints) else joints
            self._levels.append((skeleton.parents[joints], own))
        # Centres and landmarks are sums of vectors: bones are fixed to the parent joint, landmark offsets to the joint.
        self._carriers = np.concatenate([np.maximum(skeleton.parents, 0), layout.joints])
        self._sums = np.block([[ancestors, np.zeros(reach.T.shape)], [reach, np.eye(len(reach))]])
        self.set_skeleton(skeleton)
        #: (l, 3 n): 1 where a degree of freedom moves a landmark (its joint is the landmark's joint or an ancestor).
        self.reach = np.repeat(reach, 3, axis=1)
        self.joint_count, self.landmark_count = skeleton.joint_count, len(layout.names)
        #: Indices of the live degrees of freedom, and of those that are the root's; these come first.
        self.live_index = np.flatnonzero(self.live)
        self.live_root = self.live_index[skeleton.parents[self.live_index // 3] < 0]
        self._reaches: dict[tuple[bytes, int], np.ndarray] = {}

    def set_skeleton(self, skeleton: Skeleton) -> None:
        """Replace the skeleton by one with other lengths and the same tree. Landmarks are scaled with its height."""
        if skeleton.height != self.skeleton.height:
            self.layout = self._given_layout.scaled(skeleton.height / self._given_height)
        self.skeleton = skeleton
        #: (n + l, 3, 1) m: bones and landmark offsets, on which a pose depends besides the state.
        self.vectors = np.concatenate([skeleton.offsets, self.layout.offsets])[:, :, None]

    @cached_property
    def live(self) -> np.ndarray:
        """(3 n,) bool: degrees of freedom that can move a landmark; the other columns of P L are zero in every pose.

        These are of joints below the last landmark, or rotate about a bone of which only the far end is seen (such as
        the twist of the forearm if the wrist is the only landmark of the hand). The test uses random poses. Locked ones
        of the skeleton are not live.
        """
        vectors = np.random.default_rng(0).normal(size=(4, self.joint_count, 3))
        L = self.jacobian(self.pose(BodyState(exponential(vectors), np.zeros((4, 3)))))
        live = np.asarray(np.any(np.abs(L) > 1e-9, axis=(0, 1)))
        live[list(self.skeleton.locked)] = False
        return live

    @cached_property
    def _two_axes(self) -> tuple[np.ndarray, np.ndarray]:
        """(k,) the joints with one locked axis, and (k, 3) 1 for the free axes, 0 for the locked one."""
        free = np.ones((self.joint_count, 3))
        free.reshape(-1)[list(self.skeleton.locked)] = 0.0
        joints = np.flatnonzero(free.sum(axis=1) == 2)
        return joints, free[joints]

    def on_axes(self, rotations: np.ndarray) -> np.ndarray:
        """Local rotations (..., n, 3, 3) without the turn about a locked axis that steps about two others add up to.

        Rotations about one axis do not leave it. About two they do, to second order: the component of the rotation
        vector along the locked axis is set to 0, as in Listing's law of the eye.
        """
        joints, free = self._two_axes
        if len(joints) == 0:
            return rotations
        result = rotations.copy()
        result[..., joints, :, :] = exponential(logarithm(rotations.take(joints, axis=-3)) * free)
        return result

    def pose(self, state: BodyState, vectors: np.ndarray | None = None) -> BodyPose:
        """Forward kinematics, (1)-(2): orientations, joint centres and landmarks of a state.

        T_i is the product of the joints' transforms from the root to joint i; a landmark is q_i = T_i q_i^0.
        vectors: (..., n + l, 3, 1) m, `vectors` of another body with the same tree; default: this body's.
        """
        vectors, n = self.vectors if vectors is None else vectors, self.joint_count
        if kernel.active:
            lead = state.rotations.shape[:-3]
            orientations, places = np.empty(state.rotations.shape), np.empty((*lead, len(self.vectors), 3))
            tree = self.skeleton.parents, self.layout.joints
            if kernel.pose(state.rotations, state.translation, *tree, vectors, orientations, places):
                return BodyPose(orientations, places[..., :n, :], places[..., n:, :])
        orientations = state.rotations.copy()
        for parents, joints in self._levels:
            above = orientations.take(parents, axis=-3)
            orientations[..., joints, :, :] = above @ state.rotations[..., joints, :, :]
        places = self._sums @ (orientations.take(self._carriers, axis=-3) @ vectors)[..., 0]
        places += state.translation[..., None, :]
        return BodyPose(orientations, places[..., :n, :], places[..., n:, :])

    def jacobian(self, pose: BodyPose) -> np.ndarray:
        """L of (11), (..., 3 l, 3 n): block (i, j) is J_j(q_i) of (3)-(4), zero where joint j does not move q_i (5).

        Column c of J_j(q_i) is w x (q_i - p_j), with the unit axis w of degree of freedom c and the joint's centre p_j.
        """
        levers = pose.landmarks[..., :, None, :] - pose.positions[..., None, :, :]
        axes = pose.orientations.swapaxes(-1, -2)
        columns = np.cross(axes[..., None, :, :, :], levers[..., :, :, None, :])
        shape = pose.landmarks.shape[:-2]
        blocks = np.moveaxis(columns, -1, -3).reshape(*shape, self.landmark_count, 3, 3 * self.joint_count)
        return (blocks * self.reach[:, None, :]).reshape(*shape, 3 * self.landmark_count, 3 * self.joint_count)

    def live_twists(self, pose: BodyPose, axes: np.ndarray) -> np.ndarray:
        """(..., live, 6): `twists` of the live degrees of freedom; axes: (..., n, 3, 3), see `twists`."""
        return twists(pose, axes).take(self.live_index, axis=-2)

    def point_columns(
        self,
        live_twists: np.ndarray,
        root: np.ndarray,
        points: np.ndarray,
        joints: np.ndarray,
        rows: np.ndarray,
        columns: np.ndarray,
    ) -> None:
        """Fill `columns` (..., live + 3, m k) with the derivatives of f . q, for rows f that act on k points q.

        live_twists: (..., live, 6), see there. root: (..., 3) m, the root's position. points: (..., k, 3) m, fixed to
        the k joints. rows: (..., k, m, 3), m rows f per point. The last three columns are those of the translation.
        """
        f = rows.reshape(*rows.shape[:-3], -1, 3)
        moments = wrenches(root, points, f).swapaxes(-1, -2)
        np.multiply(live_twists @ moments, self.reach_of(joints, rows.shape[-2]), out=columns[..., :-3, :])
        columns[..., -3:, :] = f.swapaxes(-1, -2)

    def reach_of(self, joints: np.ndarray, rows: int) -> np.ndarray:
        """(live, m k): 1 where a live degree of freedom moves the point of a row, for m rows per point.

        joints: (k,), to which the points are fixed. Computed once for the same arguments.
        """
        key = joints.tobytes(), rows
        if key not in self._reaches:
            carried = np.repeat(self.skeleton.ancestors[joints].astype(float), 3, axis=1)[:, self.live_index]
            self._reaches[key] = np.ascontiguousarray(np.repeat(carried, rows, axis=0).T)
        return self._reaches[key]


def twists(pose: BodyPose, axes: np.ndarray) -> np.ndarray:
    """(..., 3 n, 6): w and p x w of each degree of freedom; axes: (..., n, 3, 3), w in the columns of each matrix."""
    axes = axes.swapaxes(-2, -1)
    result = np.empty(axes.shape[:-1] + (6,))
    result[..., :3] = axes
    np.matmul(axes, hat(pose.positions[..., :1, :] - pose.positions), out=result[..., 3:])  # w^T hat(-p)
    return result.reshape(*axes.shape[:-3], -1, 6)


def wrenches(root: np.ndarray, points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(..., m k, 6): q x f = f^T hat(-q), and f. rows: (..., m k, 3), m rows f per point; points: (..., k, 3), q.

    Positions are relative to the root's, (..., 3).
    """
    by_point = rows.reshape(*points.shape[:-1], -1, 3)
    result = np.empty(by_point.shape[:-1] + (6,))
    np.matmul(by_point, hat(root[..., None, :] - points), out=result[..., :3])
    result[..., 3:] = by_point
    return result.reshape(*rows.shape[:-1], 6)
