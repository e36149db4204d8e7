"""Resample a motion at a constant rate, for formats without stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.rotations import exponential, logarithm
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.replay.motion import Motion


class ExportError(LassokinError):
    """A motion cannot be represented in a format, or a file cannot be written."""


JITTER_NS = 1_000_000
"""ns: frames whose stamps deviate less than this from a constant rate are not resampled."""
ROUNDING = 0.01
"""Share of a period that may lack to the last sample: stamps and periods are whole ns."""
ONE_FRAME_NS = 1e9 / 30
"""ns: the period of a motion of a single frame."""
MOST_SAMPLES = 200_000
"""Limit on the number of samples for a motion of few frames: 1.9 hours at 30 Hz."""


Y_UP, Z_UP = np.diag([1.0, -1.0, -1.0]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rotations from the frame of a level camera to a world with x to the camera's right: y up and z towards the camera, or
y away from the camera and z up."""


@dataclass(frozen=True, eq=False)
class Track:
    """A motion at a constant rate in a world whose floor, under the feet, has the height 0.

    period: s. rotations: (f, n, 3, 3) local, that of the root in the world. translations: (f, 3) m, of the root.
    angles_observed: (f, n) and rotation_deviations: (f, n) rad, those of the nearest frame, see `write_npz`.
    """

    period: float
    rotations: np.ndarray
    translations: np.ndarray
    angles_observed: np.ndarray
    rotation_deviations: np.ndarray


def uniform(motion: Motion, world: np.ndarray = Y_UP, slowest: float = 0.0) -> Track:
    """Return the motion at a constant rate, from its first stamp to its last, in the world `Y_UP` or `Z_UP`.

    Frames with regular stamps (within `JITTER_NS`) are not changed. Others are resampled at the median period: between
    two frames, also across gaps, each joint rotates about a fixed axis at constant speed and the root moves on a
    straight line. slowest: Hz; a rate that is lower by more than 0.01 % is resampled to it. Raises ExportError if the
    stamps jump back, or if the result would exceed `MOST_SAMPLES`.
    """
    period, times = _times(motion, slowest)
    rotations, places = motion["joint_rotations"].copy(), motion["translation"]
    flags, deviations = motion["angles_observed"], motion["rotation_deviations"]
    if times is not None:
        since = motion["stamp_ns"] - motion["stamp_ns"][0]
        before = np.clip(np.searchsorted(since, times, side="right") - 1, 0, len(since) - 2)
        share = (times - since[before]) / (since[before + 1] - since[before])
        turns = logarithm(np.swapaxes(rotations[:-1], -1, -2) @ rotations[1:])
        rotations = rotations[before] @ exponential(share[:, None, None] * turns[before])
        places = places[before] + share[:, None] * np.diff(places, axis=0)[before]
        nearest = before + (share > 0.5)
        flags, deviations = flags[nearest], deviations[nearest]
    turn = world @ motion.scene.level
    rotations[:, 0] = turn @ rotations[:, 0]
    return Track(period * 1e-9, rotations, places @ turn.T + motion.scene.floor * world[:, 1], flags, deviations)


def _times(motion: Motion, slowest: float) -> tuple[float, np.ndarray | None]:
    """Return the period, ns, and the times (k,) of the samples, ns since the first frame; None for the frames' own."""
    stamps, count = motion["stamp_ns"], motion.frame_count
    if count == 1:
        return ONE_FRAME_NS, None
    since = stamps - stamps[0]
    steps = np.diff(since)
    if steps.min() <= 0:
        back = int(np.argmin(steps))
        raise ExportError(
            f"the stamps jump back by {-steps[back] * 1e-9:.3f} s at frame {back + 1}, which a format with a constant "
            "frame rate cannot represent; export .csv or .npz, or replay each part of the recording separately"
        )
    regular = since[-1] / (count - 1)
    fast_enough = 1e9 / regular >= 0.9999 * slowest
    if fast_enough and np.abs(since - regular * np.arange(count)).max() <= JITTER_NS:
        return regular, None
    period = float(np.median(steps)) if slowest == 0.0 else min(float(np.median(steps)), 1e9 / slowest)
    samples = int(since[-1] / period + ROUNDING) + 1
    if samples > max(MOST_SAMPLES, 10 * count):
        raise ExportError(
            f"{count} frames are spread over {since[-1] * 1e-9:.0f} s, which needs {samples} samples at a constant "
            f"frame rate; expected at most {MOST_SAMPLES}; export .csv or .npz"
        )
    return period, np.minimum(period * np.arange(samples), since[-1])
