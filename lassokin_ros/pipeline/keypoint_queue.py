"""Which of the waiting keypoint messages are worked on: the newest wins, and what is left out is counted.

A node that was held up for a moment uses every message and catches up. Once more than `depth` messages wait, it works
on the newest alone until nothing waits any more: a node that cannot keep pace is at most one message behind.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

OVERTAKEN, LOST = "overtaken by newer", "lost on the way"
"""Keys of the counts: messages that came and were left out for newer ones; messages that were sent and never came."""

RESERVE = 100
"""Least depth of the middleware's queue: what is overtaken must be seen to be counted."""


class KeypointQueue:
    """Chooses among the messages that wait, and counts the others; knows messages by their `message_info` alone."""

    def __init__(self, depth: int, counts: Counter[str]) -> None:
        """depth: messages that may wait and are all used; counts: where `received`, OVERTAKEN and LOST are."""
        self._depth, self._counts = depth, counts
        self._behind = False
        self._ended_ns = 0
        self._number: int | None = None
        self._publishers = 0

    @property
    def reserve(self) -> int:
        """Depth that the middleware's queue needs, so that more than `depth` waiting messages are noticed."""
        return max(RESERVE, self._depth + 1)

    def choose(self, waiting: Sequence[tuple[Any, Mapping[str, Any]]], publishers: int) -> list[Any]:
        """The messages to be worked on now, oldest first, of all (message, message_info) that wait, one at least.

        publishers: how many the topic has. Call `done` after the work.
        """
        infos = [info for _, info in waiting]
        self._count_lost(infos, publishers)
        if infos[0].get("received_timestamp", 0) > self._ended_ns:
            self._behind = False  # nothing waited when the last work had ended
        if len(waiting) > self._depth:
            self._behind = True
        messages = [message for message, _ in waiting]
        if not self._behind:
            return messages
        self._counts["received"] += len(messages) - 1
        self._counts[OVERTAKEN] += len(messages) - 1
        return messages[-1:]

    def done(self, now_ns: int) -> None:
        """The chosen messages have been worked on; now_ns: ns of the system's clock, as in message_info."""
        self._ended_ns = now_ns

    def _count_lost(self, infos: Sequence[Mapping[str, Any]], publishers: int) -> None:
        """Numbers missing in the publisher's sequence; of several publishers the numbers cannot be told apart."""
        if publishers != self._publishers:
            self._number, self._publishers = None, publishers
        for info in infos:
            number, last = info.get("publication_sequence_number"), self._number
            if number is not None and last is not None and publishers == 1:
                self._counts[LOST] += max(number - last - 1, 0)
            self._number = number
