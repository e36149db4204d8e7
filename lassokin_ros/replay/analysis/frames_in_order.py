"""Frames in the order of their stamps. With `smoothing_lag`, rejected frames would overtake those that are held."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter, itemgetter

from lassokin_ros.pipeline.frame_result import FrameResult

Message = list[FrameResult]
"""The frames of one keypoint message, one per person."""


Place = tuple[int, int]
"""Of a message among the others: stamp in ns, and 0, or a number of its own if it was refused as a whole."""


def by_stamp(frames: Sequence[FrameResult]) -> list[Message]:
    """Return the frames of each message, in the order of the stamps."""
    stamp = attrgetter("stamp_ns")
    return [list(group) for _, group in groupby(sorted(frames, key=stamp), stamp)]


class FramesInOrder:
    """Holds frames back until no earlier one can follow."""

    def __init__(self, lag: float) -> None:
        """lag: s, `smoothing_lag`."""
        self._lag_ns = round(lag * 1e9)
        self._held: list[tuple[Place, FrameResult]] = []
        self._newest_ns = self._calls = 0

    def add(self, frames: Sequence[FrameResult], image: tuple[int, str] | None) -> list[Message]:
        """Add what the pipeline returned for a message. Returns the messages that are due.

        image: stamp in ns and frame_id of the newest tracked image, None before the first.
        """
        if image is None:  # the stamps begin anew, or the camera is another
            return [*self.flush(), *by_stamp(frames)]
        newest_ns, _ = image
        due = []
        if newest_ns < self._newest_ns:  # the stamps begin anew: frames with later ones are of before
            self._hold([frame for frame in frames if frame.stamp_ns > newest_ns])
            due, frames = self.flush(), [frame for frame in frames if frame.stamp_ns <= newest_ns]
        self._newest_ns = newest_ns
        self._hold(frames)
        return due + self._taken(newest_ns - self._lag_ns)

    def flush(self) -> list[Message]:
        """Return all messages. No message follows."""
        return self._taken(None)

    def _hold(self, frames: Sequence[FrameResult]) -> None:
        """Hold frames. A message that was refused as a whole, perhaps for its stamp, follows the newest image."""
        self._calls += 1
        for frame in frames:
            in_order = frame.accepted or (frame.estimate is not None and frame.stamp_ns == self._newest_ns)
            self._held.append(((frame.stamp_ns, 0) if in_order else (self._newest_ns + 1, self._calls), frame))
        self._held.sort(key=itemgetter(0))

    def _taken(self, latest_ns: int | None) -> list[Message]:
        """Take the messages up to a stamp; None: all."""
        due = [entry for entry in self._held if latest_ns is None or entry[0][0] <= latest_ns]
        self._held = self._held[len(due) :]
        groups = groupby(due, lambda entry: (entry[0], entry[1].stamp_ns))
        return [[frame for _, frame in group] for _, group in groups]
