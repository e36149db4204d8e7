"""Keypoint messages that wait a moment for what belongs to their image: its depth image, and the camera's pose from TF.

A depth image is large, and often arrives a few milliseconds after the small keypoint message of its time. A robot's
localisation publishes its pose some time after the image. A message then waits, for each at most for a given time;
after that the depth image of the period before is used (`DepthImages`), or the motion is continued (`Transforms`). If
most of them are later than that, messages no longer wait for them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from msg_adapters.keypoints import stamp_of

MOST_FAILED_WAITS = 10
"""Value of a counter at which messages do not wait, and its maximum. It rises by 1 for a message for which something
did not come in time, and falls by 1, down to 0, for one for which it did."""


@dataclass
class Wait:
    """One thing that messages wait for.

    may_come: of a frame_id and a stamp (ns, None without one), whether it may still come. longest_s: s. last_ns: of the
    clock of arrivals, when the last one came; None if that says nothing. silent_s: s without one, after which nobody
    waits. polled_s: s between two looks, if nothing tells that it has come; 0 if something does. gives_up: whether
    messages no longer wait if it mostly comes later; a part of the wait is of use otherwise.
    """

    may_come: Callable[[str, int | None], bool]
    longest_s: float
    last_ns: Callable[[], int] | None = None
    silent_s: float = 0.5
    polled_s: float = 0.0
    gives_up: bool = True
    failed: int = 0

    def holds(self, frame_id: str, stamp_ns: int | None, waited_s: float, now_ns: int) -> bool:
        """Return True if a message waits for it."""
        if not self.may_come(frame_id, stamp_ns):
            self.failed = max(self.failed - 1, 0)
            return False
        silent = self.last_ns is not None and now_ns - self.last_ns() > 1e9 * self.silent_s
        if (self.gives_up and self.failed >= MOST_FAILED_WAITS) or silent:
            return False
        if waited_s < self.longest_s:
            return True
        self.failed += 1
        return False


class Waiting:
    """The messages of one camera that wait, in the order of their arrival. Times are ns of the clock of arrivals."""

    def __init__(self, waits: list[Wait]) -> None:
        self._waits = waits
        self._messages: deque[tuple[Any, int | None, int]] = deque()  # with stamp and arrival
        self._held_by: Wait | None = None  # what the first message waits for
        self._looked_ns = 0

    def add(self, message: Any, arrival_ns: int) -> None:
        """Add a message, None for one that could not be read."""
        self._messages.append((message, stamp_of(message), arrival_ns))

    def ready(self, now_ns: int | None, frame_id: str = "") -> list[tuple[Any, int]]:
        """Take the messages that wait no longer, with their arrivals.

        now_ns: None if nothing follows. frame_id: of messages that have none.
        """
        taken = []
        self._held_by = None
        while self._messages:
            message, stamp_ns, arrival_ns = self._messages[0]
            if now_ns is not None:
                frame, waited_s = _frame_of(message) or frame_id, 1e-9 * (now_ns - arrival_ns)
                holding = (wait for wait in self._waits if wait.holds(frame, stamp_ns, waited_s, now_ns))
                self._held_by, self._looked_ns = next(holding, None), now_ns
                if self._held_by is not None:
                    break
            self._messages.popleft()
            taken.append((message, arrival_ns))
        return taken

    @property
    def due_at_ns(self) -> int | None:
        """The time at which `ready` must be called; None if no message waits."""
        wait = self._held_by
        if wait is None:
            return None
        end_ns = self._messages[0][2] + round(1e9 * wait.longest_s)
        return min(end_ns, self._looked_ns + round(1e9 * wait.polled_s)) if wait.polled_s else end_ns

    def set_clock_back(self, step_ns: int) -> None:
        """See `Session.set_clock_back`."""
        self._messages = deque((message, stamp, arrival_ns - step_ns) for message, stamp, arrival_ns in self._messages)
        self._looked_ns -= step_ns

    def reset(self) -> None:
        """Drop the messages."""
        self._messages.clear()
        self._held_by = None


def _frame_of(message: Any) -> str:
    header = getattr(message, "header", message)
    return str(getattr(header, "frame_id", "")).lstrip("/")
