"""The people who are tracked: their numbers, their trackers, and whom the lock holds.

Trackers are created at the start and reused. An id is not used again for another person.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.urdf import check_names
from lassokin_ros.pipeline.people.choice import NEAREST, preferred
from lassokin_ros.pipeline.people.image_tracks import ImageTrack
from lassokin_ros.pipeline.people.matching import is_trackable
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Image, Seen
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.skeleton_readers.load import load_skeleton, naming_help

GONE = "gone"
"""In place of the id of a locked person who was forgotten. No detection is assigned until unlock."""
REPLACEABLE_AFTER_S = 0.5
"""s: if all trackers are in use, a person absent for this long is removed for a new one."""


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


class Roster:
    """The people with a tracker, and the trackers that are free.

    Attributes
    ----------
    people: those who have a tracker; idle: the trackers without a person.
    listed: True if the detector's list says who is there, under which id.
    one: True if there is one tracker, and no list. It always has a person, and ids are those of whom it follows.
    locked: the person whom the lock holds; gone: True if that person was forgotten.
    newest_ns: stamp of the newest images.
    left: results of people who left, which waited for `smoothing_lag`.
    out_of_view: ids of people at whose place no camera has looked since, so that they may come into view elsewhere.
    renumbered: True if a number of the detector may be another person's than before.
    """

    def __init__(
        self, bodies: Sequence[TrackedPerson], counts: Counter[str], follow: str, listed: bool = False
    ) -> None:
        """counts: receives the numbers of people who come and leave. follow: see NodeSettings."""
        self.listed, self.one = listed, len(bodies) == 1 and not listed
        self.follow, self.counts = follow, counts
        self.idle = list(bodies)
        self.config_of = bodies[0].tracker  # all have the same settings
        self.people = [Person(1, self.idle.pop())] if self.one else []
        self.locked: Person | None = None
        self.gone, self.renumbered = False, False
        self.out_of_view: Collection[str] = ()
        self.newest_ns = 0
        self.left: list[FrameResult] = []
        self._next = 1
        self._made: set[int] = set()  # ids that are not the detector's numbers

    @property
    def locked_id(self) -> str | None:
        """Id of the locked person, or GONE; None if nobody is locked."""
        return GONE if self.gone else None if self.locked is None else self.locked.id

    def add(self, number: int, found: Collection[Person]) -> Person | None:
        """Assign a tracker to a new person. Return None, and count it, if none is free.

        found: people who are in the images, and stay. The new tracker adopts the direction of gravity from the others.
        If a tracker has this person's skeleton, it is that one; else one that has nobody's, if there is one.
        """
        if not self.idle:
            away = [one for one in self.people if one not in found and one is not self.locked]
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
        self._next = max(self._next, number + 1)
        self.counts["people come"] += 1
        return self.people[-1]

    def keep(self, ids: Sequence[str]) -> int:
        """Keep the people of the detector's list, and add those who are new. Return how many have no tracker."""
        for person in [person for person in self.people if person.id not in ids]:
            self.remove(person)
        self.left.clear()
        present, beyond = {person.id for person in self.people}, 0
        for name in [name for name in dict.fromkeys(ids) if name not in present]:
            if not self.idle:
                beyond += 1
                self.counts["people beyond max_people"] += 1
            elif (newcomer := self.add(self._next, ())) is not None:
                newcomer.name = name
        return beyond

    def remove(self, person: Person) -> None:
        """Take the tracker from a person. The results that wait for `smoothing_lag` are kept in `left`."""
        self.people.remove(person)
        self.left += person.body.flush()
        person.body.reset(same_camera=True)
        self.idle.append(person.body)
        self.counts["people left"] += 1

    def rename(self, person: Person) -> None:
        """Give the only person another id, if somebody was tracked under this one."""
        person.number += person.body.seen_ns is not None

    def new_number(self, track: ImageTrack, lasting: bool) -> int:
        """Return the number of the id of a new person: the detector's, unless it may have been another person's."""
        number, present = track.detection.number, [person.number for person in self.people]
        unused = number >= self._next or not (self.renumbered or number in self._made or number in present)
        if lasting and unused:
            return number
        self._made.add(self._next)
        return self._next

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
        if self.follow != NEAREST:
            return preferred(self.follow, [track.detection for track in tracks])
        mount = self.config_of.learned.vertical.mount
        ups = [image.camera.rotation @ mount for image in images]
        return preferred(self.follow, [track.detection for track in tracks], self.config_of.layout.names, ups)

    def is_guarded(self, person: Person) -> bool:
        """Return True for a person who keeps the tracker, and whom a doubtful detection does not show."""
        return self.one or person is self.locked

    def is_trackable(self, one: Seen) -> bool:
        """Return True for a detection with enough confident keypoints."""
        return is_trackable(one, self.config_of.config)


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
