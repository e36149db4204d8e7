"""The people who are tracked: their ids, their trackers, whom the lock holds, and what was learned of them.

Trackers are created at the start and reused. An id is not used again for another person.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.core.learned.bone_lengths import Calibration
from lassokin_ros.core.learned.extrinsics import Extrinsics
from lassokin_ros.core.learned.height import HeightEstimator
from lassokin_ros.core.observation import Status
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.urdf import check_names
from lassokin_ros.pipeline.people.choice import NEAREST, preferred
from lassokin_ros.pipeline.people.image_tracks import ImageTrack
from lassokin_ros.pipeline.people.out_of_view import OutOfView
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Image
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.skeleton_readers.load import load_skeleton, naming_help

GONE = "gone"
"""In place of the id of a locked person who was forgotten. No detection is assigned until unlock."""
REPLACEABLE_AFTER_S = 0.5
"""s: if all trackers are in use, a person absent for this long is removed for a new one."""


@dataclass(frozen=True)
class Presence:
    """Tracking status and the ids of the people present at a time.

    With several people, `status` is the best status among them. `ids` is None if one person is followed.
    """

    status: Status
    ids: list[str] | None = None


@dataclass(eq=False)
class Person:
    """A person with a tracker. number: of the id; name: in place of it; tracks: in the images of each camera.

    guessed: found again by place after an absence, so that it may be somebody else.
    """

    number: int
    body: TrackedPerson
    tracks: dict[str, ImageTrack] = field(default_factory=dict)
    guessed: bool = False
    name: str = ""

    @property
    def id(self) -> str:
        """The id. It is part of topic names, which must not begin with a digit."""
        return self.name or f"p{self.number}"

    @property
    def newest(self) -> ImageTrack | None:
        """The track with the newest detection; of equals that of the first camera."""
        return max(self.tracks.values(), key=lambda track: track.seen_ns, default=None)


@dataclass
class _Numbers:
    """The numbers of new people's ids. made: those that are not the detector's. renumbered: see Roster."""

    next: int = 1
    made: set[int] = field(default_factory=set)
    renumbered: bool = False

    def new(self, number: int, lasting: bool, present: Collection[int]) -> int:
        """Return the detector's number for a new person, unless it may have been another person's."""
        unused = number >= self.next or not (self.renumbered or number in self.made or number in present)
        if lasting and unused:
            return number
        self.made.add(self.next)
        return self.next


class Roster:
    """The people with a tracker, and the trackers that are free.

    Attributes
    ----------
    bodies: all trackers; idle: those without a person; people: the others.
    listed: True if the detector's list says who is there, under which id.
    one: True if there is one tracker, and no list. It always has a person, and ids are those of whom it follows.
    tracker: that of the first body; all have the same settings.
    held: the person whom the lock holds; gone: True if that person was forgotten; lock_next: whether the next person
        who is tracked is locked.
    numbers: of the next ids; its `renumbered` tells that a detector's number may be another person's than before.
    newest_ns: stamp of the newest images.
    left: results of people who left, which waited for `smoothing_lag`.
    out_of_view: those at whose place no camera has looked since, so that they may come into view elsewhere.
    """

    def __init__(
        self, bodies: Sequence[TrackedPerson], counts: Counter[str], config: NodeSettings = NodeSettings()
    ) -> None:
        """counts: receives the numbers of people who come and leave, and the rejections of single people."""
        self.config, self.counts = config, counts
        self.listed = self.config.topic_per_body
        self.one = len(bodies) == 1 and not self.listed
        self.bodies, self.idle, self.tracker = list(bodies), list(bodies), bodies[0].tracker
        self.people = [Person(1, self.idle.pop())] if self.one else []
        self.held: Person | None = None
        self.gone, self.lock_next = False, self.config.lock and not self.listed
        self.numbers = _Numbers()
        self.out_of_view = OutOfView(np.array([0.0, 0.0, 1.0] if self.config.fixed_frame else [0.0, -1.0, 0.0]))
        self.newest_ns = 0
        self.left: list[FrameResult] = []
        self._beyond = 0  # bodies of the list without a tracker

    @property
    def ids(self) -> list[str] | None:
        """Ids of the people who are present or absent for a short while; None if one person is followed."""
        return None if self.one else [person.id for person in self.people]

    @property
    def locked(self) -> str | None:
        """Id of the locked person, or GONE; None if nobody is locked."""
        return GONE if self.gone else None if self.held is None else self.held.id

    @property
    def status(self) -> Status:
        """Tracking status. With several people, the best status among them."""
        return best(person.body.status for person in self.people)

    @property
    def trackers(self) -> dict[str, Tracker]:
        """The tracker of each person by id. The id of a single person is empty."""
        return {"" if self.one else person.id: person.body.tracker for person in self.people}

    def calibrations(self) -> dict[str, Calibration]:
        """Return the calibration of each person's lengths by id."""
        return {person: tracker.learned.lengths for person, tracker in self.trackers.items()}

    def heights(self) -> dict[str, HeightEstimator]:
        """Return each person's measured height by id, none if the height is given."""
        found = {person: tracker.learned.height for person, tracker in self.trackers.items()}
        return {person: height for person, height in found.items() if height is not None}

    @property
    def extrinsics(self) -> Extrinsics | None:
        """What is learned about the cameras' poses, from the person whom several have seen for the longest time."""
        found = [tracker.learned.extrinsics for tracker in self.trackers.values()]
        return max(found, key=lambda one: one.frame_count, default=None)

    @property
    def evidence_faults(self) -> dict[str, str]:
        """What was wrong with the user's evidence that is left out, by name."""
        return {name: fault for one in self.bodies for name, fault in one.tracker.frame_model.faults.items()}

    def tune(self, config: NodeSettings) -> None:
        """Apply settings that can change while running."""
        if config.lock != self.config.lock:
            self.lock_next = config.lock and not self.listed
        self.config = config

    def hold(self, person: Person | None) -> None:
        """Lock a person, or nobody."""
        self.held, self.gone, self.lock_next = person, False, False

    def presence_at(self, stamp_ns: int, stale_after: float = math.inf) -> Presence:
        """Return the presence at a time up to which no message has arrived. The state does not change.

        stale_after: s, upper limit of `lost_after`.
        """
        stay, forget_after = self.one or self.listed, self.config.forget_after
        there = [one for one in self.people if stay or one.body.unseen_s(stamp_ns) <= forget_after]
        statuses = {one: one.body.status_at(stamp_ns, stale_after) for one in there}
        status = best(statuses.values())
        if self.gone and not self.one:
            status = Status.LOST
        elif self.held is not None:
            status = Status.LOST if self.held.guessed else statuses.get(self.held, Status.LOST)
        return Presence(status, None if self.one else [one.id for one in there])

    def tracked_at(self, stamp_ns: int) -> bool:
        """Return True if the message of this stamp updated a track."""
        return any(person.body.seen_ns == stamp_ns for person in self.people)

    def tracked_lately(self, stamp_ns: int) -> bool:
        """Return True if somebody was tracked within `lost_after`."""
        return any(person.body.unseen_s(stamp_ns) <= self.tracker.config.lost_after for person in self.people)

    @property
    def untracked_of_list(self) -> int:
        """Number of people of the detector's list who were never tracked."""
        return self._beyond + sum(person.body.status is Status.SEARCHING for person in self.people)

    def add(self, number: int, found: Collection[Person]) -> Person | None:
        """Assign a tracker to a new person. Return None, and count it, if none is free.

        found: people who are in the images, and stay. The new tracker adopts the direction of gravity from the others.
        If a tracker has this person's skeleton, it is that one; else one that has nobody's, if there is one.
        """
        if not self.idle:
            away = [one for one in self.people if one not in found and one is not self.held]
            longest = max(away, key=lambda one: one.body.unseen_s(self.newest_ns), default=None)
            if longest is None or longest.body.unseen_s(self.newest_ns) < REPLACEABLE_AFTER_S:
                self.counts["people beyond max_people"] += 1
                return None
            self.remove(longest)
        own = [body for body in self.idle if body.number == number]
        nobodys = [body for body in self.idle if body.number is None]
        newcomer = (self.idle[-1:] + nobodys + own)[-1]
        present = [person.body for person in self.people]
        for known in self.idle, present:  # present people override those who left
            newcomer.tracker.learned.vertical.adopt(body.tracker.learned.vertical for body in known)
        self.idle.remove(newcomer)
        self.people.append(Person(number, newcomer))
        self.numbers.next = max(self.numbers.next, number + 1)
        self.counts["people come"] += 1
        return self.people[-1]

    def add_seen(self, track: ImageTrack, lasting: bool, found: Collection[Person]) -> Person | None:
        """Add a new person with a track in an image, see `add`. lasting: the detector's number is the person's."""
        present = [person.number for person in self.people]
        return self.add(self.numbers.new(track.detection.number, lasting, present), found)

    def keep(self, ids: Sequence[str]) -> None:
        """Set who is present by the detector's list. The others are forgotten. Of too many the first ones are kept."""
        for person in [person for person in self.people if person.id not in ids]:
            self.remove(person)
        self.left.clear()
        present, self._beyond = {person.id for person in self.people}, 0
        for name in [name for name in dict.fromkeys(ids) if name not in present]:
            if not self.idle:
                self._beyond += 1
                self.counts["people beyond max_people"] += 1
            elif (newcomer := self.add(self.numbers.next, ())) is not None:
                newcomer.name = name

    def remove(self, person: Person) -> None:
        """Take the tracker from a person. The results that wait for `smoothing_lag` are kept in `left`."""
        self.people.remove(person)
        self.left += person.body.flush()
        person.body.reset(same_camera=True)
        self.idle.append(person.body)
        self.counts["people left"] += 1

    def reset(self, unlock: bool, same_person: bool) -> None:
        """Forget all people, see `PeopleTracker.reset`."""
        self.gone = self.locked is not None and not unlock
        self.held, self.lock_next = None, self.config.lock and not self.listed and not self.gone
        for person in list(self.people):
            if self.one or self.listed:
                self.rename(person)
                person.tracks, person.guessed = {}, False
                if same_person:
                    person.body.begin_take()
                else:
                    person.body.reset()
            else:
                self.remove(person)
        for body in self.idle:
            body.reset()
        self.left.clear()

    def rename(self, person: Person) -> None:
        """Give the only person another id, if somebody was tracked under this one."""
        person.number += person.body.seen_ns is not None

    def begin(self, person: Person, track: ImageTrack, camera: str) -> None:
        """Follow another person under a new id. The images of other cameras will show who it is there."""
        if track is person.tracks.get(camera):
            return
        self.rename(person)
        person.tracks, person.guessed = {camera: track}, False
        if person.body.seen_ns is not None:
            self.left += person.body.flush()
            person.body.reset(same_camera=True)

    def preferred(self, tracks: Sequence[ImageTrack], images: Sequence[Image]) -> int:
        """Return the index of the track that the rule `follow` prefers. images: one for each track, of its camera."""
        follow, detections = self.config.follow, [track.detection for track in tracks]
        if follow != NEAREST:
            return preferred(follow, detections)
        mount = self.tracker.learned.vertical.mount
        ups = [image.camera.rotation @ mount for image in images]
        return preferred(follow, detections, self.tracker.layout.names, ups)

    def is_guarded(self, person: Person) -> bool:
        """Return True for a person who keeps the tracker, and whom a doubtful detection does not show."""
        return self.one or person is self.held

    def flush(self) -> list[FrameResult]:
        """Return the results that wait for `smoothing_lag`. No message follows."""
        left, self.left = self.left, []
        return [*left, *(result for person in self.people for result in person.body.flush())]


def best(statuses: Iterable[Status]) -> Status:
    """Return the best of several statuses: TRACKING, then LOST, then SEARCHING."""
    present = set(statuses)
    return next((status for status in (Status.TRACKING, Status.LOST) if status in present), Status.SEARCHING)


def people_to_track(
    config: TrackerConfig, node: NodeSettings, evidence: Sequence[Evidence], bodies: Mapping[int | None, Skeleton]
) -> list[TrackedPerson]:
    """Return the people of `bodies`, and others up to max_people; see `Session`. Raises a LassokinError."""
    skeleton = load_skeleton(config.checked().skeleton, config.assumed_height)
    check_names(skeleton)
    up = np.array([0.0, 0.0, 1.0]) if node.fixed_frame else None
    with naming_help(config.skeleton):
        own = [
            TrackedPerson(replace(config, height=float(body.height)), body, evidence, up, number)
            for number, body in bodies.items()
        ]
        others = range(node.max_people - len(own))
        return [*own, *(TrackedPerson(config, skeleton, evidence, up) for _ in others)]
