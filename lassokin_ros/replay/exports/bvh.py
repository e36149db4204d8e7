"""Export BVH, the format of Blender, MotionBuilder and most animation tools.

Units are metres. y points up, x to the right of the camera, z towards the camera: the optical frame, corrected for the
camera's roll and pitch and rotated by pi about x. The floor under the feet is at y = 0, below the camera. The rest
pose is a T-pose with the pelvis at the origin. The pelvis has position channels; every joint has three rotation
channels, all in one order: the loaders of LAFAN1 and of Holden, which retargeting tools use, apply the first order of a
file to all joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.pipeline.people.joint_angles import JointAngleReader
from lassokin_ros.replay.exports.sampling import uniform
from lassokin_ros.replay.motion import Motion

ORDER = "zyx"
"""Order of the rotations of all joints, each about the axes that the ones before have turned."""
TIP = 0.5
"""Length of an end site, as a fraction of the bone before it. BVH requires one; the skeleton has none."""
SMALLEST_TIP = 0.02  # m


def write_bvh(motion: Motion, file: BinaryIO) -> None:
    """Write one person. Raises ExportError for stamps that cannot be resampled (see sampling)."""
    track, skeleton = uniform(motion), motion.skeleton
    head = f"{hierarchy(skeleton)}MOTION\nFrames: {len(track.rotations)}\nFrame Time: {track.period:.9f}\n"
    file.write(head.encode())
    joints, order = list(_depth_first(skeleton, 0)), ["xyz".index(axis) for axis in ORDER]
    reader = JointAngleReader([ORDER] * skeleton.joint_count)
    for place, turns in zip(track.translations, track.rotations):
        angles = np.degrees(reader.read(turns))[joints][:, order]
        file.write((" ".join(f"{value:.6f}" for value in (*place, *angles.reshape(-1))) + "\n").encode())


def hierarchy(skeleton: Skeleton) -> str:
    """Return the HIERARCHY section, the skeleton at rest."""
    return "\n".join(["HIERARCHY", *_joint(skeleton, 0, 0)]) + "\n"


def _depth_first(skeleton: Skeleton, joint: int) -> Iterator[int]:
    yield joint
    for child in np.flatnonzero(skeleton.parents == joint):
        yield from _depth_first(skeleton, int(child))


def _joint(skeleton: Skeleton, joint: int, depth: int) -> Iterator[str]:
    """Yield the lines of a joint and its descendants."""
    indent = "  " * depth
    name = "_".join(skeleton.joint_names[joint].split())  # a blank ends a name in BVH
    turns = " ".join(f"{axis.upper()}rotation" for axis in ORDER)
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
    length = float(np.linalg.norm(bone))
    if length * TIP >= SMALLEST_TIP:
        return bone * TIP
    return bone * (SMALLEST_TIP / length) if length > 0 else np.array([0.0, SMALLEST_TIP, 0.0])


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9f}" for value in values)
