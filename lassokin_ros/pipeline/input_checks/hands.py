"""The points of the hands against those of the body: exchanged sides, the same hand twice, hands of somebody else.

Detectors find hands by themselves, or in a part of the image around a wrist. Their sides are those that the hands'
look suggests. The wrists of the body tell better whose hand it is. An order of the points that begins with the index
finger is recognised by the first point after the wrist: the root of the thumb is nearer to the wrist than the knuckles.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lassokin_ros.core.body.roles import SIDES
from lassokin_ros.pipeline.seen import Seen

EXCHANGED, SAME, FAR, ORDER = "hands exchanged", "hands alike", "hands far from the body", "hands in another order"
"""Keys of the counts of messages with hands that were put on the other side, or left out because both had the same
points, were far from the body's wrist, or had the thumb in another place."""
FARTHEST = 0.12
"""Of the height: a hand whose wrist is farther from that of the body is not this person's."""
GAIN = 0.06
"""Of the height: two hands are exchanged if the sum of both distances becomes smaller by more."""
ALIKE = 0.15
"""Of the hand's extent: two hands whose points are nearer to each other, in the median, are one hand found twice."""
FEWEST_POINTS = 5
"""Points of a hand without which nothing is concluded."""
LIMBS = {
    ("shoulder", "elbow"): 0.167,
    ("elbow", "wrist"): 0.151,
    ("shoulder", "hip"): 0.300,
    ("hip", "knee"): 0.242,
    ("knee", "ankle"): 0.233,
}
"""Lengths of the anthropometric skeleton, in heights. They give the size of the body in the image."""
IN_ORDER, THUMB_LAST = np.arange(21), np.array([0, *range(17, 21), *range(1, 17)])
"""The place of each point among those of a hand: as it should be, and if the thumb comes after the little finger."""
WRIST, THUMB, PINKY, LAST = 0, 1, 17, 21
"""Places in a hand's points: the wrist, the roots of the first and of the last finger, and their number."""
USUAL_RATIO = -0.3
"""Logarithm of the distance of the last finger's root from the wrist over that of the thumb's. It is 0.8 for a hand in
the image plane, and -0.8 if the thumb comes last."""
FIRST_RATIO, FIRST_WEIGHT, REMEMBERED = 0.6, 1, 30
"""Its average before any hand was seen, the weight of that in hands, and the number of hands over which it is averaged:
single hands of the usual order can have any ratio."""


