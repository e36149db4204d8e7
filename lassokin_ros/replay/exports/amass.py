"""Export SMPL pose parameters as an AMASS npz file, with the keys of both generations of AMASS.

AMASS of SMPL+H has poses, trans, betas, dmpls, gender, mocap_framerate. AMASS of SMPL-X ("stageii") has root_orient,
pose_body, pose_hand, pose_jaw, pose_eye, trans, betas, num_betas, gender, mocap_frame_rate, mocap_time_length and
surface_model_type. Present loaders read one or the other.

World frame: metres, z up, x to the right of the camera, y along its viewing direction, corrected for the camera's roll
and pitch; the floor under the feet is at z = 0, below the camera. The rest pose of SMPL is also that of this package:
T-pose, y up, x to the person's left, z to the front.
"""

from __future__ import annotations

from typing import Any, BinaryIO

import numpy as np

from lassokin_ros.core.body.roles import is_finger
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.replay.exports.sampling import Z_UP, ExportError, uniform
from lassokin_ros.replay.motion import Motion

BETAS = 16
SLOWEST = 30.0
"""Hz: loaders take every n-th frame, n = rate // 30, which must not be 0 (PHC, human2humanoid)."""
BODY, HANDS = slice(3, 66), slice(66, 156)
"""Columns of the joints between the root and the hands, which SMPL, SMPL+H and SMPL-X share, and of both hands."""
NOT_TRACKED = {"pose_jaw": 3, "pose_eye": 6, "dmpls": 8}
"""Arrays of zeros and their columns."""
SMPL, SMPLH = "anthropometric", "body_hands"
"""The built-in skeletons. The first has the joint tree of SMPL, with the same names and order; the second, without the
joints `left_hand` and `right_hand`, that of SMPL+H."""


def write_amass(motion: Motion, file: BinaryIO) -> None:
    """Write one person: rotation vectors in rad, trans (f, 3) m, betas zero and gender neutral.

    poses (f, 72) holds all 24 joints; root_orient (f, 3) and pose_body (f, 63) are its first 22. With fingers it is
    (f, 156), the 52 joints of SMPL+H, and pose_hand (f, 90) its last 30; without them pose_hand is zero. Jaw and eyes
    are not tracked: pose_jaw (f, 3), pose_eye (f, 6) are zero, and so are dmpls (f, 8).
    angles_observed (f, 24) or (f, 52), rotation_deviations of the same shape, rad, and start_time, s, are additions:
    see `write_npz`.
    trans is the pelvis position. SMPL adds the rest position of its pelvis to trans: subtract it to pose an SMPL mesh.
    Raises ExportError for a skeleton without SMPL's root, and for stamps that cannot be resampled (see sampling).
    """
    track = uniform(motion, Z_UP, SLOWEST)
    count = len(track.rotations)
    poses = logarithm(smpl_rotations(motion.skeleton, track.rotations)).reshape(count, -1)
    rate = np.array(max(round(1 / track.period, 6), SLOWEST))
    not_tracked: dict[str, Any] = {name: np.zeros((count, width)) for name, width in NOT_TRACKED.items()}
    np.savez(
        file,
        poses=poses,
        root_orient=poses[:, : BODY.start],
        pose_body=poses[:, BODY],
        pose_hand=poses[:, HANDS] if poses.shape[1] == HANDS.stop else np.zeros((count, HANDS.stop - HANDS.start)),
        **not_tracked,
        trans=track.translations,
        betas=np.zeros(BETAS),
        num_betas=np.array(BETAS),
        gender=np.array("neutral"),
        surface_model_type=np.array("smplh" if poses.shape[1] == HANDS.stop else "smpl"),
        angles_observed=of_smpl(motion.skeleton, track.angles_observed, False),
        rotation_deviations=of_smpl(motion.skeleton, track.rotation_deviations, np.nan),
        mocap_framerate=rate,
        mocap_frame_rate=rate,
        mocap_time_length=np.array(count * track.period),
        start_time=np.array(motion.start),
    )


def check_root(skeleton: Skeleton) -> None:
    """Raise ExportError for a skeleton without SMPL's root."""
    root = Skeleton.load(SMPL, 1.0).joint_names[0]
    if skeleton.joint_names[0] != root:
        raise ExportError(
            f"an .amass.npz file needs SMPL's joint names; the root of skeleton '{skeleton.name}' is "
            f"'{skeleton.joint_names[0]}', not '{root}'"
        )


def of_smpl(skeleton: Skeleton, values: np.ndarray, missing: float) -> np.ndarray:
    """Return (f, 24 or 52) of SMPL's joints, `missing` for those that the skeleton lacks. values: (f, n) of joints."""
    names = list(_smpl_parents(skeleton))
    known = [skeleton.index(name) if name in skeleton.joint_names else -1 for name in names]
    return np.where(np.array(known) >= 0, values[:, known], missing)


def _smpl_parents(skeleton: Skeleton) -> dict[str, str]:
    """Return SMPL's joints, those of SMPL+H for a skeleton with fingers, and the parent of each; the root's is ""."""
    fingers = any(is_finger(joint) for joint in skeleton.joint_names)
    smpl = Skeleton.load(SMPLH if fingers else SMPL, 1.0)
    names = smpl.joint_names
    parents = {name: names[parent] if parent >= 0 else "" for name, parent in zip(names, smpl.parents)}
    return {name: parent for name, parent in parents.items() if not (fingers and name.endswith("_hand"))}


def smpl_rotations(skeleton: Skeleton, rotations: np.ndarray) -> np.ndarray:
    """Return (f, 24, 3, 3) local rotations of SMPL's joints; identity for joints that the skeleton lacks.

    With fingers they are the 52 joints of SMPL+H.

    rotations: (f, n, 3, 3) local rotations of the skeleton's joints. The rotation of an additional joint between two
    SMPL joints is added to the lower one.
    """
    smpl = _smpl_parents(skeleton)
    check_root(skeleton)
    turned = rotations.copy()  # orientations
    for joint in range(1, skeleton.joint_count):
        turned[:, joint] = turned[:, skeleton.parents[joint]] @ rotations[:, joint]
    result = np.empty((len(rotations), len(smpl), 3, 3))
    orientations: dict[str, np.ndarray] = {"": np.eye(3)}
    for joint, (name, parent) in enumerate(smpl.items()):
        above = orientations[parent]
        orientations[name] = turned[:, skeleton.index(name)] if name in skeleton.joint_names else above
        result[:, joint] = np.swapaxes(above, -1, -2) @ orientations[name]
    return result
