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
            for stamp, *row in zip(motion.stamps_ns[part].tolist(), *(group[part].tolist() for group in values)):
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
        (each("position", *(f" {axis} [m]" for axis in "xyz")), motion.positions.reshape(count, -1), ".6f"),
        (each("angle", *(f" {axis} [rad]" for axis in "xyz")), motion.angles.reshape(count, -1), ".6f"),
        (["reprojection [px]"], motion.reprojection_px[:, None], ".6f"),
        (each("deviation [m]"), motion.deviations, ".6f"),
        (["likely wrong"], motion.likely_wrong[:, None], "d"),
        ([f"{ankle} stands" for ankle in ankles], motion.contacts[:, [joints.index(ankle) for ankle in ankles]], "d"),
        ([f"{name} [deg]" for name in angles], np.array([*angles.values()]).reshape(len(angles), count).T, ".2f"),
        (each("angles observed"), motion.angles_observed, "d"),
        (each("speed [m/s]"), motion.speeds, ".4f"),
        (each("rotation deviation [rad]"), motion.rotation_deviations, ".4f"),
    ]


def write_npz(motions: Sequence[Motion], file: BinaryIO) -> None:
    """Write all people, one after the other: r rows, n joints, l landmarks, p people; camera optical frame, m and rad.

    The file is not compressed, because the output of zlib depends on its version: equal motions give equal bytes.
    """
    first = motions[0]
    skeleton = first.skeleton

    def rows(name: str) -> np.ndarray:
        columns = [getattr(motion, name) for motion in motions]
        return columns[0] if len(columns) == 1 else np.concatenate(columns)  # one person: no copy

    arrays: dict[str, Any] = {
        "stamp_ns": rows("stamps_ns"),  # (r,)
        "person": np.repeat([motion.person for motion in motions], [motion.frame_count for motion in motions]),  # (r,)
        "joint_positions": rows("positions"),  # (r, n, 3)
        "joint_rotations": rows("rotations"),  # (r, n, 3, 3), each in its parent's frame
        "joint_angles": rows("angles"),  # (r, n, 3) about x, y, z
        "translation": rows("translations"),  # (r, 3)
        "landmark_positions": rows("landmarks"),  # (r, l, 3)
        "detected_px": rows("detected"),  # (r, l, 2), NaN = missing
        "reprojection_px": rows("reprojection_px"),  # (r,)
        "relative_duality_gap": rows("relative_gap"),  # (r,)
        "support_size": rows("support_size"),  # (r,)
        "initialised": rows("initialised"),  # (r,) bool
        "joint_speeds": rows("speeds"),  # (r, n) m/s
        "joint_deviations": rows("deviations"),  # (r, n)
        "rotation_deviations": rows("rotation_deviations"),  # (r, n) rad
        "joint_observed": rows("observed"),  # (r, n) bool
        "angles_observed": rows("angles_observed"),  # (r, n) bool
        "likely_wrong": rows("likely_wrong"),  # (r,) bool
        "level": first.level,  # (3, 3) from the camera frame to a level one
        "joint_contacts": rows("contacts"),  # (r, n) bool, ankles of feet that stand still
        "floor": np.array(first.floor),  # m above the camera, in a level frame
        "start_ns": np.array(first.start_ns),  # stamp at which the recording begins; 0 of a video's first image
        "smoothing": np.array(first.smoothing),  # s, with later frames; 0 without
        "lens": np.array(first.lens),  # assumed or given
        "height_from": np.array(first.height_from),  # assumed or given
        "people": np.array([motion.person for motion in motions]),  # (p,)
        "rest_offsets": np.array([motion.skeleton.offsets for motion in motions]),  # (p, n, 3), the last frame's
        "joint_names": np.array(skeleton.joint_names),  # (n,)
        "joint_parents": skeleton.parents,  # (n,), -1 for the root
        "joint_axes": np.array(skeleton.axes),  # (n,) order of the three angles
        "landmark_names": np.array(first.landmark_names),  # (l,)
        "frame_id": np.array(first.frame_id),
    }
    np.savez(file, **arrays, **_of_cameras(motions))


def _of_cameras(motions: Sequence[Motion]) -> dict[str, Any]:
    """Return the arrays of several cameras, none of a single one."""
    names = list(motions[0].cameras)
    arrays = {"camera_names": np.array(names)} if names else {}  # (c,)
    for name in names:
        seen = [motion.cameras[name] for motion in motions]
        arrays[f"detected_px_{name}"] = np.concatenate([one.detected for one in seen])  # (r, l, 2), NaN = missing
        arrays[f"reprojected_px_{name}"] = np.concatenate([one.reprojected for one in seen])  # (r, l, 2)
    return arrays
