"""Export tables of all people: CSV, one row per frame and person, and npz, named arrays without pickled objects."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO

import numpy as np

from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.replay.exports.named_angles import named_angles
from lassokin_ros.replay.motion import Motion

SECOND = 1_000_000_000  # ns
BLOCK = 1000
"""Frames of which the values are in memory at once."""


def header(joint_names: Sequence[str], named: Sequence[str]) -> list[str]:
    """Return the column names: stamp, person, joint positions and angles, reprojection error, deviations, doubt,
    contacts, the named angles, which joints' angles are observed, speeds, and deviations of the rotations.
    """
    positions = [f"{joint} position {axis} [m]" for joint in joint_names for axis in "xyz"]
    angles = [f"{joint} angle {axis} [rad]" for joint in joint_names for axis in "xyz"]
    deviations = [f"{joint} deviation [m]" for joint in joint_names]
    return [
        "stamp [s]",
        "person",
        *positions,
        *angles,
        "reprojection [px]",
        *deviations,
        "likely wrong",
        *(f"{ankle} stands" for ankle in ANKLES if ankle in joint_names),
        *(f"{name} [deg]" for name in named),
        *(f"{joint} angles observed" for joint in joint_names),
        *(f"{joint} speed [m/s]" for joint in joint_names),
        *(f"{joint} rotation deviation [rad]" for joint in joint_names),
    ]


def write_csv(motions: Sequence[Motion], file: BinaryIO) -> None:
    """Write all people, one after the other.

    Positions are in the camera optical frame, rounded to 1 um. Angles are those of `joint_states`, rounded to 1e-6 rad.
    Stamps are written with all nanoseconds; a reader that parses them as float64 loses the last two digits.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(header(motions[0].skeleton.joint_names, list(named_angles(motions[0]))))
    for motion in motions:
        named = np.stack(list(named_angles(motion).values()) or [np.zeros(motion.frame_count)], axis=1)
        speeds = motion.speeds
        for begin in range(0, motion.frame_count, BLOCK):
            part = slice(begin, begin + BLOCK)
            rows.writerows(_block(motion, part, named[part], speeds[part]))
    text.flush()
    text.detach()  # leave the file open for the caller


def _block(motion: Motion, part: slice, named: np.ndarray, speeds: np.ndarray) -> Iterator[list[str]]:
    """Yield the rows of some frames. named: (frames, angles) degrees. speeds: (frames, joints) m/s."""
    positions, angles = motion.positions[part], motion.angles[part]
    count = len(positions)
    flat = positions.reshape(count, -1), angles.reshape(count, -1)
    figures = np.concatenate([*flat, motion.reprojection_px[part, None], motion.deviations[part]], axis=1)
    flags = np.column_stack([motion.likely_wrong[part], motion.contacts[part][:, _ankles(motion)]])
    turns = motion.rotation_deviations[part]
    columns = motion.stamps_ns[part], figures, flags, named, motion.angles_observed[part], speeds, turns
    for stamp, row, yes, degrees, seen, fast, turned in zip(*(column.tolist() for column in columns)):
        time = f"{stamp // SECOND}.{stamp % SECOND:09d}"
        yield [
            time,
            motion.person,
            *(f"{value:.6f}" for value in row),
            *(str(int(flag)) for flag in yes),
            *(f"{value:.2f}" for value in degrees),
            *(str(int(one)) for one in seen),
            *(f"{one:.4f}" for one in fast),
            *(f"{one:.4f}" for one in turned),
        ]


def _ankles(motion: Motion) -> list[int]:
    names = motion.skeleton.joint_names
    return [names.index(ankle) for ankle in ANKLES if ankle in names]


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
    if first.cameras:
        arrays["camera_names"] = np.array(list(first.cameras))  # (c,)
    for name in first.cameras:
        seen = [motion.cameras[name] for motion in motions]
        arrays[f"detected_px_{name}"] = np.concatenate([one.detected for one in seen])  # (r, l, 2), NaN = missing
        arrays[f"reprojected_px_{name}"] = np.concatenate([one.reprojected for one in seen])  # (r, l, 2)
    np.savez(file, **arrays)
