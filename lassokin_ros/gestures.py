"""Gestures of a hand from its 21 points: fist, open palm, pointing, thumbs up, victory, or another one; and the floor
where it points.

    probabilities = gesture_probabilities(points, up)      # points (21, 3) in any frame and unit
    watch = GestureWatch()
    name, confidence = watch.update(stamp, probabilities)  # "pointing", 0.93; "other" until a gesture is held

Each finger is straight or bent, by the angles at its first two joints; the thumb is stretched out or not, by the
distance of its tip from the little finger's knuckle. The probability of a gesture is the product of those of its
fingers; what remains is "other". The points may also be those of another tracker.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from lassokin_ros.core.body.rotations import from_quaternion

GESTURES = ("other", "fist", "open_palm", "pointing", "thumbs_up", "victory")
"""Names; a gesture's number is its place."""
BENT, BENT_WIDTH = 105.0, 10.0
"""Degrees: bend of a finger (sum of its knuckle's and the next joint's) from which on it is bent, and width of the step
of the logistic function. A finger of a fist has 150 to 210."""
STRAIGHT, STRAIGHT_WIDTH = 80.0, 8.0
"""Degrees: bend up to which a finger is straight. Straight ones have 10 to 70."""
OPEN, OPEN_WIDTH, OPEN_THUMB = 43.0, 4.0, 100.0
"""Degrees: mean bend of the four fingers up to which a hand is open if the thumb is 1.3 palms away, and how much more
it may be per palm that the thumb is farther away. An open hand has 32 and 1.42, a relaxed one 55 and 1.23."""
THUMB_OUT, THUMB_WIDTH = 1.12, 0.06
"""Of the palm's length (wrist to middle knuckle): distance of the thumb's tip from the knuckle of the little finger
from which on the thumb is stretched out. A fist has 0.6 to 0.95, thumbs up 1.35 to 1.9."""
SPREAD, SPREAD_WIDTH = 3.0, 1.5
"""Degrees between index and middle finger from which on two straight fingers are a V."""
UP, UP_WIDTH = 0.5, 0.12
"""Cosine of the angle between a thumb and the vertical at which it points up, if the vertical is given."""
HELD_S, SURE = 0.3, 0.45
"""s over which probabilities are averaged, and the mean from which on a gesture is said."""
LONGEST_GAP_S = 0.5
"""s: after a longer time without a hand the average begins again."""
INDEX_TIP, FINGERS = 8, np.array([[5, 6, 7, 8], [9, 10, 11, 12], [13, 14, 15, 16], [17, 18, 19, 20]])
"""Point at the tip of the index finger, and those of the index, middle, ring and pinky finger."""


def finger_bends(points: np.ndarray) -> np.ndarray:
    """Return (..., 4) degrees, by which index, middle, ring and pinky finger are bent from the palm to their tip.

    points: (..., 21, 3). It is the sum of the angles at the knuckle and at the joint after it.
    """
    chain = np.concatenate([np.zeros((4, 1), dtype=int), FINGERS], axis=1)  # from the wrist
    bones = np.diff(points[..., chain, :], axis=-2)
    bones /= np.maximum(np.linalg.norm(bones, axis=-1, keepdims=True), 1e-12)
    cosines = (bones[..., :-1, :] * bones[..., 1:, :]).sum(axis=-1)
    angles: np.ndarray = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    return np.asarray(angles[..., :2].sum(axis=-1))


