"""Event: the pelvis jumps in depth."""

from __future__ import annotations

from lassokin_ros.doubt.recent import Recent

JUMP, JUMP_S = 0.25, 0.1
"""A change of the depth by more than a quarter within 0.1 s. No good recording has it, and 15 of 16 changes of person
do. Below 10 Hz no jump is reported."""


class PelvisJump:
    """Reports jumps of the pelvis along the line of sight."""

    def __init__(self) -> None:
        self._recent: Recent[float] = Recent(JUMP_S)

    def reset(self) -> None:
        """Forget the earlier frames."""
        self._recent.clear()

    def update(self, stamp: float, depth: float) -> float | None:
        """Return the depth before a jump that ends in this frame, None without one. stamp: s. depth: m, above 0."""
        self._recent.forget_before(stamp)
        before = next((old for old in self._recent.values if abs(depth / old - 1) > JUMP), None)
        if before is not None:
            self._recent.clear()  # the jump is reported once
        self._recent.add(stamp, depth)
        return before
