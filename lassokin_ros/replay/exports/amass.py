"""Export SMPL pose parameters as an AMASS npz file, with the keys of both generations.

The first (SMPL+H) has poses, trans, betas, gender, mocap_framerate; the second (SMPL-X) has root_orient, pose_body,
pose_hand, pose_jaw, pose_eye and mocap_frame_rate in place of the first and the last.

World frame: metres, z up, x to the right of the camera, y along its viewing direction, corrected for the camera's roll
and pitch; the camera is at the origin. The rest pose of SMPL is also that of this package: T-pose, y up, x to the
person's left, z to the front.
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
HAND_ANGLES = 90
"""SMPL-X: 15 joints of 3 angles for each hand."""
SMPL = "anthropometric"
"""The built-in skeleton. It has the joint tree of SMPL, with the same names and order."""


def write_amass(motion: Motion, file: BinaryIO) -> None:
    """Write one person: poses (f, 72) axis-angle in rad, trans (f, 3) m, betas and gender neutral.

    root_orient (f, 3) and pose_body (f, 63) are the same angles without SMPL's two hand joints; pose_hand (f, 90),
    pose_jaw (f, 3) and pose_eye (f, 6) are zero, since nothing of them is measured.


    trans is the pelvis position. SMPL adds the rest position of its pelvis to trans: subtract it to pose an SMPL mesh.
    Raises ExportError for a skeleton without SMPL's root, and for stamps that cannot be resampled (see sampling).
    """
    track = uniform(motion)
    rotations = smpl_rotations(motion.skeleton, track.rotations)
    world = WORLD_FROM_LEVEL @ motion.level
    rotations[:, 0] = world @ rotations[:, 0]
    poses = logarithm(rotations).reshape(len(rotations), -1)
    rate = np.array(round(1 / track.period, 6))
    np.savez(
        file,
        poses=poses,
        trans=track.translations @ world.T,
        betas=np.zeros(BETAS),
        gender=np.array("neutral"),
        mocap_framerate=rate,
        mocap_frame_rate=rate,
        mocap_time_length=np.array(len(poses) / float(rate)),
        num_betas=np.array(BETAS),
        root_orient=poses[:, :3],
        pose_body=poses[:, 3:66],
        pose_hand=np.zeros((len(poses), HAND_ANGLES)),
        pose_jaw=np.zeros((len(poses), 3)),
        pose_eye=np.zeros((len(poses), 6)),
    )


def smpl_rotations(skeleton: Skeleton, rotations: np.ndarray) -> np.ndarray:
    """Return (f, 24, 3, 3) local rotations of SMPL's joints; identity for joints that the skeleton lacks.

    rotations: (f, n, 3, 3) local rotations of the skeleton's joints. The rotation of an additional joint between two
    SMPL joints is added to the lower one.
    """
    smpl = Skeleton.load(SMPL, 1.0)
    if skeleton.joint_names[0] != smpl.joint_names[0]:
        raise ExportError(
            f"an .amass.npz file needs SMPL's joint names; the root of skeleton '{skeleton.name}' is "
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
