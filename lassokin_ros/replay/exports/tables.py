"""Export tables of all people: CSV, one row per frame and person, and npz, named arrays without pickled objects."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from itertools import chain
from typing import Any, BinaryIO

import numpy as np

from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.replay.exports.named_angles import named_angles
from lassokin_ros.replay.motion import Motion

SECOND = 1_000_000_000  # ns
BLOCK = 1000
"""Frames of which the values are in memory at once."""


def write_csv(motions: Sequence[Motion], file: BinaryIO) -> None:
    """Write all people, one after the other.

    Positions are in the camera optical frame, rounded to 1 um. Angles are those of `joint_states`, rounded to 1e-6 rad.
    Stamps are written with all nanoseconds; a reader that parses them as float64 loses the last two digits.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    rows = csv.writer(text, lineterminator="\n")
    for motion in motions:
        names, values, formats = zip(*columns(motion))
        if motion is motions[0]:
            rows.writerow(["stamp [s]", "person", *chain(*names)])
        for begin in range(0, motion.frame_count, BLOCK):
            part = slice(begin, begin + BLOCK)
            for stamp, *row in zip(motion["stamp_ns"][part].tolist(), *(group[part].tolist() for group in values)):
                cells = [f"{value:{form}}" for group, form in zip(row, formats) for value in group]
                rows.writerow([f"{stamp // SECOND}.{stamp % SECOND:09d}", motion.person, *cells])
    text.flush()
    text.detach()  # leave the file open for the caller


def columns(motion: Motion) -> list[tuple[list[str], np.ndarray, str]]:
    """Return the columns of one person behind stamp and id, in groups: k names, values (f, k), and their format."""
    joints, count, angles = motion.skeleton.joint_names, motion.frame_count, named_angles(motion)
    ankles = [ankle for ankle in ANKLES if ankle in joints]

    def each(what: str, *axes: str) -> list[str]:
        return [f"{joint} {what}{axis}" for joint in joints for axis in axes or ("",)]

    return [
        (each("position", *(f" {axis} [m]" for axis in "xyz")), motion["joint_positions"].reshape(count, -1), ".6f"),
        (each("angle", *(f" {axis} [rad]" for axis in "xyz")), motion["joint_angles"].reshape(count, -1), ".6f"),
        (["reprojection [px]"], motion["reprojection_px"][:, None], ".6f"),
        (each("deviation [m]"), motion["joint_deviations"], ".6f"),
        (["likely wrong"], motion["likely_wrong"][:, None], "d"),
        ([f"{one} stands" for one in ankles], motion["joint_contacts"][:, [joints.index(one) for one in ankles]], "d"),
        ([f"{name} [deg]" for name in angles], np.array([*angles.values()]).reshape(len(angles), count).T, ".2f"),
        (each("angles observed"), motion["angles_observed"], "d"),
        (each("speed [m/s]"), motion["joint_speeds"], ".4f"),
        (each("rotation deviation [rad]"), motion["rotation_deviations"], ".4f"),
    ]


FRAMES = (
    "stamp_ns",  # (r,)
    "joint_positions",  # (r, n, 3)
    "joint_rotations",  # (r, n, 3, 3), each in its parent's frame; of the root in the camera's
    "joint_angles",  # (r, n, 3) about x, y, z
    "translation",  # (r, 3)
    "landmark_positions",  # (r, l, 3)
    "detected_px",  # (r, l, 2) px of the raw image, NaN = missing; of several cameras, of the first one
    "reprojection_px",  # (r,)
    "relative_duality_gap",  # (r,)
    "support_size",  # (r,)
    "initialised",  # (r,) bool
    "joint_speeds",  # (r, n) m/s
    "joint_deviations",  # (r, n), see `JointUncertainty`
    "rotation_deviations",  # (r, n) rad
    "joint_observed",  # (r, n) bool, joints that keypoints show
    "angles_observed",  # (r, n) bool
    "likely_wrong",  # (r,) bool, the frames that the report marks
    "joint_contacts",  # (r, n) bool, ankles of feet that stand still
)
"""The arrays of `Motion.frames` that are written."""


def write_npz(motions: Sequence[Motion], file: BinaryIO) -> None:
    """Write all people, one after the other: r rows, n joints, l landmarks, p people; camera optical frame, m and rad.

    The file is not compressed, because the output of zlib depends on its version: equal motions give equal bytes.
    """
    skeleton, scene = motions[0].skeleton, motions[0].scene
    of_cameras = [f"{kind}_px_{name}" for name in scene.cameras for kind in ("detected", "reprojected")]  # (r, l, 2)

    def rows(name: str) -> np.ndarray:
        columns = [motion[name] for motion in motions]
        return columns[0] if len(columns) == 1 else np.concatenate(columns)  # one person: no copy

    arrays: dict[str, Any] = {
        **{name: rows(name) for name in FRAMES},
        "person": np.repeat([motion.person for motion in motions], [motion.frame_count for motion in motions]),  # (r,)
        "level": scene.level,  # (3, 3) from the camera frame to a level one
        "floor": np.array(scene.floor),  # m above the camera, in a level frame
        "start_ns": np.array(scene.start_ns),  # stamp at which the recording begins; 0 of a video's first image
        "smoothing": np.array(scene.smoothing),  # s, with later frames; 0 without
        "lens": np.array(scene.lens),  # assumed or given
        "height_from": np.array(scene.height_from),  # assumed or given
        "people": np.array([motion.person for motion in motions]),  # (p,)
        "rest_offsets": np.array([motion.skeleton.offsets for motion in motions]),  # (p, n, 3), the last frame's
        "joint_names": np.array(skeleton.joint_names),  # (n,)
        "joint_parents": skeleton.parents,  # (n,), -1 for the root
        "joint_axes": np.array(skeleton.axes),  # (n,) order of the three angles
        "landmark_names": np.array(scene.landmark_names),  # (l,)
        "frame_id": np.array(motions[0].frame_id),
        **({"camera_names": np.array(scene.cameras)} if scene.cameras else {}),  # (c,)
        **{name: rows(name) for name in of_cameras},
    }
    np.savez(file, **arrays)
