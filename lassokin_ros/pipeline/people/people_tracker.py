"""Interface of the trackers of people. The pipeline treats one person and several people alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.people.presence import Presence
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Image

GONE = "gone"
"""In place of the id of a locked person who was forgotten. No detection is assigned until unlock."""
FORGOTTEN = "the locked person was forgotten: nobody is followed until ~/lock is called"
"""What this means, in words."""


class PeopleTracker(Protocol):
    """Assigns the detections of each image to tracked people. One implementation per number of people."""

    @property
    def ids(self) -> list[str] | None:
        """Ids of the people present; None if one person is followed."""
        ...

    @property
    def tracked(self) -> dict[str, TrackedPerson]:
        """The people by id; the id of a single person is empty."""
        ...

    @property
    def status(self) -> Status:
        """Tracking status. With several people, the best status among them."""
        ...

    @property
    def locked(self) -> str | None:
        """Id of the locked person, or GONE; None if nobody is locked."""
        ...

    def presence_at(self, stamp_ns: int, forget_after: float, stale_after: float = math.inf) -> Presence:
        """Return the presence at a time, in ns, up to which no message has arrived. The state does not change.

        forget_after, stale_after: s, see NodeSettings.
        """
        ...

    def tracked_at(self, stamp_ns: int) -> bool:
        """Return True if the message of this stamp updated a track."""
        ...

    def update(self, images: Sequence[Image], frame_id: str, forget_after: float) -> list[FrameResult]:
        """Track the people in one image, or in those of several cameras at one instant.

        frame_id: of the results. forget_after: s. Raises AdapterError if the keypoints are unusable.
        """
        ...

    def flush(self) -> list[FrameResult]:
        """Return the results that wait for `smoothing_lag`. No message follows."""
        ...

    def reset(self, unlock: bool = True) -> None:
        """Forget all people. unlock: whether a lock ends too; otherwise it stays, on nobody (`GONE`)."""
        ...

    def tune(self, follow: str, lock: bool) -> None:
        """Apply settings that can change while running; see NodeSettings."""
        ...

    def lock(self) -> str:
        """Lock the person whom the setting `follow` names in the newest image, and return the id.

        Raises NoPersonError if there is nobody.
        """
        ...

    def release(self) -> None:
        """Lock nobody."""
        ...
