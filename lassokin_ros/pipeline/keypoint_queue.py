"""Select which of the waiting keypoint messages are processed, and count those that are dropped.

After a short delay the node processes all waiting messages. If more than `depth` messages wait, only the newest is
processed until no message waits. A node that is too slow is therefore at most one message behind.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

OVERTAKEN, LOST = "overtaken by newer", "lost on the way"
"""Keys of the counts: messages that arrived and were dropped for newer ones, and messages that never arrived."""

RESERVE = 100
"""Least depth of the middleware's queue. A dropped message must reach the node to be counted."""


class KeypointQueue:
    """Selects among the waiting messages by their `message_info`."""

    def __init__(self, depth: int, counts: Counter[str]) -> None:
        """depth: number of waiting messages that are all processed; counts: receives `received`, OVERTAKEN and LOST."""
        self._depth, self._counts = depth, counts
        self._behind = False
        self._ended_ns = 0
        self._number: int | None = None
        self._publishers = 0

    @property
    def reserve(self) -> int:
        """Required depth of the middleware's queue, so that more than `depth` waiting messages are noticed."""
        return max(RESERVE, self._depth + 1)

    def choose(self, waiting: Sequence[tuple[Any, Mapping[str, Any]]], publishers: int) -> list[Any]:
        """Return the messages to process now, oldest first.

        waiting: all waiting pairs (message, message_info), at least one. publishers: number of publishers on the
        topic. Call `done` after processing.
        """
        infos = [info for _, info in waiting]
        self._count_lost(infos, publishers)
        if infos[0].get("received_timestamp", 0) > self._ended_ns:
            self._behind = False  # no message waited at the end of the last processing
        if len(waiting) > self._depth:
            self._behind = True
        messages = [message for message, _ in waiting]
        if not self._behind:
            return messages
        self._counts["received"] += len(messages) - 1
        self._counts[OVERTAKEN] += len(messages) - 1
        return messages[-1:]

    def done(self, now_ns: int) -> None:
        """Record the end of processing; now_ns: ns of the system clock, as in message_info."""
        self._ended_ns = now_ns

    def _count_lost(self, infos: Sequence[Mapping[str, Any]], publishers: int) -> None:
        """Count gaps in the publisher's sequence. With several publishers the sequences cannot be separated."""
        if publishers != self._publishers:
            self._number, self._publishers = None, publishers
        for info in infos:
            number, last = info.get("publication_sequence_number"), self._number
            if number is not None and last is not None and publishers == 1:
                self._counts[LOST] += max(number - last - 1, 0)
            self._number = number
