"""The warnings of a whole recording: each once, with the number of periods in which it held."""

from __future__ import annotations

import re
from collections.abc import Iterable


class WarningLog:
    """Collects the warnings of each period of the diagnostics."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[int, str]] = {}

    def add(self, warnings: Iterable[str]) -> None:
        """Add the warnings of one period. Those that differ in their numbers only are one; the first text is kept."""
        for words in warnings:
            key = re.sub(r"[-+.\de]*\d", "#", words)
            count, text = self._found.get(key, (0, words))
            self._found[key] = count + 1, text

    @property
    def lines(self) -> list[str]:
        """The warnings, the most frequent first, each with its number of periods of 1 s."""
        ordered = sorted(self._found.values(), key=lambda item: -item[0])
        return [f"{text} (for {count} s)" for count, text in ordered]