def gesture_probabilities(points: np.ndarray, up: np.ndarray | None = None) -> np.ndarray:
    """Return (..., 6), the probabilities of GESTURES, whose sum is 1.

    points: (..., 21, 3), in MediaPipe's order: wrist, then thumb, index, middle, ring and pinky finger from the root to
    the tip. up: (..., 3) unit vector, the vertical in the frame of the points; without it a thumb that is stretched out
    of a fist in any direction is "thumbs_up".
    """
    bends = finger_bends(points)
    bent, straight = _step(bends, BENT, BENT_WIDTH), _step(-bends, -STRAIGHT, STRAIGHT_WIDTH)
    palm = np.linalg.norm(points[..., 9, :] - points[..., 0, :], axis=-1)
    apart = np.linalg.norm(points[..., 4, :] - points[..., 17, :], axis=-1) / np.maximum(palm, 1e-12)
    out = _step(apart, THUMB_OUT, THUMB_WIDTH)
    is_open = _step(OPEN_THUMB * (apart - 1.3) - bends.mean(axis=-1), -OPEN, OPEN_WIDTH)
    index, middle = (points[..., finger[3], :] - points[..., finger[0], :] for finger in FINGERS[:2])
    spread = np.degrees(np.arccos(np.clip(_cosine(index, middle), -1.0, 1.0)))
    raised = 1.0 if up is None else _step(_cosine(points[..., 4, :] - points[..., 2, :], up), UP, UP_WIDTH)
    three, four = bent[..., 1:].prod(axis=-1), bent.prod(axis=-1)
    named = [
        four * (1 - out),
        is_open * out,
        straight[..., 0] * three,
        four * out * raised,
        straight[..., :2].prod(axis=-1) * bent[..., 2:].prod(axis=-1) * _step(spread, SPREAD, SPREAD_WIDTH),
    ]
    return np.stack([1 - sum(named), *named], axis=-1)


def points_up(points: np.ndarray, up: np.ndarray | None) -> bool:
    """Return whether the index finger (points (21, 3)) points up rather than aside or down; True without a vertical."""
    return up is None or bool(_cosine(points[INDEX_TIP] - points[FINGERS[0, 0]], up) > UP)


class GestureWatch:
    """Follows one hand, and says a gesture while it is held."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, np.ndarray]] = deque()

    def update(self, stamp: float, probabilities: np.ndarray) -> tuple[str, float]:
        """Return the gesture and its confidence, the mean probability of the last HELD_S.

        stamp: s. probabilities: (6,) of `gesture_probabilities`. It is "other" before a hand was seen for HELD_S / 2,
        and while no gesture's mean reaches SURE; the confidence is then that of "other".
        """
        if self._seen and not 0 < stamp - self._seen[-1][0] <= LONGEST_GAP_S:
            self._seen.clear()
        self._seen.append((stamp, probabilities))
        while stamp - self._seen[0][0] > HELD_S:
            self._seen.popleft()
        mean = np.mean([one for _, one in self._seen], axis=0)
        best = int(mean[1:].argmax()) + 1
        if mean[best] < SURE or stamp - self._seen[0][0] < HELD_S / 2:
            return GESTURES[0], float(1 - mean[1:].max())
        return GESTURES[best], float(mean[best])


def hand_points(hand: Any) -> np.ndarray:
    """Return the 21 points of a hand of ~/hands, (21, 3) m in the frame of the message. hand: its (21,) points."""
    along = np.stack([hand[axis] for axis in "xyz"], axis=1).astype(float)
    first = hand[0]
    turn = from_quaternion(np.array([first[name] for name in ("qx", "qy", "qz", "qw")], dtype=float))
    return along @ turn.T + [float(first[f"wrist_{axis}"]) for axis in "xyz"]


def on_floor(hand: Any, floor: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return where on the floor a hand of ~/hands points, (2,) m, and its covariance (2, 2) m^2.

    hand: its (21,) points, of a message whose frame has z up; floor: m, its z. The deviation of the ray's angle grows
    with the distance, and along a flat ray. A ray that does not meet the floor has NaN.
    """
    tip, first = hand_points(hand)[INDEX_TIP], hand[0]
    ray = np.array([first[f"ray_{axis}"] for axis in "xyz"], dtype=float)
    if ray[2] >= 0 or tip[2] <= floor:
        return np.full(2, np.nan), np.full((2, 2), np.nan)
    length = (floor - tip[2]) / ray[2]
    across = length * float(first["ray_deviation"])
    flat = ray[:2] / max(float(np.linalg.norm(ray[:2])), 1e-9)
    covariance = across**2 * (np.eye(2) + (1 / ray[2] ** 2 - 1) * np.outer(flat, flat))
    return tip[:2] + length * ray[:2], covariance


def _step(values: np.ndarray, middle: float, width: float) -> np.ndarray:
    """Return the logistic function of values (...), 0.5 at `middle`."""
    return np.asarray(0.5 * (1 + np.tanh((values - middle) / (2 * width))))


def _cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    norms = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    return np.asarray((a * b).sum(axis=-1) / np.maximum(norms, 1e-12))
