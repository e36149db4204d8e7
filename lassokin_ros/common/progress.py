"""A progress bar of one line, for people: on a stream that is no terminal silent, or a few lines in all."""

from __future__ import annotations

import sys
import time
from io import StringIO
from typing import TextIO

WIDTH = 30
PERIOD_S = 0.1


class Progress:
    """Counts up to a total on a terminal."""

    def __init__(self, total: int, unit: str, stream: TextIO | None = None, plain_lines: int = 0) -> None:
        """plain_lines: how many lines to write in all when the stream is a file or a pipe."""
        self._total, self._unit = max(total, 1), unit
        self._plain_lines = plain_lines
        self._stream: TextIO = stream or sys.stderr or StringIO()  # there is no stderr where it was closed
        self._shown = self._stream.isatty()
        self._started = time.monotonic()
        self._next = self._started
        self._count = 0

    def advance(self, count: int = 1, note: str = "") -> None:
        """Count on; note: a few words after the bar."""
        self._count += count
        now = time.monotonic()
        if self._shown and (now >= self._next or self._count == self._total):
            self._next = now + PERIOD_S
            self._draw(now, note)
        elif not self._shown and self._plain_lines:
            lines, before = (self._plain_lines * n // self._total for n in (self._count, self._count - count))
            if lines > before:
                self._stream.write(f"{self._count}/{self._total} {self._unit} {note}".rstrip() + "\n")
                self._stream.flush()

    def _draw(self, now: float, note: str) -> None:
        share = min(self._count / self._total, 1.0)
        bar = "#" * round(share * WIDTH)
        seconds = now - self._started
        left = seconds / share - seconds if share > 0.01 else float("nan")
        text = f"\r[{bar:.<{WIDTH}}] {self._count}/{self._total} {self._unit}, {left:.0f} s left {note}"
        self._stream.write(text[:110] + "\x1b[K")
        self._stream.flush()

    def close(self) -> None:
        """Leave the line clean for what comes after."""
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
