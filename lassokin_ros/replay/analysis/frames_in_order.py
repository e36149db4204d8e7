"""Frames in the order of their stamps. With `smoothing_lag`, rejected frames would overtake those that are held."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter, itemgetter

from lassokin_ros.pipeline.frame_result import FrameResult

Message = list[FrameResult]
"""The frames of one keypoint message, one per person."""
Timed = tuple[Message, int]
"""A message, and when it was recorded, ns."""


Place = tuple[int, int]
"""Of a message among the others: stamp in ns, and 0, or a number of its own if it was refused as a whole."""
Held = tuple[Place, int, FrameResult | None]
"""Place and recording time in ns of a frame; None for an image, which is a message also if nobody is in it."""


def by_stamp(frames: Sequence[FrameResult]) -> list[Message]:
    """Return the frames of each message, in the order of the stamps."""
    stamp = attrgetter("stamp_ns")
    return [list(group) for _, group in groupby(sorted(frames, key=stamp), stamp)]


class FramesInOrder:
    """Holds frames back until no earlier one can follow."""

    def __init__(self, lag: float, several_cameras: bool = False) -> None:
        """lag: s, `smoothing_lag`. several_cameras: an image without people is no message, others may show them."""
        self._lag_ns, self._several_cameras = round(lag * 1e9), several_cameras
        self._held: list[Held] = []
        self._recorded: dict[int, int] = {}  # recording time of each image that is held, by its stamp
        self._newest_ns = self._calls = 0

    def add(self, frames: Sequence[FrameResult], image: tuple[int, str] | None, time_ns: int) -> list[Timed]:
        """Add what the pipeline returned for a message. Returns the messages that are due.

        image: stamp in ns and frame_id of the newest tracked image, None before the first. time_ns: recording time.
        """
        if image is None:  # the stamps begin anew, or the camera is another
            before = [frame for frame in frames if frame.accepted and frame.stamp_ns in self._recorded]
            self._hold(before, time_ns)
            others = by_stamp([frame for frame in frames if frame not in before])
            return [*self.flush(), *((message, time_ns) for message in others)]
        newest_ns, _ = image
        due = []
        if newest_ns < self._newest_ns:  # the stamps begin anew: frames with later ones are of before
            self._hold([frame for frame in frames if frame.stamp_ns > newest_ns], time_ns)
            due, frames = self.flush(), [frame for frame in frames if frame.stamp_ns <= newest_ns]
        if newest_ns != self._newest_ns:
            self._recorded[newest_ns] = time_ns
            if not self._several_cameras:
                self._held.append(((newest_ns, 0), time_ns, None))
        self._newest_ns = newest_ns
        self._hold(frames, time_ns)
        return due + self._taken(newest_ns - self._lag_ns)

    def flush(self) -> list[Timed]:
        """Return all messages. No message follows."""
        return self._taken(None)

    def _hold(self, frames: Sequence[FrameResult], time_ns: int) -> None:
        """Hold frames. A message that was refused as a whole, perhaps for its stamp, follows the newest image."""
        self._calls += 1
        for frame in frames:
            if frame.accepted or (frame.estimate is not None and frame.stamp_ns == self._newest_ns):
                recorded_ns = self._recorded.get(frame.stamp_ns, time_ns)
                self._held.append(((frame.stamp_ns, 0), recorded_ns, frame))
            else:
                self._held.append(((self._newest_ns + 1, self._calls), time_ns, frame))
        self._held.sort(key=itemgetter(0))

    def _taken(self, latest_ns: int | None) -> list[Timed]:
        """Take the messages up to a stamp; None: all."""
        due = [entry for entry in self._held if latest_ns is None or entry[0][0] <= latest_ns]
        self._held = self._held[len(due) :]
        self._recorded = {
            stamp: at for stamp, at in self._recorded.items() if latest_ns is not None and stamp > latest_ns
        }
        groups = groupby(due, lambda entry: (entry[0], entry[0][0] if entry[2] is None else entry[2].stamp_ns))
        return [_message(list(group)) for _, group in groups]


def _message(held: Sequence[Held]) -> Timed:
    return [frame for _, _, frame in held if frame is not None], held[0][1]
