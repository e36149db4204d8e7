"""SMPL's pose parameters in the form of an AMASS npz: poses, trans, betas, gender, mocap_framerate.

World of AMASS: metres, z up; x is the camera's right and y its viewing direction, levelled by how it is mounted; it is
at the origin. SMPL's rest pose is the T-pose with y up, x to the left, z to the front, which is our rest pose too.
"""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.replay.exports.errors import ExportError
from lassokin_ros.replay.exports.sampling import uniform
from lassokin_ros.replay.motion import Motion

WORLD_FROM_LEVEL = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
BETAS = 16
SMPL = "anthropometric"
"""The built-in skeleton: its tree is SMPL's, names, order and all."""


def write_amass(motion: Motion, file: BinaryIO) -> None:
    """Write one person: poses (f, 72) axis-angle in rad, trans (f, 3) m, betas and gender neutral.

    trans is the pelvis. SMPL itself adds its model's rest pelvis to trans: who poses a mesh with it subtracts that.
    Raises ExportError for a skeleton without SMPL's root, and for stamps without a constant rate (see sampling).
    """
    track = uniform(motion)
    rotations = smpl_rotations(motion.skeleton, track.rotations)
    world = WORLD_FROM_LEVEL @ motion.level
    rotations[:, 0] = world @ rotations[:, 0]
    np.savez(
        file,
        poses=logarithm(rotations).reshape(len(rotations), -1),
        trans=track.translations @ world.T,
        betas=np.zeros(BETAS),
        gender=np.array("neutral"),
        mocap_framerate=np.array(round(1 / track.period, 6)),
    )


def smpl_rotations(skeleton: Skeleton, rotations: np.ndarray) -> np.ndarray:
    """(f, 24, 3, 3) local rotations of SMPL's joints; those that the skeleton has not do not turn.

    rotations: (f, n, 3, 3) local, of the skeleton's joints. Joints between two of SMPL's turn the lower one.
    """
    smpl = Skeleton.load(SMPL, 1.0)
    if skeleton.joint_names[0] != smpl.joint_names[0]:
        raise ExportError(
            f"SMPL's poses need SMPL's joint names; the root of skeleton '{skeleton.name}' is "
            f"'{skeleton.joint_names[0]}', not '{smpl.joint_names[0]}'"
        )
    turned = rotations.copy()  # orientations
    for joint in range(1, skeleton.joint_count):
        turned[:, joint] = turned[:, skeleton.parents[joint]] @ rotations[:, joint]
    result = np.empty((len(rotations), smpl.joint_count, 3, 3))
    orientations = np.empty_like(result)
    for joint, (name, parent) in enumerate(zip(smpl.joint_names, smpl.parents)):
        known = name in skeleton.joint_names
        orientations[:, joint] = turned[:, skeleton.index(name)] if known else orientations[:, parent]
        above = orientations[:, parent] if joint else np.eye(3)
        result[:, joint] = np.swapaxes(above, -1, -2) @ orientations[:, joint]
    return result
