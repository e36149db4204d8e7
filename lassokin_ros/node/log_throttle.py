"""Says a thing once in a while: a camera sends thirty bad frames a second, a log should not."""

from __future__ import annotations

from typing import Callable

PERIOD_S = 5.0


class LogThrottle:
    """Passes a line on when its key has not been heard of for `PERIOD_S`."""

    def __init__(self, say: Callable[[str], object], clock: Callable[[], float]) -> None:
        """say: where lines go; clock: seconds."""
        self._say, self._clock = say, clock
        self._said: dict[str, float] = {}

    def say(self, key: str, line: str) -> None:
        """Say `line`, unless one with the same key has just been said."""
        now = self._clock()
        if now - self._said.get(key, -PERIOD_S) >= PERIOD_S:
            self._said[key] = now
            self._say(line)
