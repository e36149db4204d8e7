"""Random bodies, states and lassos for the core's tests; every draw has a seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential, right_jacobian_inverse
from lassokin_ros.core.body.skeleton import AXIS_ORDERS, Skeleton
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution, PosePrior
from lassokin_ros.core.image.frame_data import LEVEL_CAMERA_UP, FrameData, View
from lassokin_ros.core.image.projection import huber_weights, project, stacked_matrices
from lassokin_ros.core.lasso.problem import Lasso, eliminate_translation

FACING = np.diag([1.0, -1.0, -1.0])
"""Orientation of a person who stands upright and faces the camera."""


def body(layout: str = "coco17", height: float = 1.75) -> Kinematics:
    """The built-in skeleton with a built-in layout."""
    skeleton = Skeleton.load("anthropometric", height)
    return Kinematics(skeleton, Layout.load(layout, skeleton))


def one_view(points: np.ndarray, weights: np.ndarray, up: np.ndarray = LEVEL_CAMERA_UP, **more: Any) -> FrameData:
    """The frame of one camera. more: further fields of its view and of the frame."""
    own = {field.name: more.pop(field.name) for field in fields(View) if field.name in more}
    return FrameData((View(points, weights, **own),), up, **more)


def with_view(frame: FrameData, **changes: Any) -> FrameData:
    """The frame of one camera with other values of its view."""
    return replace(frame, views=(replace(frame.views[0], **changes),))


def posed(kinematics: Kinematics, state: BodyState, offsets: np.ndarray) -> BodyPose:
    """The pose of a state, with other offsets (n, 3) m of the joints."""
    return kinematics.pose(state, np.concatenate([offsets, kinematics.layout.offsets])[..., None])


def random_body(random: np.random.Generator, joints: int = 12, landmarks: int = 9) -> Kinematics:
    """A random tree, with a random shape and axes, and landmarks on random joints."""
    tree = [
        {
            "name": f"joint{i}",
            "parent": None if i == 0 else f"joint{random.integers(0, i)}",
            "position": random.normal(size=3).tolist(),
            "axes": AXIS_ORDERS[random.integers(6)],
        }
        for i in range(joints)
    ]
    skeleton = Skeleton.from_mapping({"height_unit": "metre", "joints": tree}, 1.0)
    points = [
        {"name": f"point{i}", "joint": f"joint{random.integers(joints)}", "offset": random.normal(size=3).tolist()}
        for i in range(landmarks)
    ]
    return Kinematics(skeleton, Layout.from_mapping({"landmarks": points}, skeleton))


def image_rows(
    kinematics: Kinematics, pose: BodyPose, points: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A, B, z) of (12), weighted, as written: (2 l, 3 n), (2 l, 3), (2 l,)."""
    P, Gamma, L = stacked_matrices(kinematics, pose)
    by_row = np.repeat(weights, 2)
    return by_row[:, None] * (P @ L), by_row[:, None] * (P @ Gamma), by_row * (points - project(pose.landmarks)).ravel()


