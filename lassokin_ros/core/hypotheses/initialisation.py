"""The first state from a single frame and the person's height, for any orientation of the body.

Several start states (the mean pose, turned about the vertical) are fitted at once by damped Gauss-Newton on the
tracker's rows, coarse to fine, without the l1 term. If none of them fits, further starts lie or are upside down. The
fit with the lowest cost is used. A further start is the pose that the network of the body or of the hand sees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.body.roles import LIMB_BONES, SIDES, of_body
from lassokin_ros.core.body.rotations import exponential, least_turn
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.frame_model import FrameModel, LinearisedFrame
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import capped_weights, norm
from lassokin_ros.core.kernel import lapack
from lassokin_ros.core.lasso.problem import WEAKEST
from lassokin_ros.core.network.depth_network import PLACES
from lassokin_ros.core.network.hand_network import POINTS, hand_index

START_ROTATIONS = np.array([
    [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    [[0, -1, 0], [-1, 0, 0], [0, 0, -1]],
    [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
], dtype=float)  # fmt: skip
"""(6, 3, 3) the root's orientation in the camera frame: of a body that faces the camera upright, with its head to the
right, to the left, and upside down; of one that looks down with its head to the camera, and up with its head away."""
START_TURNS = 8
"""Sides to which a body is turned, at equal angles about its up axis; every second one for the other orientations."""
POOR_FIT = 1.5
"""Cost per visible landmark of the best fit above which other orientations are tried: 19 of 20 first frames of upright
people cost less, and hardly any fit with a wrong orientation does."""
FAR, NEAR = (8.0,) * 8 + (2.0,) * 6 + (1.0,) * 6, (4.0,) * 3 + (1.0,) * 5
"""Factor on the noise in each iteration of a fit whose start may be far from the solution, and of one that is near."""
LEAST_DEPTH = 0.3
"""m: smallest depth of a fitted state."""


@dataclass(eq=False)
class Fit:
    """A fitted state, and its cost on the frame."""

    state: BodyState
    cost: float


class Initialiser:
    """Fits states to single frames, for one kinematics and prior."""

    def __init__(self, kinematics: Kinematics, prior: PoseDistribution, frame_model: FrameModel) -> None:
        self._kinematics, self._frame_model = kinematics, frame_model
        self.mean_pose = exponential(prior.mean)
        """(n, 3, 3) local rotations of the prior's mean."""
        self._damping = np.append(np.full(len(kinematics.live_index), WEAKEST), np.full(3, 1e-6))

    def fit(self, frame: FrameData) -> Fit:
        """The best fit of all starts. At least two landmarks must be visible."""
        upright = int(np.argmax(START_ROTATIONS[:, :, 1].dot(frame.seeing.camera.rotation @ frame.up)))
        fit = self._fitted(self._starts(range(START_TURNS), [upright], frame), frame, FAR)
        if fit.cost > POOR_FIT * frame.point_count:
            others = [number for number in range(len(START_ROTATIONS)) if number != upright]
            other = self._fitted(self._starts(range(0, START_TURNS, 2), others, frame), frame, FAR)
            fit = min(fit, other, key=lambda one: one.cost)
        return fit

    def fit_near(self, start: BodyState, frame: FrameData) -> Fit:
        """Fit one state (n, 3, 3). Its translation is computed here."""
        return self._fitted(self.with_translation(start.rotations[None], frame), frame, NEAR)

    def _fitted(self, states: BodyState, frame: FrameData, factors: Iterable[float]) -> Fit:
        return self.best(self.iterate(states, frame, factors), frame)

    def iterate(self, states: BodyState, frame: FrameData, factors: Iterable[float]) -> BodyState:
        """A Gauss-Newton step from S states, (S, n, 3, 3) and (S, 3), for each factor on the noise."""
        camera = frame.seeing.camera
        for factor in factors:
            about = self._frame_model.evaluate(states)
            rows = self._frame_model.linearise(about, frame.with_larger_noise(factor), capped_weights)
            states = states.retract(*self._step(rows))
            missing = np.maximum(LEAST_DEPTH - camera.into_camera(states.translation)[:, 2], 0.0)
            states.translation[...] += missing[:, None] * camera.rotation[2]
        return states

    def best(self, states: BodyState, frame: FrameData) -> Fit:
        """The one of S states with the lowest cost on a frame."""
        costs = self._frame_model.cost(self._frame_model.evaluate(states), frame)
        best = int(np.argmin(costs))
        return Fit(BodyState(states.rotations[best], states.translation[best]), float(costs[best]))

    def _starts(self, sides: Iterable[int], orientations: Sequence[int], frame: FrameData) -> BodyState:
        """The mean pose with each start orientation, turned to each side."""
        yaw = np.array(sides) * (2 * np.pi / START_TURNS)
        turn = exponential(np.stack([0 * yaw, yaw, 0 * yaw], axis=-1))
        roots = (START_ROTATIONS[orientations][:, None] @ turn).reshape(-1, 3, 3)
        rotations = np.repeat(self.mean_pose[None], len(roots), axis=0)
        rotations[:, 0] = frame.seeing.camera.rotation.T @ roots
        return self.with_translation(rotations, frame)

    def with_translation(self, rotations: np.ndarray, frame: FrameData) -> BodyState:
        """S states with rotations (S, n, 3, 3), and the translations that fit the frame: linear least squares on
        p_x + t_x = u (p_z + t_z), and the same for y.
        """
        at_origin = self._kinematics.pose(BodyState(rotations, np.zeros(rotations.shape[:1] + (3,)))).landmarks
        rows, right = [], []
        for view in frame.views:
            to_rays = view.ray_rows()
            rows.append((to_rays @ view.camera.rotation).reshape(-1, 3))
            seen = view.camera.into_camera(at_origin)[..., None]
            right.append(-(to_rays @ seen).reshape(len(rotations), -1))
        translation = np.concatenate(right, axis=1) @ np.linalg.pinv(np.concatenate(rows)).T
        camera = frame.seeing.camera
        into = camera.into_camera(translation)
        behind = into[:, 2] < 0.5
        into[behind] *= np.where(into[behind, 2:] < 0, -1, 1)
        into[:, 2] = np.maximum(into[:, 2], 0.5)
        translation = into if camera.is_identity else (into - camera.translation) @ camera.rotation
        return BodyState(rotations, translation)

    def _step(self, rows: LinearisedFrame) -> tuple[np.ndarray, np.ndarray]:
        """One damped Gauss-Newton step from the rows about S states: increments Omega (S, 3 n) and x (S, 3)."""
        H = rows.columns @ rows.columns.swapaxes(-1, -2)
        H.reshape(len(H), -1)[:, :: H.shape[-1] + 1] += self._damping
        step = _solved(H, (rows.columns @ rows.z[..., None])[..., 0])
        largest = np.abs(step[:, :-3]).max(axis=-1, keepdims=True)
        omega = np.zeros((len(step), 3 * self._kinematics.joint_count))
        omega[:, self._kinematics.live_index] = step[:, :-3] * (0.7 / np.maximum(largest, 0.7))  # rad
        return omega, step[:, -3:]


