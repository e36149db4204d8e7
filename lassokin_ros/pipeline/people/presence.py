"""Who is present and the tracking status. It changes with time even if no message arrives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from lassokin_ros.core.observation import Status


@dataclass(frozen=True)
class Presence:
    """Tracking status and the ids of the people present.

    With several people, `status` is the best status among them. `ids` is None if one person is followed.
    """

    status: Status
    ids: list[str] | None = None


def best(statuses: Iterable[Status]) -> Status:
    """Return the best of several statuses: TRACKING, then LOST, then SEARCHING."""
    present = set(statuses)
    return next((status for status in (Status.TRACKING, Status.LOST) if status in present), Status.SEARCHING)
