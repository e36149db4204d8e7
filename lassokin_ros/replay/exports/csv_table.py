"""Export CSV: one row per frame and person; the header gives the unit of each column."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from typing import BinaryIO

import numpy as np

from lassokin_ros.replay.motion import Motion

SECOND = 1_000_000_000  # ns
BLOCK = 1000
"""Frames of which the values are in memory at once."""


def header(joint_names: Sequence[str]) -> list[str]:
    """Return the column names: stamp, person, joint positions and angles, reprojection error, deviations, doubt."""
    positions = [f"{joint} position {axis} [m]" for joint in joint_names for axis in "xyz"]
    angles = [f"{joint} angle {axis} [rad]" for joint in joint_names for axis in "xyz"]
    deviations = [f"{joint} deviation [m]" for joint in joint_names]
    return ["stamp [s]", "person", *positions, *angles, "reprojection [px]", *deviations, "likely wrong"]


def write_csv(motions: Sequence[Motion], file: BinaryIO) -> None:
    """Write all people, one after the other.

    Positions are in the camera optical frame, rounded to 1 um. Angles are those of `joint_states`, rounded to 1e-6 rad.
    Stamps are written with all nanoseconds; a reader that parses them as float64 loses the last two digits.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(header(motions[0].skeleton.joint_names))
    for motion in motions:
        for begin in range(0, motion.frame_count, BLOCK):
            rows.writerows(_block(motion, slice(begin, begin + BLOCK)))
    text.flush()
    text.detach()  # leave the file open for the caller


def _block(motion: Motion, part: slice) -> Iterator[list[str]]:
    """Yield the rows of some frames."""
    positions, angles = motion.positions[part], motion.angles[part]
    count = len(positions)
    flat = positions.reshape(count, -1), angles.reshape(count, -1)
    figures = np.concatenate([*flat, motion.reprojection_px[part, None], motion.deviations[part]], axis=1)
    rows = zip(motion.stamps_ns[part].tolist(), figures.tolist(), motion.likely_wrong[part].tolist())
    for stamp, row, wrong in rows:
        time = f"{stamp // SECOND}.{stamp % SECOND:09d}"
        yield [time, motion.person, *(f"{value:.6f}" for value in row), str(int(wrong))]
