"""Detect left/right swaps of keypoints: of one pair, of a pair of limbs, or of the whole body.

In a swapped pair, each point is far from its own track and near the track of the other side. A pair whose points are
close together in the image fits both ways; it follows the other pairs of its limbs or of the body, because a detector
rarely swaps one pair alone. A swap that lasts is accepted in the end, sooner if the tracks are short, because they may
have started with swapped sides. If the pair is exchanged once more before the accepted sides have been there for longer
than the former ones, the detector has returned, and this is accepted at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.body.proportions import partners
from lassokin_ros.core.observation import STAMP_TOLERANCE

SWAP_GAIN = 40.0
"""A pair is swapped if its squared distances from the tracks, over the variances, are less by this after exchanging."""
MAX_FIT = 15.0
"""Largest squared distance over variance of a swapped point from the other side's track, of a lone one from its own."""
IN_PLACE_GAIN = 10.0
"""A pair is in place if its squared distances are less by this as given than after exchanging the points."""
MAX_DURATION = 2.0
"""s: longest time for which the points of a pair are swapped back."""
MAX_SHARE = 0.25
"""Longest swap, as a share of the tracks' age when the swap ends. 0.25 is one third of the time before the swap."""


class SideSwaps:
    """State of the swaps of l landmarks: which ones are swapped, and for how long."""

    def __init__(self, names: Sequence[str], limbs: Sequence[int]) -> None:
        """names: landmark names; names that differ only in left/right are a pair. limbs: see `limb_groups`."""
        self._own = np.arange(len(names))
        #: (l,) index of the landmark on the other side; the landmark itself if there is none.
        self.other = partners(names)
        self._paired = paired = self.other != self._own
        limb_of = np.asarray(limbs)
        limb_of = np.where(limb_of == limb_of[self.other], limb_of, -1)  # both landmarks of a pair in one group
        #: (g, l): 1 where a landmark is in a pair of group g: 0 the whole body, then both arms, both legs, …
        self._groups = np.array([paired, *(paired & (limb_of == limb) for limb in np.unique(limb_of))], dtype=float)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks and swaps."""
        #: (l,) s each: start of the track; time for which its point has been swapped back.
        self._begun, self._spent = np.zeros(len(self._own)), np.zeros(len(self._own))
        #: (l,) s: age of the track before a swap that lasted too long, 0 without one.
        self._before = np.zeros(len(self._own))
        self.pending = False
        """Whether a pair was swapped and has not been seen in place since."""

    def start_tracks(self, which: np.ndarray, stamp: float) -> None:
        """Note that the tracks `which` (l,) bool have started at a stamp, possibly from the other side's points."""
        self._begun[which] = stamp
        self._spent[which] = 0.0

    def assign(
        self, stamp: float, step: float, straight: np.ndarray, crossed: np.ndarray, variance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (l,) the landmark whose point each one must use, and (l,) bool the tracks that must be restarted from
        the points as given, because a swap has lasted too long.

        step: s since the last frame. straight, crossed: (l,) squared distance over variance of each track from its own
        and from the other side's point, nan if the track or the point is missing. variance: (l,) > 0, of the tracks.
        """
        other, groups = self.other, self._groups
        self._spent = np.maximum(self._spent, self._spent[other])  # one track of a pair may have restarted
        swapped, in_place = self._evidence(straight, crossed, variance)
        age = stamp - np.maximum(self._begun, self._begun[other])
        lasted = np.max(age, where=swapped, initial=0.0)
        returned = swapped & (age < self._before - STAMP_TOLERANCE)
        held = swapped & ~returned & (self._spent < min(MAX_DURATION, MAX_SHARE * lasted) - STAMP_TOLERANCE)
        given_up = swapped & ~held
        self._before = np.where(returned, 0.0, np.where(given_up, age - self._spent, self._before))
        # Pairs without evidence follow the majority of their limbs, or of the body.
        votes = groups @ held
        led = groups[(votes > 0) & (votes >= groups @ in_place)].any(axis=0)
        changed = np.where(swapped, held, led & ~in_place)
        self._spent = np.maximum(self._spent + np.where(changed, step, -step), 0.0)
        self._spent[in_place | given_up] = 0.0
        if np.count_nonzero(given_up):  # the sides of the pairs that followed are uncertain too
            self._begun[self._paired & ~in_place] = stamp
        self.pending = bool(np.count_nonzero(self._spent))
        return np.where(changed, other, self._own), given_up

    def _evidence(
        self, straight: np.ndarray, crossed: np.ndarray, variance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(l,) bool each: whose pair is swapped, and whose pair is in place. Both are false without evidence."""
        other = self.other
        gain = straight - crossed
        gain += gain[other]
        fits = np.fmax(crossed, crossed[other]) < MAX_FIT
        # If only one point of a pair is seen, it is in place unless the other side's track explains it as well. The
        # Gaussian likelihoods are compared with their normalisation: a track long unseen has a large variance.
        elsewhere = np.fmin(crossed, crossed[other] + 2 * np.log(variance[other] / variance))
        alone = np.isnan(gain) & (straight < MAX_FIT) & ~(elsewhere - straight <= IN_PLACE_GAIN)
        in_place = (gain < -IN_PLACE_GAIN) | alone | alone[other]
        return self._paired & (gain > SWAP_GAIN) & fits, self._paired & in_place
