"""Keypoint messages that wait a moment for what belongs to their image: the depth image of their time.

A depth image is large, and often arrives a few milliseconds after the small keypoint message of its time. The message
then waits, at most for a given time. After that the depth image of the period before is used (`DepthImages`). If most
images are later than that, messages no longer wait.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from lassokin_ros.pipeline.depth_images import DepthImages
from msg_adapters.keypoints import stamp_of

SILENT_NS = 500_000_000
"""ns without a depth image after which messages do not wait for one."""
MOST_FAILED_WAITS = 10
"""Value of a counter at which messages do not wait, and its maximum. It rises by 1 for a message whose image did not
come in time, and falls by 1, down to 0, for one whose image did."""


class Waiting:
    """The messages of one camera that wait, in the order of their arrival. Times are ns of the clock of arrivals."""

    def __init__(self, depth: DepthImages | None, longest_s: float) -> None:
        """depth: the depth images of the camera, None if it has none. longest_s: longest wait, s."""
        self._depth, self._longest_ns = depth, round(1e9 * longest_s)
        self._messages: deque[tuple[Any, int | None, int]] = deque()  # with stamp and arrival
        self._failed = 0

    def add(self, message: Any, arrival_ns: int) -> None:
        """Add a message, None for one that could not be read."""
        self._messages.append((message, stamp_of(message), arrival_ns))

    def ready(self, now_ns: int | None) -> list[tuple[Any, int]]:
        """Take the messages that wait no longer, with their arrivals. now_ns: None if nothing follows."""
        taken = []
        while self._messages:
            message, stamp_ns, arrival_ns = self._messages[0]
            if now_ns is not None and self._waits(stamp_ns, arrival_ns, now_ns):
                break
            self._messages.popleft()
            taken.append((message, arrival_ns))
        return taken

    @property
    def due_at_ns(self) -> int | None:
        """The time at which the wait of the first message ends; None if none waits."""
        return self._messages[0][2] + self._longest_ns if self._messages else None

    def set_clock_back(self, step_ns: int) -> None:
        """See `Pipeline.set_clock_back`."""
        self._messages = deque((message, stamp, arrival_ns - step_ns) for message, stamp, arrival_ns in self._messages)

    def reset(self) -> None:
        """Drop the messages."""
        self._messages.clear()

    def _waits(self, stamp_ns: int | None, arrival_ns: int, now_ns: int) -> bool:
        depth = self._depth
        if depth is None:
            return False
        if not depth.may_receive(stamp_ns):
            self._failed = max(self._failed - 1, 0)
            return False
        if self._failed >= MOST_FAILED_WAITS or now_ns - depth.arrival_ns > SILENT_NS:
            return False
        if now_ns - arrival_ns < self._longest_ns:
            return True
        self._failed += 1
        return False
