"""Export CSV: one row per frame and person; the header gives the unit of each column."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from typing import BinaryIO

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
