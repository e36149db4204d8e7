"""Foot strikes and toe-offs of a walk.

A strike is the mean of two signs: the ankle is farthest in front of the pelvis (J. Zeni, J. Richards, J. Higginson, Two
simple methods for determining gait events during treadmill and overground walking using kinematic data, Gait & Posture
27, 2008), and the ankle's speed over the floor falls below a share of its peak in the swing. A toe leaves the floor
where its speed rises above that share. The delays of these signs were fitted to captured foot contacts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, filtfilt, find_peaks

from lassokin_ros.measure.poses import SIDES, Poses

RATE, CUTOFF_HZ = 120.0, 6.0
"""Hz: of the resampled motion, and of its zero-phase low-pass filter."""
FACING_S = 1.0
"""s over which the direction of travel, or the one that the person faces, is averaged."""
TRAVELS = 0.3
"""m/s: below it the person is on a treadmill, or stands, and the direction is the one that the person faces."""
LEAST_SWING = 0.2
"""Least way of an ankle past the pelvis between two strikes, as a share of the leg's length."""
SHORTEST_STRIDE_S = 0.4
SHARE, ANKLE_SHARE = 0.3, 0.45
"""Share of the swing's peak speed at a strike and a toe-off; at a toe-off of a skeleton without toes."""
LEAST_PEAK = 0.5
"""m/s: least peak speed of a swing; the walking speed if that is larger."""
PEAK_DELAY_S, SLOW_DELAY_S, OFF_DELAY_S = 0.038, 0.043, -0.050
"""s from each sign to the event: the ankle in front, its speed falls; the toe's speed rises."""
SAME_S = 0.15
"""s: largest time between the two signs of one strike."""
SHORTEST_S = 0.6


@dataclass(frozen=True, eq=False)
class Walk:
    """A part of a motion without a gap, m samples at `RATE`, filtered; level frame as of `Poses`.

    seconds: (m,). ankles: (m, 3) m of each side. hips: (m, 3) m, their middle. travel: (m, 2) horizontal unit vectors
    x, z. strikes, offs: s, of each side, in order. apart: s, between the two signs of each strike.
    """

    seconds: np.ndarray
    ankles: dict[str, np.ndarray]
    hips: np.ndarray
    travel: np.ndarray
    strikes: dict[str, np.ndarray]
    offs: dict[str, np.ndarray]
    apart: dict[str, np.ndarray]

    def at(self, values: np.ndarray, seconds: float) -> np.ndarray:
        """Return a row of values (m, c) at a time, interpolated."""
        return np.array([np.interp(seconds, self.seconds, column) for column in values.T])


def walk_of(piece: Poses) -> Walk | None:
    """Return the events of a part without a gap; None if it is shorter than `SHORTEST_S`."""
    duration = float(piece.seconds[-1] - piece.seconds[0])
    if len(piece.seconds) < 4 or duration < SHORTEST_S:
        return None
    seconds = np.arange(piece.seconds[0], piece.seconds[-1], 1 / RATE)
    places = filtered(CubicSpline(piece.seconds, piece.positions)(seconds))
    moved = Poses(seconds, piece.names, places, np.zeros(len(seconds), dtype=bool))
    hips = moved.middle("hip")
    travel, speed = _travel(moved)
    strikes, offs, apart = {}, {}, {}
    for side in SIDES:
        ankle = moved.place(f"{side}_ankle")
        toe = moved.place(f"{side}_foot") if f"{side}_foot" in piece.names else None
        ahead = ((ankle - hips)[:, [0, 2]] * travel).sum(axis=1)
        pace = np.where(speed > TRAVELS, speed, _belt(ahead))
        swing = np.gradient(ahead) * RATE + pace
        lead = None if toe is None else np.gradient(((toe - hips)[:, [0, 2]] * travel).sum(axis=1)) * RATE + pace
        slow, off = _crossings(swing, lead, max(LEAST_PEAK, float(np.median(pace))))
        strikes[side], apart[side] = _strikes(ahead, slow, LEAST_SWING * _leg(moved, side))
        strikes[side], offs[side] = strikes[side] + seconds[0], off + seconds[0]
    return Walk(seconds, {side: moved.place(f"{side}_ankle") for side in SIDES}, hips, travel, strikes, offs, apart)


