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
ONE_FRAME_S = 1 / 30
"""s: the period of a motion of a single frame."""
MOST_SAMPLES = 200_000
"""Limit on the number of samples for a motion of few frames: 1.9 hours at 30 Hz."""


@dataclass(frozen=True, eq=False)
class Track:
    """A motion at a constant rate.

    period: s. rotations: (f, n, 3, 3) local. translations: (f, 3) m, of the root. angles_observed: (f, n) and
    rotation_deviations: (f, n) rad, those of the nearest frame, see `Motion`.
    """

    period: float
    rotations: np.ndarray
    translations: np.ndarray
    angles_observed: np.ndarray
    rotation_deviations: np.ndarray


def uniform(motion: Motion, slowest: float = 0.0) -> Track:
    """Return the motion at a constant rate, from its first stamp to its last.

    Frames with regular stamps (within `JITTER_NS`) are returned unchanged. Others are resampled at the median period:
    between two frames, also across gaps, each joint rotates about a fixed axis at constant speed and the root moves on
    a straight line. slowest: Hz; a rate that is lower by more than 0.01 % is resampled to it. Raises ExportError if the
    stamps jump back, or if the result would exceed `MOST_SAMPLES`.
    """
    stamps, count = motion.stamps_ns, motion.frame_count
    if count == 1:
        return _unchanged(motion, ONE_FRAME_S)
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
        return _unchanged(motion, regular * 1e-9)
    period = float(np.median(steps)) if slowest == 0.0 else min(float(np.median(steps)), 1e9 / slowest)
    samples = int(since[-1] / period + ROUNDING) + 1
    if samples > max(MOST_SAMPLES, 10 * count):
        raise ExportError(
            f"{count} frames are spread over {since[-1] * 1e-9:.0f} s, which needs {samples} samples at a constant "
            f"frame rate; expected at most {MOST_SAMPLES}; export .csv or .npz"
        )
    return _sampled(motion, since, period, np.minimum(period * np.arange(samples), since[-1]))


def _unchanged(motion: Motion, period: float) -> Track:
    return Track(period, motion.rotations, motion.translations, motion.angles_observed, motion.rotation_deviations)


def _sampled(motion: Motion, since: np.ndarray, period: float, times: np.ndarray) -> Track:
    before = np.clip(np.searchsorted(since, times, side="right") - 1, 0, len(since) - 2)
    share = (times - since[before]) / (since[before + 1] - since[before])
    turns = logarithm(np.swapaxes(motion.rotations[:-1], -1, -2) @ motion.rotations[1:])
    rotations = motion.rotations[before] @ exponential(share[:, None, None] * turns[before])
    ways = np.diff(motion.translations, axis=0)
    places = motion.translations[before] + share[:, None] * ways[before]
    nearest = before + (share > 0.5)
    flags, deviations = motion.angles_observed[nearest], motion.rotation_deviations[nearest]
    return Track(period * 1e-9, rotations, places, flags, deviations)
