"""Events: the pose explains the frame badly."""

from __future__ import annotations

from lassokin_ros.doubt.recent import Recent

COST = 10.0
"""Cost per measurement above which a pose explains nothing. The largest of good recordings is 6.6."""
PRIOR_COST = 120.0
"""Cost of the pose prior above which a posture is none of a person. The largest of good recordings is 108."""
REPROJECTION, RUN_S = 0.05, 0.1
"""Reprojection error as a share of the person's height in the image, and s for which it must stay above. It occurred in
no good recording, and in 24 of 24 exchanges of the sides."""


def is_costly(cost_per_measurement: float, prior_cost: float) -> bool:
    """Return whether a cost is above that of any good frame. NaN is not."""
    return cost_per_measurement > COST or prior_cost > PRIOR_COST


class ReprojectionRun:
    """Reports reprojection errors that stay large."""

    def __init__(self) -> None:
        self._recent: Recent[float] = Recent(RUN_S)

    def reset(self) -> None:
        """Forget the earlier frames."""
        self._recent.clear()

    def update(self, stamp: float, share: float) -> bool:
        """Return whether the error has been large for `RUN_S`. stamp: s. share: of the person's height in the image."""
        if not share > REPROJECTION:
            self._recent.clear()
            return False
        self._recent.add(stamp, share)
        return self._recent.span > 0.8 * RUN_S
