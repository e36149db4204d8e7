"""The values of the last moments, and changes among them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Value = TypeVar("Value")
ROUNDING_S = 1e-6
"""s: stamps are rounded, so a window of 0.1 s holds the frame of exactly 0.1 s ago."""


class Recent(Generic[Value]):
    """Values with their stamps, of the last `seconds`."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds + ROUNDING_S
        self._stamps: deque[float] = deque()
        self.values: deque[Value] = deque()
        """The values, oldest first."""

    def add(self, stamp: float, value: Value) -> None:
        """Add a value and drop those that are too old. stamp: s. A stamp that goes back drops all others."""
        if self._stamps and stamp < self._stamps[-1]:
            self.clear()
        self._stamps.append(stamp)
        self.values.append(value)
        self.forget_before(stamp)

    def forget_before(self, stamp: float) -> None:
        """Drop the values that are too old at a stamp, s."""
        stamps = self._stamps
        while stamps and stamp - stamps[0] > self._seconds:
            stamps.popleft()
            self.values.popleft()

    def clear(self) -> None:
        """Drop all values."""
        self._stamps.clear()
        self.values.clear()

    @property
    def span(self) -> float:
        """Time from the oldest value to the newest one, s."""
        return self._stamps[-1] - self._stamps[0] if self._stamps else 0.0


class Change(Generic[Value]):
    """Reports a value that differs from one of the last moments; once, because the later ones are compared with it."""

    def __init__(self, seconds: float, differs: Callable[[Value, Value], bool]) -> None:
        """differs: whether an earlier value and the present one are too different."""
        self._recent: Recent[Value] = Recent(seconds)
        self._differs = differs

    def reset(self) -> None:
        """Forget the earlier values."""
        self._recent.clear()

    def update(self, stamp: float, value: Value) -> Value | None:
        """Return the earlier value from which this one differs, None without one. stamp: s."""
        self._recent.forget_before(stamp)
        before = next((old for old in self._recent.values if self._differs(old, value)), None)
        if before is not None:
            self._recent.clear()
        self._recent.add(stamp, value)
        return before
