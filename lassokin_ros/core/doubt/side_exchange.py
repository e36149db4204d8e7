"""Event: the detector exchanges left and right from one frame to the next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.doubt.keypoint_motion import PAIRS, KeypointMotion

LIMBS = {"body": PAIRS, "legs": PAIRS[3:], "arms": PAIRS[:3]}
RATIO = {"body": 1.6, "legs": 1.5, "arms": 3.5}
"""Ratio of the pairs' straight displacement to the crossed one from which they are exchanged. On 28 recordings and 550
clips of motion capture at 30, 15 and 10 Hz no exchange was reported; 23 of 24 of the body and 20 of 24 of the legs
were found. Arms cross in ordinary motion, so theirs is higher."""
LEAST_MOTION = 0.12
"""Trunk lengths: a smaller straight displacement is the noise of pairs that lie on each other."""


class SideExchange:
    """Reports exchanges of the sides."""

    def __init__(self, names: Sequence[str]) -> None:
        """names: l landmarks in layout order."""
        place = {name: i for i, name in enumerate(names)}
        self._groups = {
            limb: np.array(
                [[place[f"{side}_{pair}"] for side in ("left", "right")] for pair in pairs if f"left_{pair}" in place]
            )
            for limb, pairs in LIMBS.items()
        }

    def update(self, motion: KeypointMotion | None) -> str:
        """Return what was exchanged with this frame: body, legs, arms, or an empty text."""
        if motion is None:
            return ""
        return next((limb for limb, pairs in self._groups.items() if _exchanged(motion, limb, pairs)), "")


def _exchanged(motion: KeypointMotion, limb: str, pairs: np.ndarray) -> bool:
    if len(pairs) < 2:
        return False
    straight, crossed = motion.straight[pairs].mean(axis=1), motion.crossed[pairs].mean(axis=1)
    seen = np.isfinite(straight) & np.isfinite(crossed)
    if np.count_nonzero(seen) < max(2, len(pairs) / 2):
        return False
    own, other = float(straight[seen].mean()), float(crossed[seen].mean())
    return own > LEAST_MOTION and own > RATIO[limb] * other
