"""What is said of who is there, when a message has come and when none comes: many detectors send none of nobody."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from lassokin_ros.core.estimate import Status


@dataclass(frozen=True)
class Presence:
    """status: what is known of the person, of several of the one of whom most is; ids: theirs, None when it is one."""

    status: Status
    ids: list[str] | None = None


def best(statuses: Iterable[Status]) -> Status:
    """Of several people, that of the one of whom most is known."""
    known = set(statuses)
    return next((status for status in (Status.TRACKING, Status.LOST) if status in known), Status.SEARCHING)
