"""The values of the last moments."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

Value = TypeVar("Value")
ROUNDING_S = 1e-6
"""s: stamps are rounded, so a window of 0.1 s holds the frame of exactly 0.1 s ago."""


class Recent(Generic[Value]):
    """Values with their stamps, of the last `seconds`."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds + ROUNDING_S
        self._values: deque[tuple[float, Value]] = deque()

    def add(self, stamp: float, value: Value) -> None:
        """Add a value and drop those that are too old. stamp: s. A stamp that goes back drops all others."""
        values = self._values
        if values and stamp < values[-1][0]:
            values.clear()
        values.append((stamp, value))
        while stamp - values[0][0] > self._seconds:
            values.popleft()

    def clear(self) -> None:
        """Drop all values."""
        self._values.clear()

    @property
    def values(self) -> list[Value]:
        """The values, oldest first."""
        return [value for _, value in self._values]

    @property
    def span(self) -> float:
        """Time from the oldest value to the newest one, s."""
        return self._values[-1][0] - self._values[0][0] if self._values else 0.0
