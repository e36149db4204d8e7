"""What the session answers: the results of the images of one instant, in the order of their stamps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from lassokin_ros.core.observation import Rejection
from lassokin_ros.core.output.smoothing import TOLERANCE
from lassokin_ros.pipeline.frame_result import FrameResult, repeated_s
from lassokin_ros.pipeline.image_sets import LATE
from lassokin_ros.pipeline.people.people_tracker import PERSON_ABSENT

ABSENCES = (Rejection.TOO_FEW_LANDMARKS.value, Rejection.UNPLACED.value, PERSON_ABSENT)
"""Rejections of the images of a camera that does not see the person."""


@dataclass(eq=False)
class Answer:
    """The results of the images of one instant, or of a message that was refused as a whole.

    Attributes
    ----------
    stamp_ns, frame_id: of the instant, as in FrameResult.
    arrival_ns: ns of the clock of arrivals, of the last message that belongs to it.
    frames: one result per person; none if nobody is there.
    stamps_ns: ns, of the images. The stamp of a result is that of the newest image which shows its person.
    refused: True for a message that was refused as a whole; it says nothing about who is there.
    matters: False for images of one of several cameras that show nobody while another camera sees somebody.
    """

    stamp_ns: int
    frame_id: str
    arrival_ns: int
    frames: Sequence[FrameResult] = ()
    stamps_ns: Sequence[int] = ()
    refused: bool = False
    matters: bool = True

    @property
    def accepted(self) -> list[FrameResult]:
        """The results to publish."""
        return [frame for frame in self.frames if frame.accepted]


def frames_of(answers: Iterable[Answer]) -> list[FrameResult]:
    """Return the results of all answers, in their order."""
    return [frame for answer in answers for frame in answer.frames]


class Answers:
    """Counts the results of messages, and holds answers until those that wait for `smoothing_lag` are there."""

    def __init__(self, counts: Counter[str], several_cameras: bool = False) -> None:
        """counts: see `Session.counts`."""
        self._counts, self._several = counts, several_cameras
        self.any_accepted = False
        """True after the first accepted result of a person."""
        self.reset()

    def reset(self) -> None:
        """Drop the answers that are held."""
        self._held: list[tuple[int, Answer]] = []  # with the stamp, ns, whose place each takes, see `add`
        self._newest_ns = 0

    def without_absences(self, frames: Iterable[FrameResult], elsewhere: bool) -> list[FrameResult]:
        """Leave out the rejections of one of several cameras that only did not see the person.

        elsewhere: whether another camera sees the person.
        """
        kept = []
        for frame in frames:
            if frame.rejection == Rejection.LATE.value:
                self._counts[LATE] += 1
            elif not elsewhere or frame.rejection not in ABSENCES:
                kept.append(frame)
        return kept

    def add(self, answer: Answer, lag: float) -> list[Answer]:
        """Count the results of an answer as one accepted or rejected message, and return the answers that are due.

        answer: with the results of earlier instants that are due now; those of its own instant may follow. A refused
        message follows the newest image before it. lag: s, `smoothing_lag`.
        """
        self._count(answer.frames)
        if lag == 0 and not self._held:
            return [answer] if answer.frames or answer.matters else []
        own = [frame for frame in answer.frames if not frame.accepted or frame.stamp_ns in answer.stamps_ns]
        self._keep(self._newest_ns if answer.refused else answer.stamp_ns, replace(answer, frames=own))
        if not answer.refused:
            self._newest_ns = max(self._newest_ns, answer.stamp_ns)
        self._complete([frame for frame in answer.frames if frame not in own], answer.arrival_ns)
        return self._taken(self._newest_ns - round(1e9 * max(lag - TOLERANCE, 0.0)))

    def flush(self, frames: Sequence[FrameResult] = ()) -> list[Answer]:
        """Return all answers that are held. frames: their last results."""
        self._complete(frames, max((answer.arrival_ns for _, answer in self._held), default=0))
        answers, self._newest_ns = self._taken(None), 0
        return answers

    def _keep(self, place_ns: int, answer: Answer) -> None:
        self._held.append((place_ns, answer))
        self._held.sort(key=lambda one: one[0])

    def _complete(self, frames: Iterable[FrameResult], arrival_ns: int) -> None:
        """Add results to the answers of their instants."""
        for frame in frames:
            for index, (place_ns, answer) in enumerate(self._held):
                if frame.stamp_ns in answer.stamps_ns:
                    self._held[index] = place_ns, replace(answer, frames=[*answer.frames, frame])
                    break
            else:
                stamp_ns = frame.stamp_ns
                self._keep(stamp_ns, Answer(stamp_ns, frame.frame_id, arrival_ns, [frame], [stamp_ns]))

    def _taken(self, latest_ns: int | None) -> list[Answer]:
        """Take the answers up to a stamp; None: all."""
        due = [entry for entry in self._held if latest_ns is None or entry[0] <= latest_ns]
        self._held = self._held[len(due) :]
        return [answer for _, answer in due if answer.frames or answer.matters]

    def _count(self, frames: Sequence[FrameResult]) -> None:
        self.any_accepted = self.any_accepted or any(frame.accepted for frame in frames)
        rejection = next((frame.rejection for frame in frames if not frame.accepted), None)
        if frames or not self._several:
            self._counts["accepted" if rejection is None else f"rejected: {rejection}"] += 1
        if repeated_s(frames) > 0:
            self._counts["duplicated"] += 1
