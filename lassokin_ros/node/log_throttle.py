"""Log throttling, because a camera can send thirty bad frames per second."""

from __future__ import annotations

from typing import Callable

from lassokin_ros.pipeline.concerns.catalogue import without_numbers

SAME_LINE_S = 5.0


class LogThrottle:
    """Logs a line if no line with the same key was logged for `SAME_LINE_S`."""

    def __init__(self, write: Callable[[str], object], clock: Callable[[], float]) -> None:
        """write: log function; clock: returns seconds."""
        self._write, self._clock = write, clock
        self._logged: dict[str, list[tuple[float, str]]] = {}  # s, and the line without its numbers

    def log(self, key: str, line: str, different: int = 1) -> None:
        """Log `line`, unless it or `different` others with the same key were logged less than `SAME_LINE_S` ago.

        Lines whose numbers alone differ are the same.
        """
        now, words = self._clock(), without_numbers(line)
        recent = [logged for logged in self._logged.get(key, ()) if now - logged[0] < SAME_LINE_S]
        if len(recent) < different and all(words != others for _, others in recent):
            recent.append((now, words))
            self._write(line)
        self._logged[key] = recent
