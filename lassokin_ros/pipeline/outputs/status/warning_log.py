"""The warnings of a whole recording: each once, with the number of periods in which it held."""

from __future__ import annotations

from collections.abc import Iterable

from lassokin_ros.pipeline.concerns.catalogue import Raised, without_numbers


class WarningLog:
    """Collects the warnings of each period of the diagnostics."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[int, Raised]] = {}

    def add(self, warnings: Iterable[Raised]) -> None:
        """Add the warnings of one period. Those that differ in their numbers only are one; the first text is kept."""
        for raised in warnings:
            key = without_numbers(raised.text)
            count, first = self._found.get(key, (0, raised))
            self._found[key] = count + 1, first

    @property
    def found(self) -> list[Raised]:
        """The warnings, the most frequent first, each with its number of periods of 1 s."""
        ordered = sorted(self._found.values(), key=lambda item: -item[0])
        return [raised._replace(text=f"{raised.text} (for {count} s)") for count, raised in ordered]