def _solved(H: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(S, n) solutions of positive definite systems H (S, n, n), g (S, n); 0 for one that is not."""
    step = np.zeros(g.shape)
    for matrix, right, result in zip(H, g, step):
        _, solution, failed = lapack.dposv(matrix.T, right, overwrite_a=1)
        if not failed:
            result[:] = solution
    return step


SAME_POSE = 0.08
"""m: mean distance of the network's joints from the tracked ones below which they are the same pose."""
PALM = np.array([index for index, point in enumerate(POINTS) if point == "wrist" or point.endswith("1")])
"""The wrist and the first joint of each finger. That of the thumb is near the wrist and does not move either."""


class NetworkPose:
    """The network's pose for the newest frame, on the present skeleton."""

    good_fit = 3.0
    """Cost per visible landmark up to which a fit that started from this pose is used without another search."""

    def __init__(self, places: Callable[[], np.ndarray | None], kinematics: Kinematics, mean_pose: np.ndarray) -> None:
        """places: gives `DepthEstimator.places` in the frame of the skeleton. mean_pose: (n, 3, 3) local rotations."""
        self._places, self._kinematics, self._mean_pose = places, kinematics, mean_pose
        names = kinematics.skeleton.joint_names
        shared = [name for name in PLACES if name in names]
        self._shared = np.array([PLACES.index(name) for name in shared])
        self._joints = np.array([names.index(name) for name in shared])
        #: Those that the network sees as the tracker does: the keypoints of a hand move the wrist, too.
        self._alike = np.flatnonzero(of_body(names)[self._joints])
        #: (k, k): maps positions of these joints to positions relative to the middle of the hips.
        self._relative = np.eye(len(shared))
        self._relative[:, [shared.index("left_hip"), shared.index("right_hip")]] -= 0.5

    def state(self, frame: FrameData | None = None) -> BodyState | None:
        """The pose for the newest frame, (n, 3, 3), with translation 0; None without an estimate. frame: not used."""
        places = self._places()
        if places is None:
            return None
        return state_at(dict(zip(PLACES, places)), self._kinematics.skeleton, self._mean_pose)

    def distance(self, pose: BodyPose) -> float:
        """Mean distance in m of a pose's joints from the network's, both relative to the middle of the hips.

        Wrists of a skeleton with hands are left out. NaN without an estimate.
        """
        return self._mean_distance(pose, self._alike)

    def _mean_distance(self, pose: BodyPose, among: np.ndarray | slice) -> float:
        """among: the joints, as indices of those that the network and the skeleton share."""
        places = self._places()
        if places is None:
            return math.nan
        joints = self._relative.dot(pose.positions.take(self._joints, axis=0))
        apart = norm(places.take(self._shared, axis=0) - joints)[among]
        return float(apart.sum()) / len(apart)

    def propose(self, tracked: EvaluatedState, frame: FrameData, turn: int) -> BodyState | None:
        """The pose, as a batch of one, if it is far from the tracked one; it depends on neither frame nor turn."""
        if self._mean_distance(tracked.pose, slice(None)) < SAME_POSE:
            return None
        state = self.state()
        return None if state is None else BodyState(state.rotations[None], state.translation[None])


def state_at(positions: Mapping[str, np.ndarray], skeleton: Skeleton, mean: np.ndarray) -> BodyState:
    """The state, with translation 0, whose bones point along the given positions.

    positions: (3,) m by joint name, relative to the middle of the hips, in the frame of the skeleton. mean: (n, 3, 3)
    local rotations.
    """
    rotations, names = mean.copy(), skeleton.joint_names
    rotations[0] = trunk_orientation(positions)
    world = np.empty_like(rotations)
    bone_of = dict(LIMB_BONES)
    for joint, parent in enumerate(skeleton.parents):
        above = np.eye(3) if parent < 0 else world[parent]
        world[joint] = above @ rotations[joint]
        end = bone_of.get(names[joint])
        if end in names:
            along = positions[end] - positions[names[joint]]
            bone = world[joint] @ skeleton.offsets[names.index(end)]
            if along.dot(along) > 1e-6 and bone.dot(bone) > 1e-6:
                world[joint] = least_turn(bone, along) @ world[joint]
                rotations[joint] = above.T @ world[joint]
    return BodyState(rotations, np.zeros(3))


def trunk_orientation(positions: Mapping[str, np.ndarray]) -> np.ndarray:
    """(3, 3): x to the person's left, y up along the trunk, z to the front."""
    y = 0.5 * (positions["left_shoulder"] + positions["right_shoulder"])
    shoulders = positions["left_shoulder"] - positions["right_shoulder"]
    across = positions["left_hip"] - positions["right_hip"] + 0.5 * shoulders
    y = y / (np.linalg.norm(y) + 1e-9)
    x = across - across.dot(y) * y
    x = x / (np.linalg.norm(x) + 1e-9)
    return np.stack([x, y, np.cross(x, y)], axis=1)


class HandPose:
    """The hand network's pose of the hand that is the whole skeleton, with the same interface.

    Its depths place the keypoints in space, up to the hand's distance. The palm, wrist and knuckles, is rigid: the
    rotation that best brings the skeleton's onto these places is the root's (W. Kabsch, Acta Cryst. A32, 1976). The
    fingers are as in the prior's mean pose.
    """

    def __init__(self, kinematics: Kinematics, mean_pose: np.ndarray) -> None:
        """kinematics: of a skeleton that `fits`. mean_pose: (n, 3, 3) local rotations."""
        self._side = [f"{side}_wrist" for side in SIDES].index(kinematics.skeleton.joint_names[0])
        index = hand_index(kinematics, SIDES[self._side])
        assert index is not None
        self._index, self._mean_pose = index, mean_pose
        self._palm = kinematics.skeleton.rest_positions[kinematics.layout.joints[index[PALM]]]

    good_fit = 8.0

    def distance(self, pose: BodyPose) -> float:
        """NaN: there is none."""
        return math.nan

    @staticmethod
    def fits(kinematics: Kinematics) -> bool:
        """Whether the root is a wrist, and the layout has all points of its hand."""
        side = kinematics.skeleton.joint_names[0].removesuffix("_wrist")
        return side in SIDES and hand_index(kinematics, side) is not None

    def state(self, frame: FrameData) -> BodyState | None:
        """The pose, (n, 3, 3), with translation 0; None without an estimate, or without a point of the palm."""
        for view in frame.views:
            given = view.hands[self._side]
            if given is None or not view.weights.take(self._index[PALM]).all():
                continue
            rays = np.append(view.points.take(self._index[PALM], axis=0), np.ones((len(PALM), 1)), axis=1)
            rays = rays @ view.camera.rotation
            depths = 1 + np.append(0.0, given.ratios)[PALM]
            places = rays * (depths / (rays @ given.sight))[:, None]
            rotations = self._mean_pose.copy()
            rotations[0] = _rotation(self._palm, places)
            return BodyState(rotations, np.zeros(3))
        return None


def _rotation(given: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(3, 3) that best rotates points (k, 3) about their mean onto others of any size."""
    U, _, V = np.linalg.svd((places - places.mean(0)).T @ (given - given.mean(0)))
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V)