class HandCheck:
    """Assigns the hands of each person to the wrists of the body. Without a layout of hands it changes nothing."""

    def __init__(self, names: Sequence[str], counts: Counter[str]) -> None:
        """names: of the landmarks. counts: of all messages, see `Session.counts`."""
        places = {name: place for place, name in enumerate(names)}
        first = [places.get(f"{side}_hand_wrist") for side in SIDES]
        #: (21,) landmarks of each hand of the layout; None without it.
        self._hands = [None if at is None else np.arange(at, at + LAST) for at in first]
        self._wrists = [places.get(f"{side}_wrist") for side in SIDES]
        self._limbs = [
            (places[f"{side}_{a}"], places[f"{side}_{b}"], length)
            for side in SIDES
            for (a, b), length in LIMBS.items()
            if f"{side}_{a}" in places and f"{side}_{b}" in places
        ]
        self._counts = counts
        self._ratio, self._seen = FIRST_RATIO, FIRST_WEIGHT
        self.active = any(hand is not None for hand in self._hands)
        """Whether the layout has hands."""

    def checked(self, people: Sequence[Seen]) -> list[Seen]:
        """Return the people of an image with their hands on the right sides, and without those of others."""
        if not self.active:
            return list(people)
        found: set[str] = set()
        result = [self._of_person(one, found) for one in people]
        self._counts.update(found)
        return result

    def _of_person(self, seen: Seen, found: set[str]) -> Seen:
        points = np.where(seen.confidence[:, None] > 0, seen.points, np.nan)
        hands: list[np.ndarray | None] = [None, None]
        for side, rows in enumerate(self._hands):
            if rows is not None:
                there = np.asarray(np.isfinite(points[rows]).all(axis=1))
                if there[WRIST] and np.count_nonzero(there) >= FEWEST_POINTS:
                    hands[side] = points[rows]
        if all(hand is None for hand in hands):
            return seen
        given = [side if hands[side] is not None else None for side in (0, 1)]
        taken = self._assigned(hands, self._distances(points, hands), found)
        orders: list[np.ndarray | None] = [IN_ORDER, IN_ORDER]
        if self._is_other_order([hand for hand in hands if hand is not None]):
            found.add(ORDER)
            for side, hand in enumerate(hands):  # the knuckles are in order if the thumb comes last
                fits = hand is not None and (np.diff(np.linalg.norm(hand[[5, 9, 13]] - hand[1], axis=1)) > 0).all()
                orders[side] = THUMB_LAST if fits else None
        elif taken == given:
            return seen
        return self._moved(seen, taken, orders)

    def _is_other_order(self, hands: Sequence[np.ndarray]) -> bool:
        """Return True if the thumb is not the first finger: by all hands so far, or by both of this image."""
        known = []
        for hand in hands:
            thumb, last = np.linalg.norm(hand[[THUMB, PINKY]] - hand[WRIST], axis=1).tolist()
            if thumb > 0 and last > 0:  # False for NaN
                known.append(min(max(math.log(last / thumb), -1.0), 1.0))
                self._seen = min(self._seen + 1, REMEMBERED)
                self._ratio += (known[-1] - self._ratio) / self._seen
        return self._ratio < USUAL_RATIO or len(known) == len(SIDES) and max(known) < USUAL_RATIO

    def _distances(self, points: np.ndarray, hands: Sequence[np.ndarray | None]) -> np.ndarray:
        """Return (2, 2), in heights: [i, j] from the wrist of hand i to the body's wrist j; NaN if it is not known."""
        apart = np.full((2, 2), np.nan)
        sizes = [float(np.linalg.norm(points[a] - points[b])) / length for a, b, length in self._limbs]
        size = max((size for size in sizes if size > 0), default=0.0)
        for i, hand in enumerate(hands):
            for j, wrist in enumerate(self._wrists):
                if hand is not None and wrist is not None and size > 0:
                    apart[i, j] = np.linalg.norm(hand[WRIST] - points[wrist]) / size
        return apart

    def _assigned(self, hands: Sequence[np.ndarray | None], apart: np.ndarray, found: set[str]) -> list[int | None]:
        """Return for each side the hand whose points it takes, None for none."""
        taken: list[int | None] = [None if hand is None else side for side, hand in enumerate(hands)]
        if taken == [0, 1] and _are_alike(hands):
            found.add(SAME)
            kept = int(apart[1, 1] < apart[0, 0] or np.isnan(apart[0, 0]))
            taken = [kept if side == kept else None for side in (0, 1)]
        if taken == [0, 1]:
            crossed, straight = apart[0, 1] + apart[1, 0], apart[0, 0] + apart[1, 1]
            if straight - crossed > GAIN and max(apart[0, 1], apart[1, 0]) < FARTHEST:
                found.add(EXCHANGED)
                return [1, 0]
        for side in (0, 1):
            other = 1 - side
            if taken[side] == side and apart[side, side] > FARTHEST:
                taken[side] = None
                if taken[other] is None and apart[side, other] < FARTHEST and self._hands[other] is not None:
                    found.add(EXCHANGED)
                    taken[other] = side
                else:
                    found.add(FAR)
        return taken

    def _moved(self, seen: Seen, taken: Sequence[int | None], orders: Sequence[np.ndarray | None]) -> Seen:
        """Return a person whose hand of each side has the points of the hand `taken`, or none, in their orders."""
        rows, missing = np.arange(len(seen.points)), np.zeros(len(seen.points), dtype=bool)
        for own, hand in zip(self._hands, taken):
            if own is None:
                continue
            source, order = (None, None) if hand is None else (self._hands[hand], orders[hand])
            if source is None or order is None:
                missing[own] = True
            else:
                rows[own] = source[order]
        arrays: dict[str, Any] = {
            name: np.where(missing if array.ndim == 1 else missing[:, None], np.nan, array[rows])
            for name in ("points", "pixels", "depth", "sampled")
            if (array := getattr(seen, name)) is not None
        }
        return replace(seen, confidence=np.where(missing, 0.0, seen.confidence[rows]), **arrays)


def _are_alike(hands: Sequence[np.ndarray | None]) -> bool:
    """Return True if two hands (21, 2) are one that was found twice."""
    first, second = hands
    assert first is not None and second is not None
    both = np.isfinite(first + second).all(axis=1)
    if np.count_nonzero(both) < FEWEST_POINTS:
        return False
    extent = float(np.linalg.norm(np.ptp(first[both], axis=0)))
    return bool(np.median(np.linalg.norm(first[both] - second[both], axis=1)) < ALIKE * extent)
