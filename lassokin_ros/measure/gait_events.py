"""Foot strikes and toe-offs of a walk.

A strike is the mean of two signs. The ankle is farthest in front of the pelvis (J. Zeni, J. Richards, J. Higginson,
Two simple methods for determining gait events during treadmill and overground walking using kinematic data, Gait &
Posture 27, 2008), and the ankle's speed over the floor falls below a share of its peak in the swing. A toe leaves the
floor where its speed rises above that share. An error of the pelvis' place shifts all strikes of a walk. The times at
which the ankles are farthest apart are free of it, and move all strikes, but say little of a difference of the sides.
The delays of all signs were fitted to captured foot contacts.
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
PEAK_DELAY_S, SLOW_DELAY_S, APART_DELAY_S, OFF_DELAY_S = 0.038, 0.043, -0.033, -0.050
"""s from each sign to the event: the ankle in front, its speed falls, the ankles apart; the toe's speed rises."""
SAME_S = 0.15
"""s: largest time between two signs of one strike."""
SHIFT = 0.33
"""Share of the median difference to the times of the ankles apart by which all strikes are moved."""
SHORTEST_S = 0.6


@dataclass(frozen=True, eq=False)
class Walk:
    """A part of a motion without a gap, m samples at `RATE`, filtered; level frame as of `Poses`.

    seconds: (m,). ankles: (m, 3) m of each side. hips: (m, 3) m, their middle. travel: (m, 2) horizontal unit vectors
    x, z. strikes, offs: s, of each side, in order.
    """

    seconds: np.ndarray
    ankles: dict[str, np.ndarray]
    hips: np.ndarray
    travel: np.ndarray
    strikes: dict[str, np.ndarray]
    offs: dict[str, np.ndarray]

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
    ankles = {side: moved.place(f"{side}_ankle") for side in SIDES}
    ahead = {side: ((ankle - hips)[:, [0, 2]] * travel).sum(axis=1) for side, ankle in ankles.items()}
    strikes, offs, moved_by = {}, {}, list[float]()
    for side, other in zip(SIDES, SIDES[::-1]):
        toe = moved.place(f"{side}_foot") if f"{side}_foot" in piece.names else None
        pace = np.where(speed > TRAVELS, speed, _belt(ahead[side]))
        swing = np.gradient(ahead[side]) * RATE + pace
        lead = None if toe is None else np.gradient(((toe - hips)[:, [0, 2]] * travel).sum(axis=1)) * RATE + pace
        slow, off = _crossings(swing, lead, max(LEAST_PEAK, float(np.median(pace))))
        least = LEAST_SWING * _leg(moved, side)
        strikes[side] = _mean_of(_peaks(ahead[side], least) + PEAK_DELAY_S, slow + SLOW_DELAY_S)
        if all(piece.shown(side).all() for side in SIDES):
            apart = _peaks(ahead[side] - ahead[other], least) + APART_DELAY_S
            moved_by += list(_mean_of(strikes[side], apart) - strikes[side])
        offs[side] = off + seconds[0]
    shift = seconds[0] + 2 * SHIFT * float(np.median(moved_by)) if moved_by else seconds[0]
    return Walk(seconds, ankles, hips, travel, {side: at + shift for side, at in strikes.items()}, offs)


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


def _peaks(ahead: np.ndarray, swing: float) -> np.ndarray:
    """Return where an ankle is farthest in front, s after the first sample. swing: m, least way between two peaks.

    ahead: (m,) m of the ankle before the pelvis, or before the other ankle.
    """
    peaks = find_peaks(ahead, prominence=swing, distance=int(SHORTEST_STRIDE_S * RATE))[0]
    return np.array([_vertex(ahead, peak) for peak in peaks]) / RATE


def _mean_of(front: np.ndarray, sign: np.ndarray) -> np.ndarray:
    """Return the strikes (k,) s, each the mean with the nearest time of another sign, if that is near."""
    if not len(front) or not len(sign):
        return front
    nearest = sign[np.abs(sign[None] - front[:, None]).argmin(axis=1)]
    return np.where(np.abs(nearest - front) < SAME_S, 0.5 * (front + nearest), front)


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
