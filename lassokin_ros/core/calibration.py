"""Bone proportions learned while the person is followed; the height stays what it was given as.

The unknowns are about a dozen log-lengths, the same left and right. Some tracked frames, spread over time, are kept.
For each the image's and the prior's rows are linearised in (pose, translation, log-lengths) and the first two are
eliminated (Schur complement), which leaves normal equations in the lengths alone. Their sum, a log-normal prior about
the given skeleton and a row that holds the stature are solved for the lengths. Kept frames are linearised again in
turn, one a call, at the lengths known by then: Gauss-Newton on all of them, spread over time (Triggs et al., Bundle
adjustment: a modern synthesis, 2000, sec. 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.observation_model import linearise
from lassokin_ros.core.prior import PriorRows
from lassokin_ros.core.robust import huber_cost, huber_weights
from lassokin_ros.core.skeleton import Skeleton
from lassokin_ros.core.upright import Upright

PAIRS = {
    "hip width": ("hip", "x"),
    "hip drop": ("hip", "yz"),
    "thigh": ("knee", "xyz"),
    "shank": ("ankle", "xyz"),
    "foot": ("foot", "xyz"),
    "shoulder width": ("collar shoulder", "x"),
    "shoulder height": ("collar shoulder", "yz"),
    "upper arm": ("elbow", "xyz"),
    "forearm": ("wrist", "xyz"),
    "hand": ("hand", "xyz"),
}
"""Lengths of SMPL's tree that stand left and right: the joints at whose offsets' components they are."""
MIDDLE = {"trunk": "spine1 spine2 spine3", "neck": "neck", "head": "head"}

SPREAD = 0.06
"""Standard deviation of a log-length about the given one."""
STATURE_SPREAD = 0.005
"""The same of the stature at rest: held, but as a row of a linear system."""
INFORMATION = 0.3
"""Share of a kept frame's information that is counted: neither the prior's errors nor the tracks' are independent."""
KEPT = 32
"""Kept frames; when there are so many, every other one goes and the interval doubles."""
INTERVAL = 0.25
"""s between kept frames, at first."""
SETTLED = 0.5
"""s after a start before frames are kept."""
WORK_EVERY = 5
"""Frames between two pieces of work: one frame kept, or one linearised again."""
UPDATE_EVERY = 1.0
"""s between two updates of the skeleton."""
DAMPING = 1e-3
"""1/rad^2, keeps what nothing observes where it is."""
TYPICAL_COST = 12.0
"""Robust cost of a frame (image and prior) at which its weight is halved: a wrong pose explains the image badly."""
CERTAIN = 0.012
"""Standard deviation of the least certain length (of those that the stature and the images know) that ends it."""
LONGEST = 20.0
"""s of kept motion after which it ends in any case."""


class Proportions:
    """The log-lengths (p,) of one skeleton, 0 = as given, and what they do to offsets and landmarks."""

    def __init__(self, kinematics: Kinematics) -> None:
        skeleton = kinematics.skeleton
        self.given = skeleton
        self._kinematics = kinematics
        self._parent = np.maximum(skeleton.parents, 0)
        self._reach = skeleton.ancestors[kinematics.layout.joints].astype(float)
        parts = _parts(skeleton)
        seen = [name for name, part in parts.items() if np.any(self._reach @ np.abs(part).sum(-1) > 1e-6)]
        self.names = tuple(seen)
        #: (p, n, 3) m: the offsets that each length scales.
        self.parts = np.array([parts[name] for name in seen]).reshape(-1, skeleton.joint_count, 3)
        height = skeleton.rest_positions[:, 1]
        top, bottom = int(np.argmax(height)), int(np.argmin(height))
        path = skeleton.ancestors[top].astype(float) - skeleton.ancestors[bottom]
        #: (p,) share of the stature at rest that each length makes.
        self.stature_shares = self.parts[:, :, 1] @ path / max(height[top] - height[bottom], 1e-9)

    @property
    def count(self) -> int:
        """Number of lengths."""
        return len(self.names)

    def skeleton(self, lengths: np.ndarray) -> Skeleton:
        """The given skeleton with other lengths."""
        return self.given.with_offsets(self.given.offsets + np.tensordot(np.expm1(lengths), self.parts, 1))

    def jacobian(self, pose: BodyPose, lengths: np.ndarray) -> np.ndarray:
        """(l, 3, p) m: derivative of the landmarks by the log-lengths, in the camera frame, root held."""
        scaled = np.moveaxis(np.exp(lengths)[:, None, None] * self.parts, 0, -1)
        bones = pose.orientations[self._parent] @ scaled
        n = self.given.joint_count
        return (self._reach @ bones.reshape(n, -1)).reshape(len(self._reach), 3, self.count)


