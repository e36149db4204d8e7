"""Hands for tests: skeletons, layouts, and simulated motions with what a detector sees."""

from functools import cache

import numpy as np

from benchmarks.data.hand_motion import FPS, ORDER, Motion, detected, hand_alone
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from training.hands import GESTURES, points_of, somebody

BODY, LEFT, RIGHT = (Skeleton.load(name, 1.75) for name in ("body_hands", "left_hand", "right_hand"))
HANDS = {"left": LEFT, "right": RIGHT}
FOCAL = 600.0
MIRROR = {"left": np.ones(3), "right": np.array([-1.0, 1.0, 1.0])}
SOMEBODY = somebody(np.random.default_rng(0))


def posture(name: str, side: str = "right") -> np.ndarray:
    """(21, 3) m from the wrist, in its frame: a posture of training/hands.py."""
    return points_of(SOMEBODY, GESTURES[name][None])[0, ORDER] * MIRROR[side]


def kinematics_of(side: str) -> Kinematics:
    """Of a hand alone with its 21 points."""
    return Kinematics(HANDS[side], Layout.load(f"{side}_hand21", HANDS[side]))


def hand_tracker(side: str, **settings: object) -> Tracker:
    """A tracker of a hand alone."""
    return Tracker(
        TrackerConfig(height=1.75, skeleton=f"{side}_hand", landmarks=f"{side}_hand21", noise_px=2.0, **settings)
    )


@cache
def scene(side: str, seconds: float, seed: int = 0) -> tuple[Motion, np.ndarray]:
    """A hand at 0.6 m, and its keypoints (n, 21, 2), normalised."""
    motion = hand_alone(90_000 + seed, side, seconds, 0.6)
    return motion, detected(np.random.default_rng(seed), motion.points, FOCAL)


def seen(frame: int, points: np.ndarray, confidence: float = 0.9) -> Observation:
    """The observation of a frame."""
    return Observation(frame / FPS, points, np.full(len(points), confidence), FOCAL)
