"""Motions for the tests of the exports."""

import numpy as np

from lassokin_ros.replay.motion import Motion, Scene, angles_observed, speeds


def motion_of(skeleton, stamps_ns, rotations, places, person="", **more):
    """A motion of known turns (f, n, 3, 3) and places of the root (f, 3), all of whose joints are seen.

    more: of the scene, and other columns.
    """
    count, joints = rotations.shape[:2]
    seen, nothing, zeros = np.ones((count, joints), dtype=bool), np.zeros(count), np.zeros((count, joints, 3))
    figures = ("reprojection_px", "relative_duality_gap", "support_size")
    frames = {
        **dict.fromkeys(figures, nothing),
        "landmark_positions": zeros[:, :0],
        "detected_px": zeros[:, :0, :2],
        "initialised": nothing > 0,
        "stamp_ns": np.asarray(stamps_ns, dtype=np.int64),
        "joint_positions": np.tile(places[:, None], (1, joints, 1)),
        "joint_rotations": rotations,
        "translation": places,
        "joint_angles": zeros,
        "joint_deviations": zeros[..., 0],
        "rotation_deviations": np.full((count, joints), 0.25),
        "joint_observed": seen,
        "joint_contacts": ~seen,
        "likely_wrong": nothing > 0,
        "angles_observed": angles_observed(skeleton, seen),
    }
    frames |= {name: more.pop(name) for name in frames.keys() & more.keys()}
    frames["joint_speeds"] = speeds(frames["stamp_ns"], frames["joint_positions"])
    return Motion(person, "camera", skeleton, frames, Scene(**more))
