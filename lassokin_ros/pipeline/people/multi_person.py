"""Follow several people: match detections to people, add new people, remove people who left."""

from __future__ import annotations

import math
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from typing import Iterable, Sequence

import numpy as np

from lassokin_ros.core.observation import Rejection, Status
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.image_sets import LATE
from lassokin_ros.pipeline.people.assignment import assign
from lassokin_ros.pipeline.people.choice import (
    CONFIDENT,
    GUESS_AFTER_S,
    NoPersonError,
    nobody_to_lock,
    number_named,
    preferred,
)
from lassokin_ros.pipeline.people.cross_view import SAME_PERSON, cross_view_cost
from lassokin_ros.pipeline.people.matching import NEAR, distance, distances, is_trackable, match_radius
from lassokin_ros.pipeline.people.people_tracker import GONE
from lassokin_ros.pipeline.people.presence import Presence, best, reported_status
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Image, Seen, Sight

CONFIRMING_MESSAGES = 3
"""A person without a persistent number is added after this many detections; one message in between may miss them."""

SAME_BODY = 0.5 * NEAR
"""A detection this near to a matched person is a duplicate detection, not a second person."""

REPLACEABLE_AFTER_S = 0.5
"""s: if all trackers are in use, a person absent for this long is removed for a new one."""

LONGEST_APART_NS = 100_000_000
"""ns: largest difference of the stamps of two sights of different cameras that are compared."""

DOUBTFUL = 2.0
"""A person who is seen first by one camera is not added, if the cost of being somebody whom only other cameras see is
below this times SAME_PERSON."""

MOST_REINITIALISED = 4
"""Lost people re-initialised per message; the others wait for the next message. Initialisation takes 7 to 50
times as long as a step. If many people were initialised at once, a slow machine would be busy for longer than
`lost_after`, and they would be lost again."""


@dataclass(eq=False)
class Candidate:
    """A possible new person in the images of one camera: the last sight, and the number of messages with one."""

    sight: Sight
    measurements: int = 1
    missed: int = 0


