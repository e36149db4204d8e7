"""A motion at a constant rate, for formats that know no stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.rotations import exponential, logarithm
from lassokin_ros.replay.exports.errors import ExportError
from lassokin_ros.replay.motion import Motion

JITTER_NS = 1_000_000
"""ns: frames whose stamps are all this near to a constant rate are taken as they are."""
ONE_FRAME_S = 1 / 30
"""s: the period of a motion of a single frame."""
MOST_SAMPLES = 200_000
"""Samples that a motion of few frames may be spread over: an hour and a half at 30 Hz."""


@dataclass(frozen=True, eq=False)
class Track:
    """period: s; rotations: (f, n, 3, 3) local; translations: (f, 3) m of the root; camera optical frame."""

    period: float
    rotations: np.ndarray
    translations: np.ndarray


def uniform(motion: Motion) -> Track:
    """The motion at a constant rate, from its first stamp to its last.

    Regular stamps (to `JITTER_NS`) leave the frames as they are. Others are sampled anew at the median period: between
    two frames each joint turns about one axis at constant speed and the root moves on a straight line, through gaps
    too. Raises ExportError where the stamps jump back, or so far that the samples would be too many.
    """
    stamps, count = motion.stamps_ns, motion.frame_count
    if count == 1:
        return Track(ONE_FRAME_S, motion.rotations, motion.translations)
    since = stamps - stamps[0]
    steps = np.diff(since)
    if steps.min() <= 0:
        back = int(np.argmin(steps))
        raise ExportError(
            f"the stamps jump back by {-steps[back] * 1e-9:.3f} s at frame {back + 1}, which a file of one constant "
            "rate cannot hold; export .csv or .npz, or replay the parts of the recording alone"
        )
    regular = since[-1] / (count - 1)
    if np.abs(since - regular * np.arange(count)).max() <= JITTER_NS:
        return Track(regular * 1e-9, motion.rotations, motion.translations)
    period = float(np.median(steps))
    samples = int(since[-1] / period) + 1
    if samples > max(MOST_SAMPLES, 10 * count):
        raise ExportError(
            f"{count} frames are spread over {since[-1] * 1e-9:.0f} s, {samples} samples at a constant rate; expected "
            f"at most {MOST_SAMPLES}; export .csv or .npz"
        )
    return _sampled(motion, since, period * np.arange(samples))


def _sampled(motion: Motion, since: np.ndarray, times: np.ndarray) -> Track:
    before = np.clip(np.searchsorted(since, times, side="right") - 1, 0, len(since) - 2)
    share = (times - since[before]) / (since[before + 1] - since[before])
    turns = logarithm(np.swapaxes(motion.rotations[:-1], -1, -2) @ motion.rotations[1:])
    rotations = motion.rotations[before] @ exponential(share[:, None, None] * turns[before])
    ways = np.diff(motion.translations, axis=0)
    return Track(times[1] * 1e-9, rotations, motion.translations[before] + share[:, None] * ways[before])
