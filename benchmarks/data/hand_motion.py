"""Simulated motion of hands, alone or at the arms of recorded people, and what a detector sees of them.

The hands are those of training/hands.py, of other people than in training. Orders of points: that of the layouts with
21 points (wrist, thumb, index, middle, ring, pinky).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.data.mocap import clip_skeleton, load_clip, true_state
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.roles import SIDES
from lassokin_ros.core.body.rotations import exponential, logarithm
from lassokin_ros.core.body.skeleton import Skeleton
from training.hands import DIRECTIONS, GESTURES, HIGH, LOW, POINTS, SHARES, TILT, VARIATION, points_of, somebody

FPS = 30.0
FINGERS = ("thumb", "index", "middle", "ring", "pinky")
ORDER = np.array([0, *(POINTS.index(f"{finger}{end}") for finger in FINGERS for end in ("1", "2", "3", "_tip"))])
"""(21,) index among `POINTS` of each point of the layouts."""
NOISE_PX, NOISE_SHARE, OFFSET, KEPT = 0.6, 0.018, 0.003, 0.6
"""Standard deviation of a keypoint: px, as a share of the hand's size in the image, lasting m; and the share of its
error that stays from frame to frame."""


@dataclass(frozen=True, eq=False)
class Motion:
    """points: (n, 21, 3) m, camera frame; orientations: (n, 3, 3) of the wrist."""

    points: np.ndarray
    orientations: np.ndarray


def moved(random: np.random.Generator, targets: np.ndarray, count: int) -> np.ndarray:
    """(count, k): from target to target (m, k) with least jerk (Flash and Hogan 1985), with rests between."""
    frames, current = [targets[:1]], targets[0]
    while sum(map(len, frames)) < count:
        target = targets[random.integers(len(targets))]
        s = np.linspace(0, 1, int(FPS * random.uniform(0.25, 0.7)))[1:, None]
        frames.append(current + (target - current) * s**3 * (10 - 15 * s + 6 * s * s))
        frames.append(np.repeat(target[None], int(FPS * random.uniform(0.1, 0.9)), axis=0))
        current = target
    return np.concatenate(frames)[:count]


def _shapes(random: np.random.Generator, count: int) -> np.ndarray:
    """(count, 21, 3) m: a person's left hand between gestures."""
    chosen = np.array(list(GESTURES.values()))[random.integers(len(GESTURES), size=40)]
    postures = np.clip(chosen + 0.8 * VARIATION * random.normal(size=chosen.shape), LOW, HIGH)
    return points_of(somebody(random), moved(random, postures, count))[:, ORDER]


def hand_alone(seed: int, side: str, seconds: float, distance: float) -> Motion:
    """A hand that turns and moves about a place before the camera."""
    random, count = np.random.default_rng(seed), int(seconds * FPS)
    keys = DIRECTIONS[random.choice(len(DIRECTIONS), size=30, p=SHARES)] @ exponential(
        TILT * random.normal(size=(30, 3))
    )
    turns, current = [], keys[0]
    while len(turns) < count:
        target = keys[random.integers(len(keys))]
        s = np.linspace(0, 1, int(FPS * random.uniform(0.8, 1.8)))[1:, None]
        turns += list(current @ exponential(s**3 * (10 - 15 * s + 6 * s * s) * logarithm(current.T @ target)))
        current = target
    orientations = np.array(turns[:count])
    spread = min(0.1, 0.15 * distance)
    places = moved(random, [0.0, 0.0, distance] + spread * random.normal(size=(30, 3)) * [1.0, 0.7, 0.6], count)
    points = _shapes(random, count) @ orientations.swapaxes(-1, -2)
    if side == "right":
        mirror = np.array([-1.0, 1.0, 1.0])
        points, orientations = points * mirror, mirror[:, None] * orientations * mirror
    return Motion(points + places[:, None], orientations)


def body_with_hands(
    file: Path, seed: int, seconds: float, distance: float
) -> tuple[Kinematics, BodyState, dict[str, Motion]]:
    """A recorded person with simulated hands at moving wrists: kinematics, states in the camera frame, hands."""
    random, clip, count = np.random.default_rng(seed), load_clip(file), int(seconds * FPS)
    skeleton = clip_skeleton(clip, generic=False)
    kinematics = Kinematics(skeleton, Layout.load("mediapipe33", Skeleton.load("anthropometric", 1.75)))
    state, stride = true_state(clip, kinematics), max(round(clip.fps / FPS), 1)
    begin = int(random.integers(max(1, len(state.translation) - stride * count)))
    chosen = slice(begin, begin + stride * count, stride)
    turn = np.diag([1.0, -1.0, -1.0]) @ exponential(np.array([0.0, random.uniform(-0.8, 0.8), 0.0]))
    rotations, places = state.rotations[chosen].copy(), state.translation[chosen]
    places = (places - places.mean(axis=0)) @ turn.T
    places[:, 2] += distance - np.median(places[:, 2]) + max(0.0, 1.2 - (distance + places[:, 2].min()))
    rotations[:, 0] = turn @ rotations[:, 0]
    for side in SIDES:
        targets = random.normal(size=(40, 3)) * [0.6, 0.25, 0.5]
        rotations[:, skeleton.index(f"{side}_wrist")] = exponential(moved(random, targets, len(rotations)))
    state = BodyState(rotations, places)
    pose, hands = kinematics.pose(state), {}
    for side in SIDES:
        wrist, mirror = skeleton.index(f"{side}_wrist"), np.array([1.0 if side == "left" else -1.0, 1.0, 1.0])
        orientations = pose.orientations[:, wrist]
        shapes = skeleton.height / 1.75 * _shapes(random, len(rotations))
        points = (shapes * mirror) @ orientations.swapaxes(-1, -2)
        hands[side] = Motion(points + pose.positions[:, wrist][:, None], orientations)
    return kinematics, state, hands


def noise(random: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """(n, ...) unit errors of which a share stays from frame to frame."""
    found = random.normal(size=shape)
    for frame in range(1, len(found)):
        found[frame] = KEPT * found[frame - 1] + np.sqrt(1 - KEPT**2) * found[frame]
    return found


def detected(random: np.random.Generator, points: np.ndarray, focal: float) -> np.ndarray:
    """(n, 21, 2) normalised keypoints of a hand's points (n, 21, 3)."""
    true = points[..., :2] / points[..., 2:]
    extent = np.linalg.norm(np.ptp(true, axis=1), axis=-1)
    size = NOISE_PX / focal + NOISE_SHARE * extent
    lasting = OFFSET * random.normal(size=(21, 2)) / points[..., 2].mean()
    return np.asarray(true + size[:, None, None] * noise(random, true.shape) + lasting)
