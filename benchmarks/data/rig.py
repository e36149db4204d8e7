"""Several simulated cameras around a clip, and a detector for each: the keypoints of one person from all sides."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.data.mocap import EVALUATED, Clip, clip_height, landmark_positions
from benchmarks.data.simulated_camera import Condition, detected, step_for
from benchmarks.data.strangers import displaced, displacements
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.observation import CameraPose, Observation

Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""(3, 3): from the clip's world (y up) to the fixed frame (z up)."""
DISTANCE = 3.5
"""m from the camera to the nearest place of the person."""


@dataclass(frozen=True, eq=False)
class Rig:
    """A clip seen by several cameras. truth: (f, 14, 3) m in the fixed frame (z up); poses: true place of each camera.

    points: (c, f, l, 2) normalised; confidence: (c, f, l), 0 = missing; focal: (c,) px; frame_of: (f,) index of the
    clip's frame of each image.
    """

    clip: Clip
    fps: float
    truth: np.ndarray
    poses: list[CameraPose]
    points: np.ndarray
    confidence: np.ndarray
    focal: np.ndarray

    def observation(self, camera: int, frame: int, pose: CameraPose | None = None) -> Observation:
        """What a camera sees in a frame. pose: as it is told to the tracker, default the true one."""
        return Observation(
            frame / self.fps,
            self.points[camera, frame],
            self.confidence[camera, frame],
            float(self.focal[camera]),
            camera=pose or self.poses[camera],
        )


def rig_of(
    clip: Clip,
    layout: Layout,
    skeleton: Skeleton,
    condition: Condition,
    cameras: int,
    angle: float,
    seed: int,
    person: str = "",
) -> Rig:
    """Level cameras around the middle of a clip, `angle` rad apart, f 1000-1400 px. person: as in `view_of`."""
    random = np.random.default_rng([seed, 31, *clip.name.encode()])
    step = step_for(clip.fps, condition.fps)
    frames = slice(None, None, step)
    pelvis = clip.position("pelvis")
    centre = 0.5 * (pelvis.min(0) + pelvis.max(0))
    distance = DISTANCE + np.linalg.norm((pelvis - centre)[:, [0, 2]], axis=1).max()
    first, flip = random.uniform(-np.pi, np.pi), np.diag([1.0, -1.0, -1.0])
    truth = (np.stack([clip.position(name)[frames] for name in EVALUATED], axis=1) - centre) @ Z_UP.T
    landmarks = landmark_positions(clip, layout, skeleton)
    if condition.landmark_mm > 0:
        off = displacements(layout, person, condition.landmark_mm / 1000, clip_height(clip), seed)
        landmarks = displaced(landmarks, clip, layout, skeleton, off)
    marks = (landmarks[frames] - centre) @ Z_UP.T
    poses, points, confidences, focals = [], [], [], []
    for camera in range(cameras):
        pitch = Rotation.from_euler("x", random.uniform(-0.15, 0.15)).as_matrix()
        R = pitch @ flip @ Rotation.from_euler("y", first + camera * angle).as_matrix() @ Z_UP.T
        pose = CameraPose(f"camera{camera}", R, np.array([0.0, 0.0, distance]))
        focal, seen = random.uniform(1000, 1400), pose.into_camera(marks)
        exact, own = seen[..., :2] / seen[..., 2:] * focal, condition if camera == 0 else replace(condition, swaps=0.0)
        pixels, confidence = detected(exact, clip.fps / step, layout, own, random, random)
        poses.append(pose)
        points.append(pixels / focal)
        confidences.append(confidence)
        focals.append(focal)
    return Rig(clip, clip.fps / step, truth, poses, np.array(points), np.array(confidences), np.array(focals))


def moved(pose: CameraPose, metres: float, radians: float, random: np.random.Generator) -> CameraPose:
    """A camera's place with an error of this size, in a random direction."""
    turn = random.normal(size=3)
    shift = random.normal(size=3)
    error = Rotation.from_rotvec(radians * turn / np.linalg.norm(turn)).as_matrix()  # about the camera's centre
    translation = error @ pose.translation + metres * shift / np.linalg.norm(shift)
    return CameraPose(pose.name, error @ pose.rotation, translation)
