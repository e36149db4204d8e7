"""Synthetic motion for training: squats, lunges, raised legs, jumps, bending, kneeling and sitting.

Motion capture has mostly people who walk and stand. A network that learned from it alone is certain, and wrong, about
a person who squats in front of the camera.

Key poses are drawn at random within ranges of the joints' angles. Poses that could not stand are left out: the centre
of mass must be above the feet or knees on the ground. Between two key poses each joint turns smoothly (minimum jerk).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.rotations import exponential, logarithm
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.balance import mass_shares
from lassokin_ros.core.evidence.depth_network import canonical_layout, lengths_of
from training.motion import Motion

HEIGHT = 1.7  # m; `Views` draws other proportions
FPS = 30.0
SECONDS = 20.0
KEYS = 24
"""Key poses of a clip, more than fit into its duration."""
POOL = 2500
"""Poses of each kind, from which the key poses are drawn."""
STANDING, OWN = 0.4, 0.4
"""Shares of the key poses that are standing poses, and that are of the clip's own kind. The others are of any kind."""
MOVES, HOLDS, HELD = (0.35, 1.4), (0.0, 0.8), 0.6
"""s: ranges of the time between key poses and of the time for which a pose is held; share of the poses that are."""
SUPPORT = 0.09
"""m: largest horizontal distance of the centre of mass from the middle of what stands on the ground."""
GROUND = 0.06
"""m: height above the lowest joint up to which a foot or knee stands on the ground."""
SIDES = (("left", 1.0), ("right", -1.0))

Range = tuple[float, float]


@dataclass(frozen=True)
class Kind:
    """A kind of pose. share: of the clips; trunk, hips, knees: ranges of the flexion, rad.

    alike: both legs are drawn alike. free: one leg is drawn freely. stands: "feet", "foot", "knees", or "" if the pose
    need not stand.
    """

    share: float
    trunk: Range
    hips: Range
    knees: Range
    alike: bool = True
    free: bool = False
    stands: str = "feet"


STAND = Kind(0.0, (-0.1, 0.15), (-0.05, 0.15), (0.0, 0.15))
KINDS = (
    Kind(0.22, (-0.1, 0.9), (0.2, 2.2), (0.3, 2.4)),  # squats
    Kind(0.20, (-0.2, 0.7), (-0.5, 1.8), (0.0, 2.2), alike=False),  # lunges
    Kind(0.20, (-0.4, 1.2), (-0.1, 0.7), (0.0, 0.9), free=True, stands="foot"),  # raised legs
    Kind(0.14, (-0.4, 0.8), (-0.8, 1.8), (0.0, 2.2), alike=False, stands=""),  # jumps
    Kind(0.10, (0.2, 1.5), (0.2, 1.8), (0.0, 1.0)),  # bending
    Kind(0.08, (-0.2, 0.8), (-0.1, 1.8), (0.8, 2.5), alike=False, stands="knees"),  # kneeling
    Kind(0.06, (-0.3, 0.7), (1.0, 1.9), (0.6, 2.0), stands=""),  # sitting
)