def filtered(values: np.ndarray) -> np.ndarray:
    """Return values (m, ...) at `RATE` without what is faster than `CUTOFF_HZ`, and without delay."""
    b, a = butter(2, CUTOFF_HZ / (RATE / 2))
    return np.asarray(filtfilt(b, a, values, axis=0, padlen=min(60, len(values) - 2)))


def _leg(poses: Poses, side: str) -> float:
    hip, knee, ankle = (poses.place(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
    return float(np.median(np.linalg.norm(ankle - knee, axis=1) + np.linalg.norm(knee - hip, axis=1)))


def _travel(poses: Poses) -> tuple[np.ndarray, np.ndarray]:
    """Return unit vectors (m, 2) of the way of the hips, or of the front of a person who stays, and the speed (m,)."""
    hips = poses.middle("hip")[:, [0, 2]]
    half, frames = round(RATE * FACING_S / 2), np.arange(len(hips))
    first, last = np.maximum(frames - half, 0), np.minimum(frames + half, len(hips) - 1)
    velocity = (hips[last] - hips[first]) * RATE / (last - first)[:, None]
    speed = np.linalg.norm(velocity, axis=1)
    left = sum(poses.place(f"left_{part}") - poses.place(f"right_{part}") for part in ("hip", "shoulder"))
    front = np.cross(left, [0.0, -1.0, 0.0])[:, [0, 2]]
    front = uniform_filter1d(front, min(2 * half, len(hips)), axis=0, mode="nearest")
    way = np.where((speed > TRAVELS)[:, None], velocity, front)
    return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9), speed


def _belt(ahead: np.ndarray) -> float:
    """Return the speed of a treadmill's belt, m/s: that of a foot that goes back. ahead: (m,) m before the pelvis."""
    back = -np.gradient(ahead) * RATE
    return float(np.median(back[back > 0])) if (back > 0).any() else 0.0


def _strikes(ahead: np.ndarray, slow: np.ndarray, swing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the strikes, s after the first sample, and the time between their two signs, s.

    ahead: (m,) m of the ankle before the pelvis. slow: s, where its speed falls. swing: m, least way between strikes.
    """
    peaks = find_peaks(ahead, prominence=swing, distance=int(SHORTEST_STRIDE_S * RATE))[0]
    front = np.array([_vertex(ahead, peak) for peak in peaks]) / RATE + PEAK_DELAY_S
    slow = slow + SLOW_DELAY_S
    if not len(front) or not len(slow):
        return front, np.full(len(front), np.inf)
    nearest = slow[np.abs(slow[None] - front[:, None]).argmin(axis=1)]
    apart = np.abs(nearest - front)
    return np.where(apart < SAME_S, 0.5 * (front + nearest), front), apart


def _crossings(swing: np.ndarray, toe: np.ndarray | None, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the ankle's speed falls after each swing, and the toe-offs, s after the first sample.

    swing, toe: (m,) m/s over the floor, of the ankle and of the toe, None without toes. least: m/s of a swing's peak.
    """
    slow, offs = [], []
    lead, share = (swing, ANKLE_SHARE) if toe is None else (toe, SHARE)
    for peak in find_peaks(swing, height=least, distance=int(SHORTEST_STRIDE_S * RATE), prominence=0.7 * least)[0]:
        falls = np.flatnonzero(swing[peak:] <= SHARE * swing[peak])
        if len(falls):
            slow.append(_crossing(swing, peak + falls[0] - 1, SHARE * swing[peak]))
        rises = np.flatnonzero(lead[: peak + 1] <= share * lead[peak])
        if len(rises) and lead[peak] > 0:
            offs.append(_crossing(lead, rises[-1], share * lead[peak]))
    return np.array(slow) / RATE, np.array(offs) / RATE + OFF_DELAY_S


def _crossing(values: np.ndarray, index: int, level: float) -> float:
    """Return the place between two samples where the values pass a level."""
    step = values[index + 1] - values[index]
    return index + float((level - values[index]) / step) if step else float(index)


def _vertex(values: np.ndarray, peak: int) -> float:
    """Return the place of a peak, by the parabola through three samples."""
    bend = values[peak - 1] - 2 * values[peak] + values[peak + 1]
    return peak + float(0.5 * (values[peak - 1] - values[peak + 1]) / bend) if bend else float(peak)
