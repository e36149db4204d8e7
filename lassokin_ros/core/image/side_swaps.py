"""Keypoints that a detector has taken for each other, left for right: one pair, a pair of limbs, or the whole body.

Of such a pair each point is far from its own track and near the other's. Pairs that stand side by side in the image
fit both ways; they go with the others of their limbs, or of the body, since a detector rarely changes one alone. A
swap that lasts becomes the truth in the end, and the sooner the shorter the tracks have lasted: it may have been their
beginning that was wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.body.symmetry import other_side

SWAPPED = 40.0
"""A pair is swapped whose squared distances from the tracks, over their variances, sum to so much less crosswise."""
FITTING = 15.0
"""Both its points must fit the other's track so well: where hands meet, points jump, and fit neither. A point that is
seen without its partner fits its own so well, or says nothing."""
STRAIGHT = 10.0
"""A pair is in its place whose squared distances are so much less as given than crosswise."""
LONGEST = 2.0
"""s for which a pair's points are changed back at most."""
SHARE = 0.25
"""A pair's points are changed back for at most this share of the time that the tracks have lasted by then: for a third
of the time before."""


class SideSwaps:
    """The swaps of l landmarks: which of them stand in the other one's place, and for how long they have."""

    def __init__(self, names: Sequence[str], limbs: Sequence[int]) -> None:
        """names: of the landmarks, those that differ in left and right alone are pairs; limbs: see `limb_groups`."""
        place = {name: index for index, name in enumerate(names)}
        self._own = np.arange(len(names))
        #: (l,) of each landmark the one on the other side; itself where there is none.
        self.other = np.array([place.get(other_side(name), index) for index, name in enumerate(names)], dtype=int)
        self._paired = paired = self.other != self._own
        limb_of = np.asarray(limbs)
        limb_of = np.where(limb_of == limb_of[self.other], limb_of, -1)  # a pair goes together
        #: (g, l): 1 where a landmark is one of a pair: of the whole body, the first; of both arms; of both legs; …
        self._groups = np.array([paired, *(paired & (limb_of == limb) for limb in np.unique(limb_of))], dtype=float)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks and swaps."""
        #: (l,) s: when each track began; for how long it has been changed back.
        self._begun, self._spent = np.zeros(len(self._own)), np.zeros(len(self._own))
        self.pending = False
        """Whether some pair was swapped and has not been seen to be straight again."""

    def begin(self, which: np.ndarray, stamp: float) -> None:
        """Tracks, which (l,) bool, have begun at a stamp, from whichever side's points."""
        self._begun[which] = stamp
        self._spent[which] = 0.0

    def order(
        self, stamp: float, step: float, straight: np.ndarray, crossed: np.ndarray, variance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(l,) the landmark whose point each is to have, its own or the other side's; (l,) bool what is given up.

        Of pairs that are given up the swap has lasted too long: the caller is to begin their tracks anew from what is
        given.

        step: s since the last frame; straight, crossed: (l,) squared distance over variance of its own and the other
        side's point from each track, nan where the track or the point is missing; variance: (l,) > 0, the tracks'.
        """
        other, groups = self.other, self._groups
        self._spent = np.maximum(self._spent, self._spent[other])  # one of a pair may have begun anew
        swapped, in_place = self._evidence(straight, crossed, variance)
        lasted = np.max(stamp - np.maximum(self._begun, self._begun[other]), where=swapped, initial=0.0)
        held = swapped & (self._spent < min(LONGEST, SHARE * lasted))
        given_up = swapped & ~held
        # Pairs that show nothing go with the most of their limbs, or of the body.
        votes = groups @ held
        led = groups[(votes > 0) & (votes >= groups @ in_place)].any(axis=0)
        changed = np.where(swapped, held, led & ~in_place)
        self._spent = np.maximum(self._spent + np.where(changed, step, -step), 0.0)
        self._spent[in_place | given_up] = 0.0
        if np.count_nonzero(given_up):  # what was led by them is no surer of its side than they were
            self._begun[self._paired & ~in_place] = stamp
        self.pending = bool(np.count_nonzero(self._spent))
        return np.where(changed, other, self._own), given_up

    def _evidence(
        self, straight: np.ndarray, crossed: np.ndarray, variance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(l,) bool: which pairs' points are swapped, which are in their places; neither where nothing tells."""
        other = self.other
        gain = straight - crossed
        gain += gain[other]
        fits = np.fmax(crossed, crossed[other]) < FITTING
        # A point of a pair that is not seen whole is in its place unless it is as likely in the other, by Gaussians:
        # near a track of nearly any place, such as one long unseen, little is likely.
        elsewhere = np.fmin(crossed, crossed[other] + 2 * np.log(variance[other] / variance))
        alone = np.isnan(gain) & (straight < FITTING) & ~(elsewhere - straight <= STRAIGHT)
        in_place = (gain < -STRAIGHT) | alone | alone[other]
        return self._paired & (gain > SWAPPED) & fits, self._paired & in_place
