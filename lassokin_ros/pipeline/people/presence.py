"""Who is present and the tracking status. It changes with time even if no message arrives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lassokin_ros.core.observation import Status

if TYPE_CHECKING:
    from lassokin_ros.pipeline.people.tracked_person import TrackedPerson


@dataclass(frozen=True)
class Presence:
    """Tracking status and the ids of the people present.

    With several people, `status` is the best status among them. `ids` is None if one person is followed.
    """

    status: Status
    ids: list[str] | None = None


def reported_status(person: TrackedPerson, stamp_ns: int, stale_after: float) -> Status:
    """Return the status of a person for the outputs: LOST `stale_after` s after the last accepted frame.

    The tracker itself keeps the person until `lost_after`.
    """
    status = person.status_at(stamp_ns)
    stale = status is Status.TRACKING and person.unseen_s(stamp_ns) > stale_after
    return Status.LOST if stale else status


def best(statuses: Iterable[Status]) -> Status:
    """Return the best of several statuses: TRACKING, then LOST, then SEARCHING."""
    present = set(statuses)
    return next((status for status in (Status.TRACKING, Status.LOST) if status in present), Status.SEARCHING)