def prior_rows(prior: PosePrior, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(A, z): rows (..., k, 3 n) of the pose prior for all degrees of freedom, and right sides (..., k)."""
    posture = prior.posture(rotations)
    blocks = prior.W.reshape(prior.count, -1, 3).swapaxes(0, 1) @ right_jacobian_inverse(posture.theta)
    A = np.zeros((*posture.residual.shape, *rotations.shape[-3:-1]))
    A[..., prior.joints, :] = blocks.swapaxes(-3, -2)
    return A.reshape(*posture.residual.shape, -1), posture.residual


def random_state(random: np.random.Generator, kinematics: Kinematics, spread: float = 0.5) -> BodyState:
    """A person in a random posture, 3-5 m in front of the camera, rotated about the vertical by any angle."""
    vectors = random.normal(size=(kinematics.joint_count, 3)) * spread
    rotations = exponential(vectors)
    rotations[0] = FACING @ exponential(np.array([0, random.uniform(-np.pi, np.pi), 0])) @ rotations[0]
    return BodyState(rotations, np.array([*random.normal(size=2) * 0.3, random.uniform(3, 5)]))


@dataclass(frozen=True)
class Draw:
    """The kind of lasso to make; `fraction` is alpha / alpha_max."""

    fraction: float
    sigma_px: float = 2.0
    visible: int | None = None
    frontal: bool = False
    with_prior: bool = False
    per_degree_of_freedom: bool = False
    live_columns: bool = False


def random_draw(random: np.random.Generator) -> Draw:
    """Noisy, near-frontal, few landmarks, rank-deficient, any alpha from 1e-4 alpha_max to above alpha_max."""
    return Draw(
        fraction=float(10 ** random.uniform(-4, 0.15)),
        sigma_px=float(random.choice([0.5, 2, 10])),
        visible=int(random.integers(3, 9)) if random.random() < 0.5 else None,
        frontal=bool(random.random() < 0.3),
        with_prior=bool(random.random() < 0.3),
        per_degree_of_freedom=bool(random.random() < 0.5),
        live_columns=bool(random.random() < 0.5),
    )


class Lassos:
    """Makes lassos like those of the frames of a tracked person."""

    def __init__(self) -> None:
        self.kinematics = body()
        self.prior = PosePrior(PoseDistribution.load(self.kinematics.skeleton), self.kinematics)

    def draw(self, random: np.random.Generator, draw: Draw) -> Lasso:
        """The lasso between a random state and a noisy observation of a nearby state."""
        kinematics, count = self.kinematics, self.kinematics.landmark_count
        state = random_state(random, kinematics, 0.03 if draw.frontal else 0.3)
        if draw.frontal:
            state.rotations[0] = FACING @ exponential(random.normal(size=3) * 0.02)
        moved = np.where(random.random(72) < 0.3, random.normal(size=72) * 0.05, 0.0)
        seen = project(kinematics.pose(state.retract(moved, random.normal(size=3) * 0.01)).landmarks)
        sigma = draw.sigma_px / 1200
        weights = np.full(count, 1 / sigma)
        if draw.visible is not None:
            weights[random.permutation(count)[draw.visible :]] = 0
        seen = seen + random.normal(size=seen.shape) * sigma
        A, B, z = image_rows(kinematics, kinematics.pose(state), seen, weights)
        if draw.with_prior:
            prior_A, prior_z = prior_rows(self.prior, state.rotations)
            A, B = np.vstack([A, prior_A]), np.vstack([B, np.zeros((len(prior_z), 3))])
            z = np.concatenate([z, prior_z])
        if draw.live_columns:
            A = np.ascontiguousarray(A[:, kinematics.live])
        alpha = random.uniform(0.2, 5, A.shape[1]) if draw.per_degree_of_freedom else np.ones(A.shape[1])
        return Lasso(A, B, z, alpha * (draw.fraction * alpha_max(Lasso(A, B, z, alpha))))


def alpha_max(problem: Lasso) -> float:
    """The factor on the problem's alpha above which Omega is 0: max |A~_k^T z| / alpha_k."""
    return float(np.max(np.abs(eliminate_translation(problem).g) / problem.alpha))


def central_difference(function, size: int, step: float = 1e-5) -> np.ndarray:
    """(outputs, size) Jacobian of function: (size,) increment -> array, at 0."""
    columns = []
    for k in range(size):
        increment = np.zeros(size)
        increment[k] = step
        columns.append((function(increment) - function(-increment)).reshape(-1) / (2 * step))
    return np.stack(columns, axis=-1)


def after_step(model: FrameModel, state: BodyState, step: np.ndarray) -> BodyState:
    """The state after a step (live + 3,) of the columns of a frame's rows."""
    omega = np.zeros(3 * model.kinematics.joint_count)
    omega[model.live] = step[:-3]
    return state.retract(omega, step[-3:])


def pull_and_gradient(
    model: FrameModel, piece: Evidence, state: BodyState, frame: FrameData
) -> tuple[np.ndarray, np.ndarray]:
    """(live + 3,) each: J^T z of the rows of one piece of evidence, and the gradient of its cost, negative."""
    rows = model.linearise(model.evaluate(state), frame, huber_weights)
    which = rows.rows[piece.name]

    def cost(step: np.ndarray) -> np.ndarray:
        return np.array(piece.cost(model.evaluate(after_step(model, state, step)), frame))

    return rows.columns[:, which] @ rows.z[which], -central_difference(cost, len(rows.columns), 1e-6)[0]


def assert_states_are_alike(model: FrameModel, piece: Evidence, states: Sequence[BodyState], frame: FrameData) -> None:
    """Rows and cost of several states at once are those of each alone."""
    both = BodyState(np.stack([one.rotations for one in states]), np.stack([one.translation for one in states]))
    whole, costs = model.linearise(model.evaluate(both), frame, huber_weights), piece.cost(model.evaluate(both), frame)
    for number, one in enumerate(states):
        alone = model.linearise(model.evaluate(one), frame, huber_weights)
        assert np.allclose(whole.columns[number], alone.columns, atol=1e-9)
        assert np.allclose(whole.z[number], alone.z, atol=1e-9)
        assert np.isclose(costs[number], piece.cost(model.evaluate(one), frame), rtol=1e-9)


def relative_error(actual: np.ndarray, expected: np.ndarray) -> float:
    """Norm of the difference, divided by the norm of the expected value."""
    return float(np.linalg.norm(actual - expected) / max(np.linalg.norm(expected), 1e-300))


def scaled_forearms(skeleton: Skeleton, factor: float) -> Skeleton:
    """The skeleton with both forearms longer by a factor."""
    scales = np.ones(skeleton.joint_count)
    scales[[skeleton.index("left_wrist"), skeleton.index("right_wrist")]] = factor
    return skeleton.with_bone_scales(scales)


def copied_body(folder):
    """The built-in skeleton and layout as files of a user: {setting: path}."""
    shipped, result = resources.files("lassokin_ros.core.body"), {}
    for name, source in {"skeleton": "skeletons/anthropometric.yaml", "landmarks": "layouts/coco17.yaml"}.items():
        result[name] = str(folder / f"{name}.yaml")
        Path(result[name]).write_text((shipped / source).read_text(encoding="utf-8"), encoding="utf-8")
    return result