def _parts(skeleton: Skeleton) -> dict[str, np.ndarray]:
    """(n, 3) m of each length: its share of the offsets. Joints that the tables do not name stand for themselves."""
    names = skeleton.joint_names
    groups: dict[str, tuple[list[str], str]] = {}
    for length, (kinds, axes) in PAIRS.items():
        groups[length] = ([f"{side}_{kind}" for side in ("left", "right") for kind in kinds.split()], axes)
    groups |= {length: (joints.split(), "xyz") for length, joints in MIDDLE.items()}
    known = {joint for joints, _ in groups.values() for joint in joints}
    for name in (name for name in names if name not in known):
        kind = name.removeprefix("left_").removeprefix("right_")
        groups[kind] = ([*groups.get(kind, ([], ""))[0], name], "xyz")
    parts = {}
    for length, (joints, axes) in groups.items():
        part = np.zeros((skeleton.joint_count, 3))
        components = ["xyz".index(axis) for axis in axes]
        for joint in (names.index(joint) for joint in joints if joint in names):
            part[joint, components] = skeleton.offsets[joint, components]
        if part.any():
            parts[length] = part
    return parts


@dataclass(eq=False)
class KeptFrame:
    """A frame that speaks about the lengths: what was seen, its pose, and its normal equations in the lengths.

    information (p, p) and pull (p,) hold about `lengths`, where it was linearised last.
    """

    state: BodyState
    points: np.ndarray
    weights: np.ndarray
    lengths: np.ndarray
    information: np.ndarray
    pull: np.ndarray
    cost: float = np.inf


