"""Who is who: people in the images of one or several cameras, over time.

In the images of each camera, place, size and number decide who continues whom (`image_tracks.py`). A person whom this
camera has not seen for a while is the one whose keypoints lie on the epipolar lines, if another camera sees the person
(`cross_view.py`), else the one who is near the expected place. Who is left is nobody known.

With one tracker, the rule `follow` chooses whom it follows, and another person is followed only under a new id, after
the first one has been absent for `forget_after`. With several trackers, each new person gets one who is seen in some
images. A locked person keeps the tracker, and is absent in doubt.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from lassokin_ros.core.observation import Rejection, Status
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.image_sets import LATE
from lassokin_ros.pipeline.people.choice import (
    CONFIDENT,
    GUESS_AFTER_S,
    RULES,
    NoPersonError,
    nobody_to_lock,
    number_named,
    preferred,
)
from lassokin_ros.pipeline.people.cross_view import SAME_PERSON, cross_view_cost
from lassokin_ros.pipeline.people.image_tracks import FARTHEST_GUARDED, RIVAL, SAME_BODY, ImageTrack, ImageTracks
from lassokin_ros.pipeline.people.matching import assign, distance, distances, is_trackable, match_radius
from lassokin_ros.pipeline.people.presence import Presence, best, reported_status
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Image, Seen, Sight

GONE = "gone"
"""In place of the id of a locked person who was forgotten. No detection is assigned until unlock."""
FORGOTTEN = "the locked person was forgotten: nobody is followed until ~/lock is called"
"""What this means, in words."""
PERSON_ABSENT = "person_absent"
"""Rejection of a message that contains people, but not the followed person."""
CONFIRMING_MESSAGES = 3
"""A person without a lasting number gets a tracker after this many detections; one message in between may miss them."""
REPLACEABLE_AFTER_S = 0.5
"""s: if all trackers are in use, a person absent for this long is removed for a new one."""
DOUBTFUL = 2.0
"""A person who is seen first by one camera is not added, if the cost of being somebody whom only other cameras see is
below this times SAME_PERSON."""
MOST_REINITIALISED = 4
"""Lost people re-initialised per message; the others wait for the next message. Initialisation takes 7 to 50
times as long as a step. If many people were initialised at once, a slow machine would be busy for longer than
`lost_after`, and they would be lost again."""
WALKED = (0.0, 0.5, 1.0)
"""Shares of the time out of sight: a person whom no camera sees, as in a gap between two, walks on for one of these."""
AT_ONCE_NS = 100_000_000
"""ns: images of several cameras within this time show the same people."""


@dataclass(eq=False)
class _Person:
    """A person with a tracker. number: of the id; tracks: in the images of each camera.

    guessed: found again by place after an absence, so that it may be somebody else.
    """

    number: int
    body: TrackedPerson
    tracks: dict[str, ImageTrack] = field(default_factory=dict)
    guessed: bool = False

    @property
    def id(self) -> str:
        """The id. It is part of topic names, which must not begin with a digit."""
        return f"p{self.number}"

    @property
    def newest(self) -> ImageTrack | None:
        """The track with the newest detection; of equals that of the first camera."""
        return max(self.tracks.values(), key=lambda track: track.seen_ns, default=None)


class _View:
    """What one camera sees: its newest image, and the tracks of all people in its images."""

    def __init__(self, image: Image, sure: bool) -> None:
        self.image = image
        self.tracks = ImageTracks(sure)

    @property
    def seen(self) -> list[ImageTrack]:
        """The tracks with a detection in the newest image."""
        return self.tracks.seen_at(self.image.stamp_ns)


class PeopleTracker:
    """Assigns the people in each image to trackers, which are created at the start and reused. Stamps are ns."""

    def __init__(
        self,
        people: Sequence[TrackedPerson],
        counts: Counter[str],
        follow: str = CONFIDENT,
        lock: bool = False,
        several_cameras: bool = False,
        sure: bool = False,
    ) -> None:
        """people: one or more trackers. counts: receives the numbers of people who come and leave, and the rejections
        of single people. follow, lock: see NodeSettings. several_cameras: detectors' numbers are no ids, because each
        camera's detector has its own. sure: these numbers are people's, wherever they are (`person_ids: lasting`).
        """
        self._follow, self._lock_first, self._lock_next = follow, lock, lock
        self._locked: _Person | None = None
        self._gone = False  # whether the locked person was forgotten
        self._one, self._several_cameras, self._sure = len(people) == 1, several_cameras, sure
        self._idle, self._counts = list(people), counts
        self._config_of = people[0].tracker  # all have the same settings
        self._people = [_Person(1, self._idle.pop())] if self._one else []
        self._views: dict[str, _View] = {}
        self._newest_ns = 0
        self._left: list[FrameResult] = []  # results of people who left, which waited for smoothing_lag
        self._next = 1
        self._made: set[int] = set()  # ids that are not the detector's numbers
        self._renumbered = False  # whether a number of the detector may be another person's than before
        self._left_ns: int | None = None  # last sight of a person without a number, after whom there was a new id
        self.out_of_view: Collection[str] = ()
        """Ids of those at whose place no camera has looked since: they may come into view elsewhere. Set by the session."""
        nowhere = np.full((self._config_of.kinematics.landmark_count, 2), np.nan)
        self._nothing = Seen(nowhere, np.zeros(len(nowhere)), pixels=nowhere)

    @property
    def ids(self) -> list[str] | None:
        """Ids of the people who are present or absent for a short while; None if one person is followed."""
        return None if self._one else [person.id for person in self._people]

    @property
    def tracked(self) -> dict[str, TrackedPerson]:
        """The people by id; the id of a single person is empty."""
        return {"" if self._one else person.id: person.body for person in self._people}

    @property
    def status(self) -> Status:
        """Tracking status. With several people, the best status among them."""
        return best(person.body.status for person in self._people)

    @property
    def locked(self) -> str | None:
        """Id of the locked person, or GONE; None if nobody is locked."""
        return GONE if self._gone else None if self._locked is None else self._locked.id

    @property
    def jumped_number(self) -> int | None:
        """A number of a detector that has moved to another person lately, so that its numbers are not used."""
        jumped = [view.tracks.numbers.jumped for view in self._views.values() if view.image.lasting]
        return next((number for number in jumped if number is not None), None)

    @property
    def numbers_may_be_indices(self) -> bool:
        """Whether people are guessed, and a detector's numbers have only been 0, 1, ... or 1, 2, ... in each image."""
        unproven = any(view.image.lasting and not view.tracks.numbers.proven for view in self._views.values())
        return unproven and any(person.guessed for person in self._people)

    def presence_at(self, stamp_ns: int, forget_after: float, stale_after: float = math.inf) -> Presence:
        """Return the presence at a time up to which no message has arrived. The state does not change.

        forget_after, stale_after: s, see NodeSettings.
        """
        there = [one for one in self._people if self._one or one.body.unseen_s(stamp_ns) <= forget_after]
        statuses = {one: reported_status(one.body, stamp_ns, stale_after) for one in there}
        status = best(statuses.values())
        if self._gone and not self._one:
            status = Status.LOST
        elif self._locked is not None:
            status = Status.LOST if self._locked.guessed else statuses.get(self._locked, Status.LOST)
        return Presence(status, None if self._one else [one.id for one in there])

    def tracked_at(self, stamp_ns: int) -> bool:
        """Return True if the message of this stamp updated a track."""
        return any(person.body.seen_ns == stamp_ns for person in self._people)

    def untracked(self, image: Image, tracked_for: float) -> int:
        """Return the number of people who are in an image and not tracked.

        A detection where a tracked person is expected is that person: a duplicate, one with few keypoints, or one of an
        image that came late. tracked_for: s, for so long after the last accepted frame somebody is tracked.
        """
        stamp_ns, name, bodies = image.stamp_ns, image.camera.name, [person.body for person in self._people]
        matched = sum(body.seen_by.get(name) == stamp_ns for body in bodies)
        if image.shown <= matched:  # the usual case
            return 0
        there = [body for body in bodies if body.unseen_s(stamp_ns) <= tracked_for]
        expected = [body.predicted_landmarks(stamp_ns, image.camera) for body in there]
        if known := [points for points in expected if points is not None]:
            apart = distances(np.stack(known), image.people, self._config_of.config.min_confidence, fewest=1)
            near = apart.min(axis=0, initial=np.inf) <= SAME_BODY
            matched = max(matched, int(np.count_nonzero(near)))
        return max(image.shown - matched, 0)

    def sights_at(self, stamp_ns: int) -> dict[int, dict[str, Seen]]:
        """Return the detections of each person in the images of a stamp, by number and by camera."""
        return {
            person.number: {name: t.detection for name, t in person.tracks.items() if t.seen_ns == stamp_ns}
            for person in self._people
        }

    def flush(self) -> list[FrameResult]:
        """Return the results that wait for `smoothing_lag`. No message follows."""
        left, self._left = self._left, []
        return [*left, *(result for person in self._people for result in person.body.flush())]

    def reset(self, unlock: bool = True) -> None:
        """Forget all people. Ids are not used again, so that nobody inherits the id of another person.

        unlock: whether a lock ends too; otherwise it stays, on nobody (`GONE`).
        """
        self._gone = self.locked is not None and not unlock
        self._locked, self._lock_next = None, self._lock_first and not self._gone
        for person in list(self._people):
            if self._one:
                self._rename(person)
                person.tracks, person.guessed = {}, False
                person.body.reset()
            else:
                self._remove(person)
        for body in self._idle:
            body.reset()
        self._views.clear()
        self._left.clear()
        self._left_ns = None

    def tune(self, follow: str, lock: bool) -> None:
        """Apply settings that can change while running; see NodeSettings."""
        if lock != self._lock_first:
            self._lock_next = lock
        self._follow, self._lock_first = follow, lock

    def lock(self) -> str:
        """Lock the person whom the setting `follow` names in the newest image, and return the id.

        Raises NoPersonError if there is nobody.
        """
        person = self._chosen_of_one() if self._one else self._chosen_of_several()
        self._locked, self._gone, self._lock_next = person, False, False
        person.guessed = False
        return person.id

    def release(self) -> None:
        """Lock nobody."""
        self._locked, self._gone, self._lock_next = None, False, False

    def _chosen_of_several(self) -> _Person:
        """Return the person whom `follow` names among those who have trackers and were seen lately."""
        there = [one for one in self._people if one.tracks and one.body.unseen_s(self._newest_ns) <= GUESS_AFTER_S]
        number = number_named(self._follow)
        if number is None and there:
            return there[preferred(self._follow, [one.newest.detection for one in there if one.newest is not None])]
        if (found := next((one for one in there if one.number == number), None)) is None:
            raise NoPersonError(nobody_to_lock(self._follow, len(there)))
        return found

    def _chosen_of_one(self) -> _Person:
        """Return the only person with a tracker, who is from now on the one whom `follow` names in the image."""
        (person,) = self._people
        view = self._view_to_lock(person)
        candidates = [] if view is None else [track for track in view.seen if self._is_trackable(track.detection)]
        newest_ns = 0 if view is None else view.image.stamp_ns
        tracked = person.body.status is Status.TRACKING and person.body.unseen_s(newest_ns) <= GUESS_AFTER_S
        if not (tracked and (self._follow == CONFIDENT or not candidates)):
            chosen = None if view is None else self._best(candidates, view.image.lasting)
            if chosen is None or view is None:
                raise NoPersonError(nobody_to_lock(self._follow, len(candidates)))
            self._begin(person, chosen, view.image.camera.name)
        return person

    def _view_to_lock(self, person: _Person) -> _View | None:
        """Return the view with the newest sight of the person, else that of the newest image."""
        newest = max(self._views.values(), key=lambda view: view.image.stamp_ns, default=None)
        if newest is None:
            return None
        since_ns = newest.image.stamp_ns - GUESS_AFTER_S * 1e9
        shown = {name: track.seen_ns for name, track in person.tracks.items() if track.seen_ns >= since_ns}
        return self._views[max(shown, key=lambda name: shown[name])] if shown else newest

    def update(self, images: Sequence[Image], frame_id: str, forget_after: float) -> list[FrameResult]:
        """Track the people in one image, or in those of several cameras at one instant.

        frame_id: of the results. forget_after: s. If one person is followed, a refused message gives a result with the
        reason; of several people accepted results only are returned, and rejections are counted.
        """
        stamp_ns = self._newest_ns = max(image.stamp_ns for image in images)
        for person in list(self._people):
            if not self._is_guarded(person) and person.body.unseen_s(stamp_ns) > forget_after:
                self._remove(person)
        patience = max(forget_after, self._config_of.config.lost_after)
        sights: dict[_Person, list[Sight]] = {}
        for image in images:
            for person, seen in self._people_in(image, patience, sights).items():
                sights.setdefault(person, []).append(Sight(image.stamp_ns, seen, image.lens, image.camera))
        results = self._track(images, frame_id, sights, forget_after)
        if self._lock_next and any(self.tracked_at(image.stamp_ns) for image in images):
            with suppress(NoPersonError):  # wait for the next image
                if self._one:
                    self._locked, self._lock_next = self._people[0], False
                else:
                    self.lock()
        left, self._left = self._left, []
        return left + results

    # Who is who in one image ----------------------------------------------------------------------------------------

    def _people_in(self, image: Image, patience: float, found: Collection[_Person]) -> dict[_Person, Seen]:
        """Return the known people in an image, and those who are new. found: those in other images of the instant.

        patience: s, see `ImageTracks.update`.
        """
        name, stamp_ns = image.camera.name, image.stamp_ns
        view = self._views.get(name)
        if view is None:
            view = self._views[name] = _View(image, self._sure)
        view.image = image
        if image.identified:
            return self._identified(view, found)
        if self._one and not image.numbered and self.locked is None:
            return self._only_one(view, patience)
        if view.tracks.hear(stamp_ns, [one.number for one in image.people], image.lasting):
            self._renumbered = True
            if self._locked is not None and (track := self._locked.tracks.get(name)) is not None:
                track.silent_s = track.unseen_s(stamp_ns)  # who stands still is found by place, guessed
        own = self._own_tracks(image)
        numbers = {track.number for track in own} if image.lasting else ()
        usable = [one for one in image.people if self._is_trackable(one)]
        usable += [one for one in image.people if one.number in numbers and one not in usable and _has_points(one)]
        expected = {track: person.body.predicted_landmarks(stamp_ns, image.camera) for track, person in own.items()}
        guarded = [track for track, person in own.items() if self._is_guarded(person)]
        placed = [track for track, person in own.items() if self._elsewhere(person, image) is not None]
        view.tracks.update(stamp_ns, usable, image.lasting, patience, expected, guarded, placed)
        for track, person in own.items():
            away_s = min(track.gap_s, person.body.unseen_s(stamp_ns))
            person.guessed |= track.seen_ns == stamp_ns and track.by_place and away_s > GUESS_AFTER_S
        self._link(view, patience)
        if self._one:
            self._choose(view, patience)
        elif image.camera.known:
            self._add_strangers(view, found)
        return {p: t.detection for p in self._people if (t := p.tracks.get(name)) is not None and t.seen_ns == stamp_ns}

    def _identified(self, view: _View, found: Collection[_Person]) -> dict[_Person, Seen]:
        """Return the people of an image whose numbers are their own. found: as in `_people_in`."""
        name, stamp_ns = view.image.camera.name, view.image.stamp_ns
        people = {person.number: person for person in self._people}
        here: dict[_Person, Seen] = {}
        for seen in view.image.people:
            person = people.get(seen.number)
            if person is None and self._is_trackable(seen):
                person = self._add(seen.number, {*found, *here})
            if person is not None and _has_points(seen):
                person.tracks[name] = ImageTrack(seen, seen.points, stamp_ns, number=seen.number)
                here[person] = seen
        return here

    def _only_one(self, view: _View, patience: float) -> dict[_Person, Seen]:
        """Return the only person of a message without numbers, whoever it is.

        Somebody who comes after an absence may be another person, so the id is new.
        """
        (person,), (seen,), stamp_ns = self._people, view.image.people, view.image.stamp_ns
        if not self._is_trackable(seen):
            return {}
        left_ns = person.body.seen_ns
        if left_ns not in (None, self._left_ns) and person.body.unseen_s(stamp_ns) > patience:
            self._rename(person)
            self._left_ns = left_ns
        person.tracks[view.image.camera.name] = view.tracks.begin_alone(seen, stamp_ns)
        return {person: seen}

    def _own_tracks(self, image: Image) -> dict[ImageTrack, _Person]:
        """Return the tracks of people in the images of a camera.

        A track ends that is older than GUESS_AFTER_S if other cameras see the person: they tell the place.
        """
        name, own = image.camera.name, {}
        for person in self._people:
            track = person.tracks.get(name)
            if track is None:
                continue
            if track.unseen_s(image.stamp_ns) > GUESS_AFTER_S and self._elsewhere(person, image) is not None:
                del person.tracks[name]
            else:
                own[track] = person
        return own

    def _elsewhere(self, person: _Person, image: Image) -> Sight | None:
        """Return the newest sight of a person by another camera, as it is expected at the image's stamp."""
        others = [
            (track, self._views[name].image)
            for name, track in person.tracks.items()
            if name != image.camera.name
            and self._views[name].image.camera.known
            and abs(image.stamp_ns - track.seen_ns) <= GUESS_AFTER_S * 1e9
        ]
        if not others:
            return None
        track, other = max(others, key=lambda pair: pair[0].seen_ns)
        seen = replace(track.detection, points=track.predicted(image.stamp_ns))
        return Sight(image.stamp_ns, seen, other.lens, other.camera)

    def _link(self, view: _View, patience: float) -> None:
        """Give people who have no track in the images of a camera one that is nobody's: see the module's docstring."""
        image = view.image
        name = image.camera.name
        people = [person for person in self._people if name not in person.tracks]
        tracks = self._nobodys(view) if people else []
        if not tracks:
            return
        if not image.camera.known:
            there = [person for person in people if self._elsewhere(person, image) is not None]
            if len(there) == 1 and not self._is_crowd(image):
                there[0].tracks[name] = tracks[0]
            return
        costs = np.stack([self._costs(person, view, tracks, patience) for person in people])
        for row, column in assign(costs, np.ones(len(people))):
            others = np.delete(costs[row], column)
            person = people[row]
            if self._is_guarded(person) and costs[row, column] > RIVAL * others.min(initial=np.inf):
                continue
            person.tracks[name] = tracks[column]
            person.guessed |= GUESS_AFTER_S < person.body.unseen_s(image.stamp_ns) < math.inf

    def _costs(self, person: _Person, view: _View, tracks: Sequence[ImageTrack], patience: float) -> np.ndarray:
        """Return the costs (t,) of tracks as those of a person who has none in this view; at most 1 for the person."""
        image, body = view.image, person.body
        elsewhere, unseen_s = self._elsewhere(person, image), body.unseen_s(image.stamp_ns)
        if elsewhere is not None:
            size = body.tracker.learned.size_check
            sights = [Sight(image.stamp_ns, track.detection, image.lens, image.camera) for track in tracks]
            return np.array([cross_view_cost(elsewhere, sight, size) for sight in sights]) / SAME_PERSON
        away = person.id in self.out_of_view
        if unseen_s > patience and not (away and person is self._locked):
            return np.full(len(tracks), np.inf)
        stopped = (body.predicted_landmarks(image.stamp_ns, image.camera, unseen_s * share) for share in WALKED)
        points = [one for one in stopped if one is not None]
        if not points:
            return np.full(len(tracks), np.inf)
        reach = match_radius(unseen_s)
        if self._is_guarded(person) and not away:
            reach = min(reach, FARTHEST_GUARDED)
        detections = [track.detection for track in tracks]
        return distances(np.stack(points), detections, 0.0).min(axis=0) / reach

    def _nobodys(self, view: _View) -> list[ImageTrack]:
        """Return the tracks in the newest image of a camera that are nobody's."""
        owned = [person.tracks.get(view.image.camera.name) for person in self._people]
        return [track for track in view.seen if track not in owned]

    def _is_crowd(self, image: Image) -> bool:
        """Return True if a camera has seen several people lately: it is not known who is who in another image."""
        views = self._views.values()
        return any(len(v.seen) > 1 for v in views if abs(v.image.stamp_ns - image.stamp_ns) <= AT_ONCE_NS)

    # Who is new -----------------------------------------------------------------------------------------------------

    def _choose(self, view: _View, patience: float) -> None:
        """Follow the best person in the image, if nobody is followed yet, or if the followed person has left."""
        (person,), image = self._people, view.image
        if self.locked is not None or self._elsewhere(person, image) is not None:
            return
        track, body = person.tracks.get(image.camera.name), person.body
        here = track is not None and track.seen_ns == image.stamp_ns and self._is_trackable(track.detection)
        if person.tracks and body.seen_ns is not None and (here or body.unseen_s(image.stamp_ns) <= patience):
            return
        candidates = [track for track in view.seen if self._is_trackable(track.detection)]
        if (chosen := self._best(candidates, image.lasting)) is not None:
            self._begin(person, chosen, image.camera.name)

    def _best(self, tracks: Sequence[ImageTrack], lasting: bool) -> ImageTrack | None:
        """Return the track that the rule `follow` prefers; None if there is none."""
        number = number_named(self._follow)
        if number is not None:
            return next((track for track in tracks if lasting and track.detection.number == number), None)
        return tracks[preferred(self._follow, [track.detection for track in tracks])] if tracks else None

    def _begin(self, person: _Person, track: ImageTrack, camera: str) -> None:
        """Follow another person under a new id. The images of other cameras will show who it is there."""
        if track is person.tracks.get(camera):
            return
        self._rename(person)
        person.tracks, person.guessed = {camera: track}, False
        if person.body.seen_ns is not None:
            self._left += person.body.flush()
            person.body.reset(same_camera=True)

    def _rename(self, person: _Person) -> None:
        """Give the only person another id, if somebody was tracked under this one."""
        person.number += person.body.seen_ns is not None

    def _add_strangers(self, view: _View, found: Collection[_Person]) -> None:
        """Give trackers to people in the newest image of a camera who have none.

        found: people in other images of the same instant.
        """
        image, nobodys = view.image, self._nobodys(view)
        known = [track for track in view.seen if track not in nobodys]
        numbers = view.tracks.numbers
        at_once = image.lasting and numbers.believed(image.stamp_ns) and not self._several_cameras
        for track in nobodys:
            if (track.run < CONFIRMING_MESSAGES and not at_once) or not self._is_trackable(track.detection):
                continue
            if any(distance(other.points, track.detection, 0.0) <= SAME_BODY for other in known):
                continue  # a duplicate
            if self._is_near_anybody(track, image):
                continue
            here = [p for p in self._people if p.tracks.get(image.camera.name) in known]
            if (person := self._add(self._new_number(track, at_once), {*found, *here})) is not None:
                person.tracks[image.camera.name] = track
                known.append(track)

    def _new_number(self, track: ImageTrack, lasting: bool) -> int:
        """Return the number of the id of a new person: the detector's, unless it may have been another person's."""
        number, present = track.detection.number, [person.number for person in self._people]
        unused = number >= self._next or not (self._renumbered or number in self._made or number in present)
        if lasting and unused:
            return number
        self._made.add(self._next)
        return self._next

    def _is_near_anybody(self, track: ImageTrack, image: Image) -> bool:
        """Return True if a stranger may be somebody whom only other cameras have seen."""
        stranger = Sight(image.stamp_ns, track.detection, image.lens, image.camera)
        for person in self._people:
            if image.camera.name in person.tracks or (elsewhere := self._elsewhere(person, image)) is None:
                continue
            if cross_view_cost(elsewhere, stranger, person.body.tracker.learned.size_check) < DOUBTFUL * SAME_PERSON:
                return True
        return False

    def _add(self, number: int, found: Collection[_Person]) -> _Person | None:
        """Assign a tracker to a new person. Return None, and count it, if none is free.

        found: people who are in the images, and stay. The new tracker adopts the direction of gravity from the others.
        If a tracker has this person's skeleton, it is that one; else one that has nobody's, if there is one.
        """
        if not self._idle:
            away = [one for one in self._people if one not in found and one is not self._locked]
            longest = max(away, key=lambda one: one.body.unseen_s(self._newest_ns), default=None)
            if longest is None or longest.body.unseen_s(self._newest_ns) < REPLACEABLE_AFTER_S:
                self._counts["people beyond max_people"] += 1
                return None
            self._remove(longest)
        own = [body for body in self._idle if body.number == number]
        nobodys = [body for body in self._idle if body.number is None]
        newcomer = (self._idle[-1:] + nobodys + own)[-1]
        present = [person.body for person in self._people]
        for known in self._idle, present:  # present people override those who left
            newcomer.tracker.adopt_vertical(body.tracker for body in known)
        self._idle.remove(newcomer)
        self._people.append(_Person(number, newcomer))
        self._next = max(self._next, number + 1)
        self._counts["people come"] += 1
        return self._people[-1]

    def _remove(self, person: _Person) -> None:
        self._people.remove(person)
        self._left += person.body.flush()
        person.body.reset(same_camera=True)
        self._idle.append(person.body)
        self._counts["people left"] += 1

    # Tracking -------------------------------------------------------------------------------------------------------

    def _track(
        self, images: Sequence[Image], frame_id: str, sights: Mapping[_Person, list[Sight]], forget_after: float
    ) -> list[FrameResult]:
        """Return the results of all people at one instant."""
        lost = [one for one in self._people if one.body.status_at(self._newest_ns) is Status.LOST]
        results: list[FrameResult] = []
        errors: list[Exception] = []
        found = 0
        for person in list(self._people):
            seen = sights.get(person) if person not in lost or found < MOST_REINITIALISED else None
            try:
                if self._one:
                    results += self._results_of_one(images, frame_id, seen, forget_after)
                else:
                    results += self._results_of(person, images[0], frame_id, seen)
            except Exception as error:  # the others are tracked all the same
                errors.append(error)
            found += seen is not None and person in lost and person.body.status is Status.TRACKING
        if errors:
            raise errors[0]
        return results

    def _results_of(
        self, person: _Person, image: Image, frame_id: str, seen: Sequence[Sight] | None
    ) -> list[FrameResult]:
        """The accepted results of one of several people; rejections are counted. seen: None if not in the images."""
        if seen is None:
            nothing = Sight(self._newest_ns, self._nothing, image.lens, image.camera)
            return person.body.mark_absent(nothing) if image.camera.known else []
        number = self._detectors_number(person)
        answers = person.body.track(seen, frame_id, person.id, detector_id=number, guessed=person.guessed)
        refused = [result for result in answers if not result.accepted]
        for result in refused if any(sight.camera.known for sight in seen) else ():
            late = result.rejection == Rejection.LATE.value
            self._counts[LATE if late else f"rejected: {result.rejection} (a person)"] += 1
        if refused and person.body.seen_ns is None:  # never tracked: there is no state to keep
            self._remove(person)
        return [result for result in answers if result.accepted]

    def _results_of_one(
        self, images: Sequence[Image], frame_id: str, seen: Sequence[Sight] | None, forget_after: float
    ) -> list[FrameResult]:
        """The results of the only person. A refused message gives one with the reason. seen: None if not in the images.

        Without sights of the person those are used who cannot be tracked, so that the reason is reported.
        """
        (person,) = self._people
        seen = seen or [Sight(i.stamp_ns, self._untrackable(i), i.lens, i.camera) for i in images]
        number, guessed = self._detectors_number(person), person.guessed
        results = person.body.track(seen, frame_id, label=person.id, detector_id=number, guessed=guessed)
        if results and not results[-1].accepted and (absence := self._absence(images[0], forget_after)):
            results[-1] = replace(results[-1], rejection=PERSON_ABSENT, detail=absence)
        return results

    def _detectors_number(self, person: _Person) -> int:
        """Return the number of a person in the images of the first camera that has seen them lately; -1 without one."""
        since_ns = self._newest_ns - GUESS_AFTER_S * 1e9
        for name, view in self._views.items():
            track = person.tracks.get(name)
            if track is not None and view.image.lasting and track.seen_ns >= since_ns:
                return track.detection.number
        return -1

    def _untrackable(self, image: Image) -> Seen:
        """Return the person with the most points of those who cannot be tracked; nobody without one."""
        known = image.lasting and image.camera.name in self._people[0].tracks
        people = [] if known else [one for one in image.people if not self._is_trackable(one)]
        return people[preferred(CONFIDENT, people)] if people else self._nothing

    def _absence(self, image: Image, forget_after: float) -> str:
        """Return the explanation for a message that shows other people only; empty if that is not the case.

        Without it the message would be refused for too few landmarks. This reason would be misleading, because it
        suggests that the detector's confidences are too low.
        """
        (person,), view, named = self._people, self._views[image.camera.name], number_named(self._follow)
        track = person.tracks.get(image.camera.name)
        unfound = not (self._gone or person.tracks) and named is not None and bool(view.seen)
        if track is None and not (self._gone or unfound):
            return ""
        if track is not None and track.seen_ns == image.stamp_ns:
            return ""
        if not image.lasting and not view.seen:
            return ""  # those who are shown in part may be the followed person
        limit = max(self._config_of.config.min_confidence, 1e-9)
        others = sum(bool(np.count_nonzero(one.confidence >= limit)) for one in image.people)
        if not others:
            return ""
        if unfound:
            lasting = "" if image.lasting else ", and the numbers of its people do not last"
            return (
                f"follow is '{self._follow}', and no person of this number is among the {others} in the message"
                f"{lasting}; nobody else is followed: set follow to {', '.join(RULES)}, or to a lasting number"
            )
        if track is None:
            return (
                "the person who was locked is not known any more, because height, camera or time have changed; "
                f"nobody among the {others} in the message is followed until ~/lock is called; in a recorded run set "
                "lock to false"
            )
        number = track.detection.number
        who = "nobody is near the predicted position"
        if image.lasting and number not in [one.number for one in image.people]:
            who = f"person {number} is not"
        another = "another person" if named is None else f"nobody but person {named}, whom follow names,"
        waits = f"{another} is followed after forget_after {forget_after:g} s"
        if self._locked is not None:
            waits = "the person is locked, until ~/lock is called with false"
        return (
            f"one person is followed, and {who} among the {others} in the message; {waits} (see person_ids, max_people)"
        )

    def _is_guarded(self, person: _Person) -> bool:
        """Return True for a person who keeps the tracker, and whom a doubtful detection does not show."""
        return self._one or person is self._locked

    def _is_trackable(self, one: Seen) -> bool:
        return is_trackable(one, self._config_of.config)


def _has_points(one: Seen) -> bool:
    return bool(np.count_nonzero(np.isfinite(one.points)))
