"""Log throttling, because a camera can send thirty bad frames per second."""

from __future__ import annotations

from typing import Callable

PERIOD_S = 5.0


class LogThrottle:
    """Logs a line if no line with the same key was logged for `PERIOD_S`."""

    def __init__(self, write: Callable[[str], object], clock: Callable[[], float]) -> None:
        """write: log function; clock: returns seconds."""
        self._write, self._clock = write, clock
        self._logged: dict[str, float] = {}

    def log(self, key: str, line: str) -> None:
        """Log `line`, unless a line with the same key was logged less than `PERIOD_S` ago."""
        now = self._clock()
        if now - self._logged.get(key, -PERIOD_S) >= PERIOD_S:
            self._logged[key] = now
            self._write(line)
