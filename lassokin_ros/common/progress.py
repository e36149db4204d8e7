"""A one-line progress bar for terminals; on other streams it is silent or writes a few lines in total."""

from __future__ import annotations

import sys
import time
from io import StringIO
from typing import TextIO

WIDTH = 30
DRAWN_EVERY_S = 0.1


class Progress:
    """Count up to a total and show the progress."""

    def __init__(self, total: int, unit: str, stream: TextIO | None = None, plain_lines: int = 0) -> None:
        """total: 0 = unknown. plain_lines: total number of lines to write if the stream is not a terminal."""
        self._known, self._total, self._unit = total > 0, max(total, 1), unit
        self._plain_lines = plain_lines
        self._stream: TextIO = stream or sys.stderr or StringIO()  # sys.stderr is None if it was closed
        self._shown = self._stream.isatty()
        self._started = time.monotonic()
        self._next = self._started
        self._count = 0

    def advance(self, count: int = 1, note: str = "") -> None:
        """Add to the count. note: a few words after the bar."""
        self._count += count
        now = time.monotonic()
        if self._shown and (now >= self._next or (self._known and self._count == self._total)):
            self._next = now + DRAWN_EVERY_S
            self._draw(now, note)
        elif not self._shown and self._plain_lines:
            lines, before = (self._plain_lines * n // self._total for n in (self._count, self._count - count))
            if lines > before:
                self._stream.write(f"{self._count}/{self._total} {self._unit} {note}".rstrip() + "\n")
                self._stream.flush()

    def _draw(self, now: float, note: str) -> None:
        text = self._bar(now - self._started) if self._known else f"{self._count} {self._unit}"
        self._stream.write(f"\r{text} {note}"[:110] + "\x1b[K")
        self._stream.flush()

    def _bar(self, seconds: float) -> str:
        """Return the bar, the count, and the time left as soon as a hundredth is done."""
        share = min(self._count / self._total, 1.0)
        bar = "#" * round(share * WIDTH)
        left = f", {seconds / share - seconds:.0f} s left" if share > 0.01 else ""
        return f"[{bar:.<{WIDTH}}] {self._count}/{self._total} {self._unit}{left}"

    def close(self) -> None:
        """Clear the line."""
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