class PosePool:
    """Random poses of each kind. Rotations (b, n, 3, 3); the body faces z, y up, as at rest."""

    def __init__(self, random: np.random.Generator) -> None:
        self.skeleton = Skeleton.load("anthropometric", HEIGHT)
        self.kinematics = Kinematics(self.skeleton, canonical_layout(self.skeleton))
        #: Joints that may stand on the ground: for each side ankle, foot and knee.
        self.ground = [self.skeleton.index(f"{s}_{j}") for s, _ in SIDES for j in ("ankle", "foot", "knee")]
        self._mass = mass_shares(self.skeleton.joint_names)
        self._random = random
        self.poses = {kind: self._found(kind) for kind in (STAND, *KINDS)}

    def positions(self, rotations: np.ndarray) -> np.ndarray:
        """(b, n, 3) m, the pelvis at 0."""
        return self.kinematics.pose(BodyState(rotations, np.zeros((len(rotations), 3)))).positions

    def stands(self, rotations: np.ndarray, on: str) -> np.ndarray:
        """(b,) whether poses can stand on both feet, a foot or a knee; always, for an empty text."""
        if not on:
            return np.ones(len(rotations), dtype=bool)
        positions = self.positions(rotations)
        points = positions[:, self.ground]
        low = points[..., 1] < points[..., 1].min(1, keepdims=True) + GROUND
        middle = (low[..., None] * points).sum(1) / low.sum(1)[:, None]
        offset = np.tensordot(positions, self._mass, axes=(1, 0)) - middle
        balanced = np.hypot(offset[:, 0], offset[:, 2]) < SUPPORT
        left, right, knees = low[:, :2].any(1), low[:, 3:5].any(1), low[:, [2, 5]].any(1)
        supported = {"feet": left & right & ~knees, "foot": (left | right) & ~knees, "knees": knees}[on]
        return np.asarray(balanced & supported)

    def _found(self, kind: Kind) -> np.ndarray:
        """`POOL` poses of a kind."""
        found: list[np.ndarray] = []
        while sum(map(len, found)) < POOL:
            drawn = self._drawn(kind, 4 * POOL)
            found.append(drawn[self.stands(drawn, kind.stands)])
        return np.concatenate(found)[:POOL]

    def _drawn(self, kind: Kind, size: int) -> np.ndarray:
        """Poses of a kind that need not stand."""
        random = self._random
        rotations = np.tile(np.eye(3), (size, self.skeleton.joint_count, 1, 1))
        bow = random.uniform(-0.1, 0.1 if kind is STAND else 0.5, size)
        pitch = random.uniform(*kind.trunk, size)
        self._turn(rotations, "pelvis", pitch, spread=(0.0, 0.0, 0.06))
        self._turn(rotations, "spine1", bow / 2, spread=(0.0, 0.1, 0.06))
        self._turn(rotations, "spine3", bow / 2, spread=(0.0, 0.15, 0.06))
        self._turn(rotations, "neck", -0.4 * (pitch + bow) * random.random(size), spread=(0.0, 0.25, 0.1))
        self._turn(rotations, "head", 0.0, spread=(0.15, 0.2, 0.08))
        self._draw_legs(rotations, kind, pitch)
        for side, sign in SIDES:
            self._draw_arm(rotations, side, sign, pitch + bow)
        return rotations

    def _turn(
        self, rotations: np.ndarray, joint: str, x: np.ndarray | float, spread: tuple[float, float, float]
    ) -> None:
        """Turn a joint by x about its x axis, and by normal angles of the given standard deviations. All in rad."""
        vectors = self._random.standard_normal((len(rotations), 3)) * spread
        vectors[:, 0] += x
        index = self.skeleton.index(joint)
        rotations[:, index] = rotations[:, index] @ exponential(vectors)

    def _draw_legs(self, rotations: np.ndarray, kind: Kind, pitch: np.ndarray) -> None:
        """Set hips, knees and ankles; the soles are level where the ankles allow it. pitch: (b,) rad, of the trunk."""
        size, random = len(rotations), self._random
        apart = random.uniform(0.0, 0.12 if kind is STAND else 0.6, size)
        hips, knees = (random.uniform(*angles, (2, size)) for angles in (kind.hips, kind.knees))
        if kind.alike:
            hips[1], knees[1] = hips[0], knees[0]
        outward = apart * random.uniform(0.3, 1.0, (2, size))
        hips, knees = hips + 0.08 * random.standard_normal((2, size)), knees + 0.08 * random.standard_normal((2, size))
        if kind.free:
            leg = random.integers(2, size=size), np.arange(size)
            hips[leg], outward[leg] = random.uniform(-0.9, 2.2, size), random.uniform(-0.2, 1.5, size)
            knees[leg] = random.uniform(0.0, 2.2, size) * (random.random(size) < 0.6)
        knees = np.clip(knees, 0.0, 2.6)
        for (side, sign), hip, knee, out in zip(SIDES, hips, knees, outward):
            turned_out = sign * random.uniform(-0.1, 0.5, size)
            vectors = np.stack([[-hip, 0 * hip, sign * out], [0 * hip, turned_out, 0 * hip]]).swapaxes(-1, -2)
            rotations[:, self.skeleton.index(f"{side}_hip")] = exponential(vectors[0]) @ exponential(vectors[1])
            self._turn(rotations, f"{side}_knee", knee, spread=(0.0, 0.0, 0.0))
            level = np.clip(hip - knee - pitch, -0.9, 0.7)
            self._turn(rotations, f"{side}_ankle", level, spread=(0.05, 0.1, 0.0))

    def _draw_arm(self, rotations: np.ndarray, side: str, sign: float, bow: np.ndarray) -> None:
        """Set an arm: hanging, or in a direction in front of the body or beside it. bow: (b,) rad, of the chest."""
        size, random = len(rotations), self._random
        hanging = np.stack([np.full(size, 0.2 * sign), -np.cos(bow), np.sin(bow)], axis=-1)
        hanging += 0.12 * random.standard_normal((size, 3))
        raised = random.standard_normal((size, 3)) * [0.7, 0.8, 0.6] + [0.35 * sign, -0.2, 0.5]
        raised[:, 0] *= np.where(sign * raised[:, 0] < -0.4, -1.0, 1.0)
        raised[:, 2] = np.maximum(raised[:, 2], -0.5)
        direction = np.where(random.random((size, 1)) < 0.35, hanging, raised)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        rest = np.array([sign, 0.0, 0.0])
        axis = np.cross(rest, direction)
        axis /= np.linalg.norm(axis, axis=1, keepdims=True) + 1e-9
        swing = exponential(np.arccos(np.clip(direction @ rest, -1, 1))[:, None] * axis)
        twist = exponential(random.uniform(-1.0, 1.0, (size, 1)) * rest)
        bent = np.where(random.random(size) < 0.4, random.uniform(0, 0.3, size), random.uniform(0, 2.4, size))
        rotations[:, self.skeleton.index(f"{side}_shoulder")] = swing @ twist
        rotations[:, self.skeleton.index(f"{side}_elbow")] = exponential(bent[:, None] * [0.0, -sign, 0.0])
        self._turn(rotations, f"{side}_wrist", 0.0, spread=(0.2, 0.2, 0.2))


