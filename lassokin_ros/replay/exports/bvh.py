"""BVH, which Blender, MotionBuilder and most animation tools open.

Metres; y up, x to the camera's right, z towards the camera: its optical frame, levelled by how it is mounted, turned by
half a turn about the x axis. At rest the person stands in a T-pose with the pelvis at the origin; the pelvis
has position channels, every joint its three rotations in the order of its angles in `joint_states`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from lassokin_ros.core.body.joint_angles import JointAngleReader
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.replay.exports.sampling import uniform
from lassokin_ros.replay.motion import Motion

WORLD_FROM_LEVEL = np.diag([1.0, -1.0, -1.0])
TIP = 0.5
"""Length of what ends a chain, in lengths of the bone before it: BVH wants one, we have none."""
SMALLEST_TIP = 0.02  # m


def write_bvh(motion: Motion, file: BinaryIO) -> None:
    """Write one person. Raises ExportError for stamps that a constant rate cannot stand for (see sampling)."""
    track, skeleton = uniform(motion), motion.skeleton
    rotations = track.rotations.copy()
    world = WORLD_FROM_LEVEL @ motion.level
    rotations[:, 0] = world @ rotations[:, 0]
    places = track.translations @ world.T
    head = f"{hierarchy(skeleton)}MOTION\nFrames: {len(places)}\nFrame Time: {track.period:.9f}\n"
    file.write(head.encode())
    order, joints = channel_order(skeleton)
    reader = JointAngleReader(skeleton.axes)
    for place, turns in zip(places, rotations):
        angles = np.degrees(reader.read(turns))[joints, order]
        file.write((" ".join(f"{value:.6f}" for value in (*place, *angles.reshape(-1))) + "\n").encode())


def hierarchy(skeleton: Skeleton) -> str:
    """The file's first part, the skeleton at rest."""
    return "\n".join(["HIERARCHY", *_joint(skeleton, 0, 0)]) + "\n"


def channel_order(skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) axes of each joint's channels, and (n, 1) the joints, in the order in which the file lists them."""
    joints = np.array(list(_depth_first(skeleton, 0)))
    axes = np.array([["xyz".index(axis) for axis in word] for word in skeleton.axes])
    return axes[joints], joints[:, None]


def _depth_first(skeleton: Skeleton, joint: int) -> Iterator[int]:
    yield joint
    for child in np.flatnonzero(skeleton.parents == joint):
        yield from _depth_first(skeleton, int(child))


def _joint(skeleton: Skeleton, joint: int, depth: int) -> Iterator[str]:
    """The lines of a joint and of all below it."""
    indent = "  " * depth
    name = "_".join(skeleton.joint_names[joint].split())  # a blank would end the name
    turns = " ".join(f"{axis.upper()}rotation" for axis in skeleton.axes[joint])
    channels = f"6 Xposition Yposition Zposition {turns}" if depth == 0 else f"3 {turns}"
    yield f"{indent}{'JOINT' if depth else 'ROOT'} {name}"
    yield f"{indent}{{"
    yield f"{indent}  OFFSET {_numbers(skeleton.offsets[joint])}"
    yield f"{indent}  CHANNELS {channels}"
    children = np.flatnonzero(skeleton.parents == joint)
    for child in children:
        yield from _joint(skeleton, int(child), depth + 1)
    if not len(children):
        yield f"{indent}  End Site"
        yield f"{indent}  {{"
        yield f"{indent}    OFFSET {_numbers(_tip(skeleton.offsets[joint]))}"
        yield f"{indent}  }}"
    yield f"{indent}}}"


def _tip(bone: np.ndarray) -> np.ndarray:
    long_enough = np.linalg.norm(bone) * TIP >= SMALLEST_TIP
    return bone * TIP if long_enough else np.array([0.0, SMALLEST_TIP, 0.0])


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9f}" for value in values)
