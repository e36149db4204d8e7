"""Several people: who is who from message to message, who has come, who is away for a while, who has left."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Sequence

import numpy as np

from lassokin_ros.core.estimate import Status
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.lens import Lens
from lassokin_ros.pipeline.people.assignment import assign
from lassokin_ros.pipeline.people.matching import NEAR, distance, distances, reach, usable
from lassokin_ros.pipeline.people.presence import Presence, best
from lassokin_ros.pipeline.people.tracked_person import Detection, TrackedPerson

BIRTH_MESSAGES = 3
"""A person whom nobody has numbered is believed in after this many measurements; one message in between may miss them."""

SAME_BODY = 0.5 * NEAR
"""A detection this near to a person who is seen already is the detector's second look, not a second person."""

MAKES_ROOM_S = 0.5
"""s: when all trackers are in use, who has been away this long gives way to somebody new."""

FOUND_AT_ONCE = 4
"""Lost people found anew in one message; the others wait for the next. Finding takes thirty times as long as following:
a crowd found anew all at once keeps a slow machine longer than `lost_after`, and is lost again by the next message."""


@dataclass(eq=False)
class Candidate:
    """Somebody who may be a person: the last detection, and in how many messages there was one."""

    seen: Detection
    measurements: int = 1
    missed: int = 0


