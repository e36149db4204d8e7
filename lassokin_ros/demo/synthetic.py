"""Synthetic motion with known truth, and simulated detections of it, for the demo and the tests.

The motion is a function of time; the detections also depend on a seed. Both are repeatable.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.pipeline.camera.lens import Lens

UPRIGHT = np.diag([1.0, -1.0, -1.0])
"""Orientation of a person who stands upright and faces the camera."""

DISTANCE = 3.6  # m, to the camera
CAMERA_HEIGHT = 1.1  # m


@dataclass(frozen=True, eq=False)
class Camera:
    """A webcam: K (3, 3) px, plumb_bob coefficients D (5,), size (width, height) px."""

    K: np.ndarray
    D: np.ndarray
    size: tuple[int, int]

    @property
    def lens(self) -> Lens:
        """The lens of the camera."""
        return Lens(self.K, self.D, "plumb_bob" if self.D.any() else "")


WEBCAM = Camera(
    np.array([[920.0, 0.0, 645.0], [0.0, 918.0, 352.0], [0.0, 0.0, 1.0]]),
    np.array([-0.11, 0.06, 0.0008, -0.0006, 0.0]),
    (1280, 720),
)


@dataclass(frozen=True)
class Detector:
    """Error model of a detector.

    noise_px: standard deviation, px. outliers: share of wrong points. gaps_per_second: rate of gaps, per landmark.
    gap_s: range of their duration, s.
    """

    noise_px: float = 2.0
    outliers: float = 0.005
    gaps_per_second: float = 0.1
    gap_s: tuple[float, float] = (0.1, 0.4)


def motion(skeleton: Skeleton, times: np.ndarray) -> BodyState:
    """Return the state in the camera frame at times (f,) s: rotations (f, n, 3, 3), translations (f, 3) m.

    The person walks on the spot while turning to both sides, waves and squats, in a cycle of 12 s. The cycles differ
    slightly, since the parts have different periods. The feet stay on the ground. The skeleton must have the joint
    names and the T-pose of SMPL.
    """
    t = np.asarray(times, dtype=float)
    walk, wave, squat = _share(t, 0.0), _share(t, 1 / 3), _share(t, 2 / 3)
    step, to_and_fro = 2 * np.pi * 0.9 * t, 1.1 + 0.5 * np.sin(2 * np.pi * 1.1 * t)
    rotations = np.tile(np.eye(3), (len(t), skeleton.joint_count, 1, 1))

    def turn(joint: str, **angles: np.ndarray | float) -> None:
        index = skeleton.index(joint)
        for axis, angle in angles.items():
            vectors = np.zeros((len(t), 3))
            vectors[:, "xyz".index(axis)] = angle
            rotations[:, index] = rotations[:, index] @ exponential(vectors)

    yaw = 0.55 * np.sin(2 * np.pi * t / 7.3)
    rotations[:, 0] = UPRIGHT
    turn("pelvis", y=yaw, x=0.25 * squat, z=0.03 * walk * np.sin(step))
    turn("spine1", x=0.05 + 0.12 * squat, y=0.06 * walk * np.sin(step))
    turn("spine3", x=0.04 + 0.06 * squat, y=0.08 * walk * np.sin(step) + 0.1 * wave)
    turn("neck", x=-0.08 - 0.1 * squat, y=-0.4 * yaw)
    turn("head", y=0.15 * np.sin(2 * np.pi * t / 4.1), x=0.06 * np.sin(2 * np.pi * t / 2.9))
    for side, sign, phase in (("left", 1.0, 0.0), ("right", -1.0, np.pi)):
        swing = np.sin(step + phase)
        lift = walk * np.clip(swing, 0, None) ** 2
        thigh = 0.06 + 0.55 * lift + 0.95 * squat
        knee = 0.12 + 0.95 * lift + 1.55 * squat
        turn(f"{side}_hip", x=-thigh, z=0.06 * sign)
        turn(f"{side}_knee", x=knee)
        turn(f"{side}_ankle", x=0.6 * (thigh - knee) + 0.2 * squat)
        waving = wave if side == "right" else 0.25 * wave
        turn(f"{side}_shoulder", x=0.45 * walk * swing - 0.9 * squat, z=-sign * (1.32 - 1.35 * waving))
        turn(f"{side}_elbow", y=-sign * (0.35 + 0.25 * walk * (1 - swing)), z=sign * waving * to_and_fro)
        turn(f"{side}_wrist", y=-0.1 * sign * np.sin(2 * np.pi * t / 1.7))
    return BodyState(rotations, _on_the_ground(skeleton, rotations, t))


def _share(t: np.ndarray, offset: float) -> np.ndarray:
    """Return the weight (f,), 0 to 1, of one of the three parts of the 12 s cycle; smooth in time."""
    on = np.clip(1.5 * np.cos(2 * np.pi * (t / 12.0 - offset)) - 0.25, 0, 1)
    return on * on * (3 - 2 * on)


def _on_the_ground(skeleton: Skeleton, rotations: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return translations (f, 3) m that keep the lower foot on the ground, with a small sway."""
    pose = _kinematics(skeleton).pose(BodyState(rotations, np.zeros((len(t), 3))))
    feet = [skeleton.index(f"{side}_{joint}") for side in ("left", "right") for joint in ("ankle", "foot")]
    lowest = pose.positions[:, feet, 1].max(axis=1)
    sway = 0.12 * np.sin(2 * np.pi * t / 9.1), 0.2 * np.sin(2 * np.pi * t / 11.7)
    return np.stack([sway[0], CAMERA_HEIGHT - 0.05 - lowest, DISTANCE + sway[1]], axis=-1)


@lru_cache
def _kinematics(skeleton: Skeleton) -> Kinematics:
    return Kinematics(skeleton, Layout.load("smpl24", skeleton))


def exact_pixels(kinematics: Kinematics, states: BodyState, camera: Camera = WEBCAM) -> np.ndarray:
    """Return the landmarks projected through the lens, (f, l, 2) px of the raw image."""
    normalised = project(kinematics.pose(states).landmarks)
    return camera.lens.distort(normalised.reshape(-1, 2)).reshape(normalised.shape)


def detections(
    pixels: np.ndarray, rate: float, seed: int = 0, detector: Detector = Detector()
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate detections of exact pixels (f, l, 2): return pixels and confidence (f, l), 0 = not detected.

    rate: Hz. Wrong points have the same distribution of confidence as the others.
    """
    random = np.random.default_rng(seed)
    frames, landmarks = pixels.shape[:2]
    found = pixels + random.normal(size=pixels.shape) * detector.noise_px
    confidence = random.beta(12, 3, size=(frames, landmarks))
    wrong = random.random((frames, landmarks)) < detector.outliers
    angle, size = random.uniform(0, 2 * np.pi, wrong.sum()), random.uniform(30, 120, wrong.sum())
    found[wrong] += np.stack([np.cos(angle), np.sin(angle)], axis=-1) * size[:, None]
    for landmark in range(landmarks):
        for start in np.flatnonzero(random.random(frames) < detector.gaps_per_second / rate):
            confidence[start : start + round(random.uniform(*detector.gap_s) * rate), landmark] = 0.0
    return np.where(confidence[..., None] > 0, found, 0.0), confidence
