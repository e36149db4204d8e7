"""Limbs that no keypoint shows: the pose prior alone places them, so they count in a verdict about the pose.

No figure of the tracker finds them: for people at a desk, whose hidden legs are off by half a metre, the probability of
a wrong pose is 1 to 2 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter

import numpy as np

from lassokin_ros.core.body.roles import LIMBS as CHAINS

UNSEEN_S = 0.5
"""s without an observed joint of a limb after which it is reported."""
LIMBS = {
    f"{side} {limb}": next(chain[1:] for chain in CHAINS if chain[0] == f"{side}_{root}")
    for limb, root in (("arm", "shoulder"), ("leg", "hip"))
    for side in ("left", "right")
}
"""The joints of each limb beyond the trunk, by its name in words."""


class UnseenLimbs:
    """Follows which limbs are seen."""

    def __init__(self, joints: Sequence[str]) -> None:
        """joints: n names in the skeleton's order."""
        #: For each limb a function that picks its joints from a list of all.
        self._limbs = {
            limb: itemgetter(*(list(joints).index(joint) for joint in chain))
            for limb, chain in LIMBS.items()
            if set(chain) <= set(joints)
        }
        self.reset()

    def reset(self) -> None:
        """Forget the earlier frames."""
        self._seen_at: dict[str, float] = {}

    def update(self, stamp: float, observed: np.ndarray | None) -> tuple[str, ...]:
        """Return the limbs of which no joint has been observed for `UNSEEN_S`.

        stamp: s. observed: (n,) bool, None if it is unknown.
        """
        if observed is None:
            return ()
        seen = observed.tolist()
        unseen = []
        for limb, joints_of in self._limbs.items():
            if any(joints_of(seen)) or limb not in self._seen_at:
                self._seen_at[limb] = stamp
            elif stamp - self._seen_at[limb] >= UNSEEN_S:
                unseen.append(limb)
        return tuple(unseen)