class MultiPersonTracker:
    """One Body for each person; bodies are made at the start and used again."""

    def __init__(self, bodies: Sequence[TrackedPerson], counts: Counter[str]) -> None:
        """counts: where births, deaths and the reasons against single people's frames are counted."""
        self._idle = list(bodies)
        self._counts = counts
        self._present: dict[int, TrackedPerson] = {}
        self._candidates: list[Candidate] = []
        self._next = 1

    @property
    def ids(self) -> list[str]:
        """Of the people who are there or away for a short while."""
        return [name(number) for number in self._present]

    @property
    def bodies(self) -> dict[str, TrackedPerson]:
        """Their bodies, by id."""
        return {name(number): body for number, body in self._present.items()}

    @property
    def status(self) -> Status:
        """The best of the people's."""
        return best(body.status for body in self._present.values())

    def presence_at(self, stamp_ns: int, forget_after: float) -> Presence:
        """Who is there when nothing has come until a time, which nothing is changed by; forget_after: s."""
        there = {person: body for person, body in self.bodies.items() if body.unseen_s(stamp_ns) <= forget_after}
        return Presence(best(body.status_at(stamp_ns) for body in there.values()), list(there))

    def tracked_at(self, stamp_ns: int) -> bool:
        """True when somebody was tracked in the message of this stamp."""
        return any(body.seen_ns == stamp_ns for body in self._present.values())

    def flush(self) -> list[FrameResult]:
        """Everybody's frames that wait for their `smoothing_lag`."""
        return [frame for body in self._present.values() for frame in body.flush()]

    def reset(self) -> None:
        """Forget everybody. Numbers are not used again, so that nobody inherits another's id."""
        for number in list(self._present):
            self._let_go(number)
        for body in self._idle:
            body.reset()
        self._candidates.clear()

    def update(
        self, stamp_ns: int, frame_id: str, seen: Sequence[Detection], lens: Lens, lasting: bool, forget_after: float
    ) -> list[FrameResult]:
        """One message's people to frames, those with a skeleton only.

        lasting: detections carry a number that stays with the person; else they are told apart here. forget_after: s.
        """
        for number in [n for n, body in self._present.items() if body.unseen_s(stamp_ns) > forget_after]:
            self._let_go(number)
        if lasting:
            pairs = {d.number: d for d in seen if d.number in self._present or self._usable(d)}
            for number in pairs:
                if number not in self._present:
                    self._welcome(number, stamp_ns, pairs)
        else:
            pairs = self._recognise(stamp_ns, seen)
        return self._track(stamp_ns, frame_id, pairs, lens)

    def _track(self, stamp_ns: int, frame_id: str, pairs: dict[int, Detection], lens: Lens) -> list[FrameResult]:
        lost = {number for number, body in self._present.items() if body.status_at(stamp_ns) is Status.LOST}
        going_on = [number for number in self._present if number in pairs and number not in lost]
        bodies, seen = {name(n): self._present[n] for n in going_on}, [pairs[n] for n in going_on]
        tracked = dict(zip(going_on, TrackedPerson.track_batch(bodies, stamp_ns, frame_id, seen, lens)))
        frames, found = [], 0
        for number, body in list(self._present.items()):
            if number not in pairs or (number in lost and found == FOUND_AT_ONCE):
                frames += body.absent(stamp_ns, lens)
                continue
            if number in tracked:
                answers = tracked[number]
            else:
                answers = body.track(stamp_ns, frame_id, pairs[number], lens, name(number))
                found += body.status is Status.TRACKING
            frames += [frame for frame in answers if frame.accepted]
            refused = [frame for frame in answers if not frame.accepted]
            for frame in refused:
                self._counts[f"rejected: {frame.rejection} (a person)"] += 1
            if refused and body.seen_ns is None:  # not even once: nobody to remember
                self._let_go(number)
        return frames

    def _recognise(self, stamp_ns: int, seen: Sequence[Detection]) -> dict[int, Detection]:
        """Who the detections are: present people by the least total distance, then new ones."""
        usable = [d for d in seen if self._usable(d)]
        numbers = list(self._present)
        limits = [reach(self._present[n].unseen_s(stamp_ns)) for n in numbers]
        costs = self._distances(stamp_ns, usable)
        matched = assign(costs, limits)
        pairs = {numbers[row]: usable[column] for row, column in matched}
        known, taken = [row for row, _ in matched], {column for _, column in matched}
        strangers = [d for i, d in enumerate(usable) if i not in taken and np.all(costs[known, i] > SAME_BODY)]
        for stranger in self._believed(_each_once(strangers)):
            number = self._next
            if self._welcome(number, stamp_ns, pairs):
                pairs[number] = stranger
        return pairs

    def _distances(self, stamp_ns: int, seen: Sequence[Detection]) -> np.ndarray:
        """Of detections (columns) from where present people (rows) are expected; infinite for who was never seen."""
        if not self._present or not seen:
            return np.zeros((len(self._present), len(seen)))
        nowhere = np.full_like(seen[0].points, np.nan)
        expected = [body.expected(stamp_ns) for body in self._present.values()]
        places = np.stack([nowhere if points is None else points for points in expected])
        return distances(places, seen, next(iter(self._present.values())).tracker.config.min_confidence)

    def _believed(self, strangers: Sequence[Detection]) -> list[Detection]:
        """Those who have been seen in enough messages; the others stay candidates, or become ones."""
        candidates = np.array([c.seen.points for c in self._candidates])
        found = dict(assign(distances(candidates, strangers, 0.0), [NEAR] * len(self._candidates)))
        fresh = [Candidate(d) for i, d in enumerate(strangers) if i not in found.values()]
        for row, candidate in enumerate(self._candidates):
            if row in found:
                candidate.seen, candidate.missed = strangers[found[row]], 0
                candidate.measurements += 1
            else:
                candidate.missed += 1
        believed = [self._candidates[row] for row in found if self._candidates[row].measurements >= BIRTH_MESSAGES]
        kept = [c for c in self._candidates if c.missed <= 1 and c not in believed]
        self._candidates = kept + fresh
        return [candidate.seen for candidate in believed]

    def _usable(self, seen: Detection) -> bool:
        return usable(seen, next(iter([*self._idle, *self._present.values()])).tracker.config)

    def _welcome(self, number: int, stamp_ns: int, pairs: dict[int, Detection]) -> bool:
        """Give somebody new a body, told how the camera is held; False, and counted, when there is none left."""
        if not self._idle:
            away = [(b.unseen_s(stamp_ns), n) for n, b in self._present.items() if n not in pairs]
            if not away or max(away)[0] < MAKES_ROOM_S:
                self._counts["people beyond max_people"] += 1
                return False
            self._let_go(max(away)[1])
        newcomer = self._idle[-1].tracker
        for known in self._idle, self._present.values():  # who is there knows better than who has left
            newcomer.adopt_vertical(body.tracker for body in known)
        self._present[number] = self._idle.pop()
        self._next = max(self._next, number + 1)
        self._counts["people come"] += 1
        return True

    def _let_go(self, number: int) -> None:
        body = self._present.pop(number)
        body.reset(same_camera=True)
        self._idle.append(body)
        self._counts["people left"] += 1


def _each_once(seen: Sequence[Detection]) -> list[Detection]:
    """Without a second look at the same person; of two the one with more points stays."""
    kept: list[Detection] = []
    for detection in sorted(seen, key=lambda d: -int(np.count_nonzero(d.confidence))):
        if all(distance(other.points, detection, 0.0) > SAME_BODY for other in kept):
            kept.append(detection)
    return kept


def name(number: int) -> str:
    """The id under which a person is published; a part of a topic's name must not begin with a digit."""
    return f"p{number}"
