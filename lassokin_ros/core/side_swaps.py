"""Keypoints that a detector has taken for each other, left for right: one pair, a pair of limbs, or the whole body.

Of such a pair each point is far from its own track and near the other's. Pairs that stand side by side in the image
fit both ways; they go with the others of their limbs, or of the body, since a detector rarely changes one alone. A
swap that lasts becomes the truth in the end, and the sooner the shorter the tracks have lasted: it may have been their
beginning that was wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.symmetry import other_side

SWAPPED = 40.0
"""A pair is swapped whose squared distances from the tracks, over their variances, sum to so much less crosswise."""
FITTING = 15.0
"""Both its points must fit the other's track so well: where hands meet, points jump, and fit neither."""
STRAIGHT = 10.0
"""It is not where they sum to so much less as given."""
LONGEST = 2.0
"""s for which a pair's points are changed back at most."""
SHARE = 0.25
"""They are for at most this share of the time that the tracks have lasted."""


class SideSwaps:
    """The swaps of l landmarks: which of them stand in the other one's place, and for how long they have."""

    def __init__(self, names: Sequence[str], limbs: Sequence[int]) -> None:
        """names: of the landmarks, those that differ in left and right alone are pairs; limbs: see `limb_pairs`."""
        place = {name: index for index, name in enumerate(names)}
        self._own = np.arange(len(names))
        #: (l,) of each landmark the one on the other side; itself where there is none.
        self.other = np.array([place.get(other_side(name), index) for index, name in enumerate(names)], dtype=int)
        self._paired = paired = self.other != self._own
        #: (g, l): 1 where a landmark is one of a pair of the whole body, the first, or of a pair of limbs.
        self._groups = np.array([paired, *(paired & (limbs == limb) for limb in np.unique(limbs))], dtype=float)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks and swaps."""
        #: (l,) s: when each track began; for how long it has been changed back.
        self._begun, self._spent = np.zeros(len(self._own)), np.zeros(len(self._own))
        self.pending = False
        """Whether some pair was swapped and has not been seen to be straight again."""

    def begin(self, which: np.ndarray, stamp: float) -> None:
        """Tracks, which (l,) bool, that begin at a stamp: which side they are of is known from there on."""
        self._begun[which] = stamp

    def order(
        self, stamp: float, step: float, straight: np.ndarray, crossed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(l,) the landmark whose point each is to have, its own or the other side's; (l,) bool what is given up.

        Of pairs that are given up the swap has lasted too long: their tracks are to begin anew from what is given.

        step: s since the last frame; straight, crossed: (l,) squared distance over variance of its own and the other
        side's point from each track, crossed nan where either is missing.
        """
        other, groups, limbs = self.other, self._groups, self._groups[1:]
        gain = np.nan_to_num(straight - crossed)
        gain += gain[other]
        odd = self._paired & (gain > SWAPPED) & (np.fmax(crossed, crossed[other]) < FITTING)
        evident = self._paired & (gain < -STRAIGHT)
        lasted = np.max(stamp - np.maximum(self._begun, self._begun[other]), where=odd, initial=0.0)
        held = odd & (self._spent < min(LONGEST, SHARE * lasted))
        votes = groups @ held
        follow = groups[(votes > 0) & (votes >= groups @ evident)].any(axis=0)
        swapped = np.where(odd, held, follow & ~evident)
        given_up = odd & ~held
        straightened = evident | limbs[limbs @ evident > limbs @ odd].any(axis=0)
        self._spent[swapped] += step
        self._spent[straightened | given_up] = 0.0
        self._begun[limbs[limbs @ given_up > 0].any(axis=0) & ~evident] = stamp
        self.pending = bool(np.count_nonzero(self._spent))
        return np.where(swapped, other, self._own), given_up