class MultiPersonTracker:
    """Implements PeopleTracker for several people. The trackers are created at the start and reused."""

    def __init__(
        self,
        people: Sequence[TrackedPerson],
        counts: Counter[str],
        follow: str = CONFIDENT,
        lock: bool = False,
        several_cameras: bool = False,
    ) -> None:
        """counts: receives the numbers of people who come and leave, and the rejections of single people.

        follow, lock: see NodeSettings. several_cameras: numbers of people are not used, because each camera's detector
        has its own.
        """
        self._follow, self._lock_first, self._lock_next = follow, lock, lock
        self._locked: int | None = None
        self._gone = False  # whether the locked person was forgotten
        self._guessed: set[int] = set()
        self._newest: dict[int, Seen] = {}  # the newest detection, by person
        self._newest_ns = 0
        self._several_cameras = several_cameras
        self._idle = list(people)
        self._counts = counts
        self._present: dict[int, TrackedPerson] = {}
        self._candidates: dict[str, list[Candidate]] = {}  # by camera
        self._sights: dict[int, dict[str, Sight]] = {}  # the newest ones, by person and camera
        self._crowds: dict[str, tuple[int, int]] = {}  # stamp, ns, and number of people in the newest image, by camera
        self._left: list[FrameResult] = []  # results of people removed, which waited for smoothing_lag
        self._next = 1
        self._made: set[int] = set()  # people whose number is not the detector's
        self._count = people[0].tracker.kinematics.landmark_count
        self._nothing = Seen(np.full((self._count, 2), np.nan), np.zeros(self._count))

    @property
    def ids(self) -> list[str]:
        """Ids of the people who are present or absent for a short while."""
        return [name(number) for number in self._present]

    @property
    def tracked(self) -> dict[str, TrackedPerson]:
        """See PeopleTracker.tracked."""
        return {name(number): person for number, person in self._present.items()}

    @property
    def status(self) -> Status:
        """The best status among the people."""
        return best(person.status for person in self._present.values())

    @property
    def locked(self) -> str | None:
        """See PeopleTracker.locked."""
        return GONE if self._gone else None if self._locked is None else name(self._locked)

    def tune(self, follow: str, lock: bool) -> None:
        """See PeopleTracker.tune."""
        if lock != self._lock_first:
            self._lock_next = lock
        self._follow, self._lock_first = follow, lock

    def lock(self) -> str:
        """See PeopleTracker.lock."""
        ages = {n: self._present[n].unseen_s(self._newest_ns) for n in self._newest}
        there = {n: seen for n, seen in self._newest.items() if ages[n] <= GUESS_AFTER_S}
        number = number_named(self._follow)
        if number is None and there:
            number = list(there)[preferred(self._follow, list(there.values()))]
        if number is None or number not in there:
            raise NoPersonError(nobody_to_lock(self._follow, len(there)))
        self._locked, self._gone, self._lock_next = number, False, False
        self._guessed.discard(number)
        return name(number)

    def release(self) -> None:
        """See PeopleTracker.release."""
        self._locked, self._gone, self._lock_next = None, False, False

    def presence_at(self, stamp_ns: int, forget_after: float, stale_after: float = math.inf) -> Presence:
        """See PeopleTracker.presence_at."""
        there = {key: person for key, person in self.tracked.items() if person.unseen_s(stamp_ns) <= forget_after}
        if self.locked is not None:
            locked = there.get(self.locked)
            status = Status.LOST if locked is None else reported_status(locked, stamp_ns, stale_after)
            return Presence(status, list(there))
        return Presence(best(reported_status(one, stamp_ns, stale_after) for one in there.values()), list(there))

    def tracked_at(self, stamp_ns: int) -> bool:
        """See PeopleTracker.tracked_at."""
        return any(person.seen_ns == stamp_ns for person in self._present.values())

    def flush(self) -> list[FrameResult]:
        """See PeopleTracker.flush."""
        left, self._left = self._left, []
        return [*left, *(result for person in self._present.values() for result in person.flush())]

    def sights_at(self, stamp_ns: int) -> dict[int, dict[str, Seen]]:
        """Return the detections of each person in the images of a stamp, by number and by camera."""
        return {
            number: {name: sight.seen for name, sight in newest.items() if sight.stamp_ns == stamp_ns}
            for number, newest in self._sights.items()
        }

    def reset(self, unlock: bool = True) -> None:
        """Forget all people. Numbers are not reused, so that nobody inherits the id of another person.

        unlock: see PeopleTracker.reset.
        """
        for number in list(self._present):
            self._remove(number)
        for person in self._idle:
            person.reset()
        self._left.clear()
        self._candidates.clear()
        self._gone = self.locked is not None and not unlock
        self._locked, self._lock_next = None, self._lock_first and not self._gone

    def update(self, images: Sequence[Image], frame_id: str, forget_after: float) -> list[FrameResult]:
        """Track the people of one image, or of one instant; see PeopleTracker.update. Returns accepted results only."""
        persistent = images[0].lasting and not self._several_cameras
        stamp_ns = max(image.stamp_ns for image in images)
        for number in [n for n, person in self._present.items() if person.unseen_s(stamp_ns) > forget_after]:
            self._remove(number)
        sights: dict[int, list[Sight]] = {}
        for image in images:
            view = [Sight(image.stamp_ns, one, image.lens, image.camera) for one in image.people]
            view = view if persistent else [sight for sight in view if self._is_trackable(sight.seen)]
            self._crowds[image.camera.name] = image.stamp_ns, len(view)
            if not image.camera.known:
                found = self._only_one(image, view, sights)
            else:
                found = self._numbered(view) if persistent else self._match(image, view, sights)
            for number, sight in found.items():
                sights.setdefault(number, []).append(sight)
        self._newest |= {n: seen[0].seen for n, seen in sights.items() if n in self._present}
        self._newest_ns = stamp_ns
        results = self._track(images[0], frame_id, sights, persistent)
        if self._lock_next:
            with suppress(NoPersonError):  # wait for the next image
                self.lock()
        left, self._left = self._left, []
        return left + results

    def _only_one(self, image: Image, view: Sequence[Sight], sights: dict[int, list[Sight]]) -> dict[int, Sight]:
        """Return the sight of a camera whose place is not known, if it is that of the only person in view.

        If any camera sees several people, it is not known who is who. sights: of other cameras at the same instant.
        """
        if any(count > 1 and _is_recent(stamp_ns, image.stamp_ns) for stamp_ns, count in self._crowds.values()):
            return {}
        recent = {n for n, person in self._present.items() if _is_recent(person.seen_ns or 0, image.stamp_ns)}
        there = recent | sights.keys()
        return dict(zip(there, view)) if len(there) == 1 else {}

    def _numbered(self, view: Sequence[Sight]) -> dict[int, Sight]:
        """Return the sights by person number, which lasts. People of new numbers are added."""
        for sight in view:
            self._give_up_number(sight)
        pairs = {s.seen.number: s for s in view if s.seen.number in self._present or self._is_trackable(s.seen)}
        for number, sight in pairs.items():
            if number not in self._present:
                self._give_up_made_number(sight)
                self._add(number, sight.stamp_ns, pairs)
        return pairs

    def _give_up_made_number(self, sight: Sight) -> None:
        """Remove the person whose number the node made, and who was last seen where this sight of a new number is.

        It is the same person: the detector has a lasting number for them now. A locked person stays.
        """
        made = [
            (row, number)
            for row, (number, person) in enumerate(self._present.items())
            if number in self._made and number != self._locked and person.seen_ns == self._newest_ns
        ]
        if made:
            apart = self._distances(sight.stamp_ns, [sight])[:, 0]
            row, number = min(made, key=lambda one: float(apart[one[0]]))
            if apart[row] <= NEAR:
                self._remove(number)

    def _give_up_number(self, sight: Sight) -> None:
        """Remove a person of the number of a sight if the number is not the detector's, and the sight not the person.

        It is the person if the last image showed the person there, too.
        """
        number = sight.seen.number
        if number not in self._made:
            return
        self._made.remove(number)
        row, gone = list(self._present).index(number), self._present[number].seen_ns != self._newest_ns
        if gone or self._distances(sight.stamp_ns, [sight])[row, 0] > NEAR:
            self._remove(number)
            if self._locked == number:
                self._locked, self._gone = None, True

    def _track(self, image: Image, frame_id: str, pairs: dict[int, list[Sight]], persistent: bool) -> list[FrameResult]:
        stamp_ns = self._newest_ns
        lost = {number for number, person in self._present.items() if person.status_at(stamp_ns) is Status.LOST}
        results, found = [], 0
        errors: list[Exception] = []
        for number, person in list(self._present.items()):
            seen = pairs.get(number) if number not in lost or found < MOST_REINITIALISED else None
            try:
                results += self._results_of(number, image, frame_id, seen, number if persistent else -1)
            except Exception as error:  # the others are tracked all the same
                errors.append(error)
            found += seen is not None and number in lost and person.status is Status.TRACKING
        if errors:
            raise errors[0]
        return results

    def _results_of(
        self, number: int, image: Image, frame_id: str, seen: Sequence[Sight] | None, detector_id: int
    ) -> list[FrameResult]:
        """The accepted results of one person; rejections are counted. seen: None for a person not in the images."""
        person = self._present[number]
        if seen is None:
            nothing = Sight(self._newest_ns, self._nothing, image.lens, image.camera)
            return person.mark_absent(nothing) if image.camera.known else []
        placed = {sight.camera.name: sight for sight in seen if sight.camera.known}
        self._sights.setdefault(number, {}).update(placed)
        guessed = number in self._guessed
        answers = person.track(seen, frame_id, name(number), detector_id=detector_id, guessed=guessed)
        refused = [result for result in answers if not result.accepted]
        for result in refused if placed else ():
            late = result.rejection == Rejection.LATE.value
            self._counts[LATE if late else f"rejected: {result.rejection} (a person)"] += 1
        if refused and person.seen_ns is None:  # never tracked: there is no state to keep
            self._remove(number)
        return [result for result in answers if result.accepted]

    def _match(self, image: Image, view: Sequence[Sight], sights: dict[int, list[Sight]]) -> dict[int, Sight]:
        """Match the sights of one image to present people by the least total cost, then add new people.

        view: those who can be tracked. sights: those of other cameras at the same instant, by person.
        """
        usable, stamp_ns = view, image.stamp_ns
        numbers = list(self._present)
        limits = [match_radius(self._present[n].unseen_s(stamp_ns)) for n in numbers]
        costs = self._distances(stamp_ns, usable)
        if self._several_cameras:
            self._compare_views(image, usable, costs, sights)
        matched = assign(costs, limits)
        pairs = {numbers[row]: usable[column] for row, column in matched}
        self._guessed |= {n for n in pairs if GUESS_AFTER_S < self._present[n].unseen_s(stamp_ns) < math.inf}
        known, taken = [row for row, _ in matched], {column for _, column in matched}
        strangers = [d for i, d in enumerate(usable) if i not in taken and np.all(costs[known, i] > SAME_BODY)]
        if self._several_cameras:
            strangers = [s for s in strangers if not self._is_near_anybody(s, sights)]
        for stranger in self._confirmed(image.camera.name, _without_duplicates(strangers)):
            number = self._next
            if self._add(number, stamp_ns, {**sights, **pairs}):
                self._made.add(number)
                pairs[number] = stranger
        return pairs

    def _compare_views(
        self, image: Image, usable: Sequence[Sight], costs: np.ndarray, sights: dict[int, list[Sight]]
    ) -> None:
        """Replace the costs of people whom this camera has not seen for a while by those of `cross_view_cost`.

        Other cameras see them: the place of a body that one camera alone has seen is too uncertain for a projection.
        """
        for row, number in enumerate(self._present):
            newest = self._sights.get(number, {})
            own = newest.get(image.camera.name)
            if own is not None and image.stamp_ns - own.stamp_ns < GUESS_AFTER_S * 1e9:
                continue
            others = sights.get(number) or [s for s in newest.values() if _is_recent(s.stamp_ns, image.stamp_ns)]
            if others:
                size = self._present[number].tracker.learned.size_check
                costs[row] = [NEAR / SAME_PERSON * cross_view_cost(others[0], sight, size) for sight in usable]

    def _is_near_anybody(self, stranger: Sight, sights: dict[int, list[Sight]]) -> bool:
        """Return True if a stranger may be somebody whom only other cameras have seen."""
        for number, person in self._present.items():
            newest = self._sights.get(number, {})
            others = sights.get(number) or [s for s in newest.values() if _is_recent(s.stamp_ns, stranger.stamp_ns)]
            if stranger.camera.name in newest or not others:
                continue
            if cross_view_cost(others[0], stranger, person.tracker.learned.size_check) < DOUBTFUL * SAME_PERSON:
                return True
        return False

    def _distances(self, stamp_ns: int, sights: Sequence[Sight]) -> np.ndarray:
        """Return distances of sights (columns) from present people (rows); infinite for people never tracked."""
        if not self._present or not sights:
            return np.zeros((len(self._present), len(sights)))
        nowhere = np.full_like(sights[0].seen.points, np.nan)
        predicted = [person.predicted_landmarks(stamp_ns, sights[0].camera) for person in self._present.values()]
        places = np.stack([nowhere if points is None else points for points in predicted])
        seen = [sight.seen for sight in sights]
        return distances(places, seen, next(iter(self._present.values())).tracker.config.min_confidence)

    def _confirmed(self, camera: str, strangers: Sequence[Sight]) -> list[Sight]:
        """Return strangers detected in CONFIRMING_MESSAGES messages of a camera. The others stay or become
        candidates.
        """
        known = self._candidates.get(camera, [])
        candidates = np.array([c.sight.seen.points for c in known])
        found = dict(assign(distances(candidates, [s.seen for s in strangers], 0.0), [NEAR] * len(known)))
        fresh = [Candidate(s) for i, s in enumerate(strangers) if i not in found.values()]
        for row, candidate in enumerate(known):
            if row in found:
                candidate.sight, candidate.missed = strangers[found[row]], 0
                candidate.measurements += 1
            else:
                candidate.missed += 1
        seen = [known[row] for row in found]
        confirmed = [candidate for candidate in seen if candidate.measurements >= CONFIRMING_MESSAGES]
        kept = [c for c in known if c.missed <= 1 and c not in confirmed]
        self._candidates[camera] = kept + fresh
        return [candidate.sight for candidate in confirmed]

    def _is_trackable(self, detection: Seen) -> bool:
        return is_trackable(detection, next(iter([*self._idle, *self._present.values()])).tracker.config)

    def _add(self, number: int, stamp_ns: int, pairs: Iterable[int]) -> bool:
        """Assign a tracker to a new person. Return False, and count it, if none is free. The locked person who comes
        back gets one in any case.

        The new tracker adopts the direction of gravity from the others. If a tracker has this person's skeleton, it is
        that one; else one that has nobody's, if there is one.
        """
        if not self._idle:
            locked = number == self._locked
            kept = set() if locked else {*pairs, self._locked}
            away = [(person.unseen_s(stamp_ns), n) for n, person in self._present.items() if n not in kept]
            if not away or (max(away)[0] < REPLACEABLE_AFTER_S and not locked):
                self._counts["people beyond max_people"] += 1
                return False
            self._remove(max(away)[1])
        own = [person for person in self._idle if person.number == number]
        nobodys = [person for person in self._idle if person.number is None]
        newcomer = (self._idle[-1:] + nobodys + own)[-1]
        for known in self._idle, self._present.values():  # present people override those who left
            newcomer.tracker.adopt_vertical(person.tracker for person in known)
        self._idle.remove(newcomer)
        self._present[number] = newcomer
        self._next = max(self._next, number + 1)
        self._counts["people come"] += 1
        return True

    def _remove(self, number: int) -> None:
        person = self._present.pop(number)
        self._left += person.flush()
        person.reset(same_camera=True)
        self._idle.append(person)
        self._guessed.discard(number)
        self._made.discard(number)
        self._newest.pop(number, None)
        self._sights.pop(number, None)
        self._counts["people left"] += 1


def _is_recent(one_ns: int, other_ns: int) -> bool:
    return abs(other_ns - one_ns) <= LONGEST_APART_NS


def _without_duplicates(sights: Sequence[Sight]) -> list[Sight]:
    """Remove duplicate detections of one person. The detection with more points stays."""
    kept: list[Sight] = []
    for sight in sorted(sights, key=lambda s: -int(np.count_nonzero(s.seen.confidence))):
        if all(distance(other.seen.points, sight.seen, 0.0) > SAME_BODY for other in kept):
            kept.append(sight)
    return kept


def name(number: int) -> str:
    """Return the id of a person. It is part of topic names, which must not begin with a digit."""
    return f"p{number}"