def exercises(clips: int, seed: int) -> Motion:
    """Synthetic clips in the format of the motion capture. Each is mainly of one kind; the weights sum to 1."""
    random = np.random.default_rng([seed, 7])
    pool = PosePool(random)
    points = np.concatenate([_clip(pool, random) for _ in range(clips)])
    frames = np.full(clips, len(points) // clips)
    return Motion(
        points, np.cumsum(frames) - frames, frames, np.full(clips, FPS), np.full(clips, 1 / clips),
        np.tile(_height_parts(pool), (clips, 1)), np.tile(HEIGHT * lengths_of(pool.skeleton), (clips, 1)),
        ("synthetic",) * clips,
    )  # fmt: skip


def _height_parts(pool: PosePool) -> np.ndarray:
    """(6,) m, as `HEIGHT_PARTS` of training/motion.py."""
    at = dict(zip(pool.skeleton.joint_names, pool.skeleton.rest_positions))
    layout, rest = pool.kinematics.layout, np.tile(np.eye(3), (1, pool.skeleton.joint_count, 1, 1))
    at["head_top"] = pool.kinematics.pose(BodyState(rest, np.zeros((1, 3)))).landmarks[
        0, layout.names.index("head_top")
    ]
    pairs = (("left_hip", "left_knee"), ("left_knee", "left_ankle"), ("pelvis", "neck"), ("neck", "head"),
             ("head", "head_top"))  # fmt: skip
    thigh, shank, trunk, neck, head = (float(np.linalg.norm(at[a] - at[b])) for a, b in pairs)
    drop = abs(float(at["left_hip"][1] - at["pelvis"][1]))
    parts = np.array([thigh, shank, drop, trunk, neck, head])
    return np.asarray(parts * HEIGHT / parts.sum())


def _clip(pool: PosePool, random: np.random.Generator) -> np.ndarray:
    """(f, canonical, 3) m: one clip, y up."""
    frames = round(SECONDS * FPS)
    rotations = _between(*_drawn_keys(pool, random), frames)
    shaking = gaussian_filter1d(random.standard_normal((frames, pool.skeleton.joint_count, 3)), 8, axis=0)
    rotations = rotations @ exponential(0.2 * shaking)
    heading = np.cumsum(0.25 * gaussian_filter1d(random.standard_normal(frames), 30)) + random.uniform(-np.pi, np.pi)
    rotations[:, 0] = exponential(heading[:, None] * [0.0, 1.0, 0.0]) @ rotations[:, 0]
    pose = pool.kinematics.pose(BodyState(rotations, np.zeros((frames, 3))))
    moved = gaussian_filter1d(_motion_of_ground(pose.positions[:, pool.ground]), 2, axis=0)
    return (pose.landmarks - moved[:, None]).astype(np.float32)


def _drawn_keys(pool: PosePool, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Key poses (k, n, 3, 3), and the times for which they move on and are held before, (k,) s each."""
    shares = np.array([kind.share for kind in KINDS])
    own = KINDS[random.choice(len(KINDS), p=shares / shares.sum())]
    poses = []
    for draw in random.random(KEYS):
        kind = STAND if draw < STANDING else own if draw < STANDING + OWN else KINDS[random.integers(len(KINDS))]
        poses.append(pool.poses[kind][random.integers(POOL)])
    held = random.uniform(*HOLDS, KEYS) * (random.random(KEYS) < HELD)
    return np.array(poses), random.uniform(*MOVES, KEYS), held


def _between(poses: np.ndarray, moves: np.ndarray, holds: np.ndarray, frames: int) -> np.ndarray:
    """(frames, n, 3, 3): each pose (k, n, 3, 3) is held for `holds` s and reaches the next one in `moves` s."""
    ends = np.cumsum(moves + holds)
    time = np.minimum(np.arange(frames) / FPS, ends[-2] - 1e-6)
    key = np.searchsorted(ends, time, side="right")
    share = np.clip((time - (ends - moves)[key]) / moves[key], 0.0, 1.0)
    share = share**3 * (10 - 15 * share + 6 * share**2)
    apart = logarithm(poses[:-1].swapaxes(-1, -2) @ poses[1:])
    return np.asarray(poses[key] @ exponential(share[:, None, None] * apart[key]))


def _motion_of_ground(points: np.ndarray) -> np.ndarray:
    """(f, 3) m: motion of the lowest ones of points (f, p, 3), which stand; y is their height."""
    height = points[..., 1] - points[..., 1].min(1, keepdims=True)
    share = np.exp(-height / 0.03)
    share /= share.sum(1, keepdims=True)
    steps = (share[1:, :, None] * np.diff(points, axis=0)).sum(1)
    moved = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    moved[:, 1] = points[..., 1].min(1)
    return moved
