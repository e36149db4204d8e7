"""Real motion for time measurements: the clips' joint rotations on any skeleton, seen by a camera.

Without the shared clips, the project's own synthetic motion is used; `Motion.source` names the source.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.data.mocap import clip_skeleton, load_clip, true_state
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import Observation
from lassokin_ros.demo.synthetic import motion as synthetic_motion

CLIPS = ("02_05", "02_07")  # boxing, swordplay: 2053 frames
FPS, FOCAL, DISTANCE = 60.0, 1200.0, 3.5
HEIGHT = 1.75


@dataclass(frozen=True, eq=False)
class Motion:
    """f frames of the 24-joint skeleton in the camera frame; `starts`: frames at which another clip begins."""

    state: BodyState
    starts: tuple[int, ...]
    source: str


def load_motion(folder: Path, frames: int) -> Motion:
    """`frames` frames of `CLIPS` in `folder`, or of synthetic motion if they do not exist."""
    skeleton = Skeleton.load("anthropometric", HEIGHT)
    files = [folder / f"{name}.npz" for name in CLIPS]
    if not all(file.is_file() for file in files):
        return Motion(synthetic_motion(skeleton, np.arange(frames) / FPS), (0,), "synthetic motion")
    states = [_in_camera(file) for file in files]
    lengths = [len(state.translation) for state in states]
    rotations = np.concatenate([state.rotations for state in states])[:frames]
    translation = np.concatenate([state.translation for state in states])[:frames]
    starts = tuple(int(start) for start in np.cumsum([0, *lengths[:-1]]) if start < len(rotations))
    return Motion(BodyState(rotations, translation), starts, f"clips {', '.join(CLIPS)}")


def _in_camera(file: Path) -> BodyState:
    """A clip's state, with the camera at the height of its path's middle and 3.5 m in front of it."""
    clip = load_clip(file)
    skeleton = clip_skeleton(clip, generic=False)
    state = true_state(clip, Kinematics(skeleton, Layout.load("coco17", skeleton)))
    turn = np.diag([1.0, -1.0, -1.0]) @ Rotation.from_euler("y", 0.5).as_matrix()
    path = (state.translation - 0.5 * (state.translation.min(0) + state.translation.max(0))) @ turn.T
    path[:, 2] += DISTANCE - path[:, 2].min()
    rotations = state.rotations.copy()
    rotations[:, 0] = turn @ rotations[:, 0]
    return BodyState(rotations, path)


def on_skeleton(motion: Motion, skeleton: Skeleton) -> BodyState:
    """The motion on a skeleton with more joints; joints that the clips lack (fingers) bend periodically."""
    known = Skeleton.load("anthropometric", HEIGHT).joint_names
    frames = len(motion.state.translation)
    curl = np.zeros((frames, 3))
    curl[:, 2] = 0.3 * np.sin(np.arange(frames) / 20)
    rotations = np.repeat(exponential(curl)[:, None], skeleton.joint_count, axis=1)
    for joint, name in enumerate(skeleton.joint_names):
        if name in known:
            rotations[:, joint] = motion.state.rotations[:, known.index(name)]
    return BodyState(rotations, motion.state.translation)


def observe(state: BodyState, kinematics: Kinematics, noise_px: float = 2.0, seed: int = 0) -> list[Observation]:
    """The keypoints of a detector, at 60 Hz."""
    points = project(kinematics.pose(state).landmarks)
    points = points + np.random.default_rng(seed).normal(size=points.shape) * noise_px / FOCAL
    confidence = np.ones(points.shape[1])
    return [Observation(frame / FPS, p, confidence, FOCAL) for frame, p in enumerate(points)]
