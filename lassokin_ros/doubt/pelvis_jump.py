"""Event: the pelvis jumps along the line of sight."""

from __future__ import annotations

JUMP, JUMP_S = 0.25, 0.1
"""A change of the distance from the camera by more than a quarter within 0.1 s. No good recording has it, and 15 of 16
changes of person do. Below 10 Hz no jump is reported."""


def is_jump(before: float, distance: float) -> bool:
    """Return whether the distance, m, above 0, is that of a pelvis that has jumped."""
    return abs(distance / before - 1) > JUMP