class Calibration:
    """Learns the lengths of one person; `advance` with every tracked frame, then take `skeleton`."""

    def __init__(self, kinematics: Kinematics, rows: PriorRows) -> None:
        self.proportions = Proportions(kinematics)
        self._kinematics = kinematics
        self._rows = rows
        self._live = np.flatnonzero(kinematics.live)
        self.reset()

    def reset(self) -> None:
        """Back to the given lengths."""
        count = self.proportions.count
        self.lengths = np.zeros(count)
        self.spread = np.full(count, SPREAD)
        self.frozen = count == 0
        self.moved = 0.0
        self._frames: list[KeptFrame] = []
        self._interval = INTERVAL
        self._calls = self._turn = 0
        self._kept_at = self._updated_at = self._started = None

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton as it is known by now."""
        return self.proportions.skeleton(self.lengths)

    @property
    def progress(self) -> float:
        """0 at the start, 1 when the lengths stay."""
        return 1.0 if self.frozen else min(self.moved / LONGEST, 0.99)

    def restart_clock(self, stamp: float) -> None:
        """The state was found anew: wait until it has settled before frames are kept."""
        self._kept_at = stamp + SETTLED

    def advance(
        self, stamp: float, state: BodyState, points: np.ndarray, weights: np.ndarray, upright: Upright
    ) -> bool:
        """Use a tracked frame (arguments as in `Tracker`); True when the lengths have changed."""
        self._calls += 1
        if self.frozen or self._calls % WORK_EVERY:
            return False
        if self._kept_at is None:
            self.restart_clock(stamp)
        if self._updated_at is None:
            self._updated_at = stamp
        if stamp - self._kept_at >= self._interval:
            self.moved += self._interval
            self._kept_at = stamp
            self._keep(state, points, weights, upright)
        elif self._frames:
            self._turn = (self._turn + 1) % len(self._frames)
            self._linearise(self._frames[self._turn], upright)
        if stamp - self._updated_at < UPDATE_EVERY or len(self._frames) < 4:
            return False
        self._updated_at = stamp
        self._update()
        return True

    def _keep(self, state: BodyState, points: np.ndarray, weights: np.ndarray, upright: Upright) -> None:
        if len(self._frames) >= KEPT:
            pairs = zip(self._frames[::2], self._frames[1::2])
            self._frames = [a if a.cost < b.cost else b for a, b in pairs]
            self._interval *= 2
        count = self.proportions.count
        frame = KeptFrame(state, points, weights, self.lengths, np.zeros((count, count)), np.zeros(count))
        self._linearise(frame, upright)
        self._frames.append(frame)

    def _linearise(self, frame: KeptFrame, upright: Upright) -> None:
        """Renew a frame's normal equations at the present lengths, and take one Gauss-Newton step of its pose."""
        J, C, z, cost = self._frame_rows(frame, upright)
        H = J.T @ J
        H.flat[:: len(H) + 1] += DAMPING
        right = np.column_stack([J.T @ C, J.T @ z])
        _, solved, failed = lapack.dposv(H, right)
        if failed:
            return
        coupling, step = solved[:, :-1], solved[:, -1]
        frame.information = C.T @ C - right[:, :-1].T @ coupling
        frame.pull = C.T @ z - right[:, :-1].T @ step
        frame.lengths, frame.cost = self.lengths, cost
        omega = np.zeros(3 * self._kinematics.joint_count)
        omega[self._live] = step[:-3]
        size = max(float(np.max(np.abs(omega))), 1e-12)
        frame.state = frame.state.retract(omega * min(1.0, 0.5 / size), step[-3:])

    def _frame_rows(
        self, frame: KeptFrame, upright: Upright
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """(J, C, z, cost): rows ||z - J [Omega, x] - C dlengths||^2 of a frame, and its robust cost."""
        kinematics = self._kinematics
        pose = kinematics.pose(frame.state)
        model = linearise(kinematics, pose, frame.points, frame.weights)
        size = np.linalg.norm(model.residual.reshape(-1, 2), axis=-1)
        robust = np.repeat(np.sqrt(huber_weights(size)), 2)
        prior_A, prior_z = self._rows.linearise(frame.state.rotations)
        upright_A, upright_z = upright.linearise(frame.state.rotations[0])
        images, priors = len(robust), len(prior_z)
        A = np.zeros((images + priors + upright.count, len(prior_A[0])))
        A[:images], A[images:-3], A[-3:, :3] = model.A * robust[:, None], prior_A, upright_A
        J = np.zeros((len(A), len(self._live) + 3))
        J[:, :-3] = A[:, self._live]
        J[:images, -3:] = model.B * robust[:, None]
        C = np.zeros((len(A), self.proportions.count))
        by_length = self.proportions.jacobian(pose, self.lengths)
        C[:images] = (model.B.reshape(-1, 2, 3) @ by_length).reshape(images, -1) * robust[:, None]
        z = np.concatenate([model.residual * robust, prior_z, upright_z])
        cost = float(huber_cost(size).sum() + 0.5 * prior_z @ prior_z)
        return J, C, z, cost

    def _update(self) -> None:
        """Solve for the lengths by all kept frames, and end when they are certain."""
        count = self.proportions.count
        shares = self.proportions.stature_shares * np.exp(self.lengths)
        stature = float(self.proportions.stature_shares @ np.expm1(self.lengths))
        H = np.eye(count) / SPREAD**2 + np.outer(shares, shares) / STATURE_SPREAD**2
        g = shares * (shares @ self.lengths - stature) / STATURE_SPREAD**2
        for frame in self._frames:
            weight = INFORMATION / (1 + (frame.cost / TYPICAL_COST) ** 2)
            H += weight * frame.information
            g += weight * (frame.pull + frame.information @ frame.lengths)
        covariance = np.linalg.inv(H)
        self.lengths = np.clip(covariance @ g, -4 * SPREAD, 4 * SPREAD)
        self.spread = np.sqrt(np.diagonal(covariance))
        self.frozen = self.moved >= LONGEST or bool(self.spread.max() < CERTAIN)
        if self.frozen:
            self._frames = []
