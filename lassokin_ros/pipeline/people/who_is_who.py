"""Who is who: which people of the roster are seen where in an image, and who is new.

In the images of each camera, place, size and number decide who continues whom (`image_tracks.py`). A person whom this
camera has not seen for a while is the one whose keypoints lie on the epipolar lines, if another camera sees the person
(`matching.py`), else the one who is near the expected place. Who is left is nobody known.

With one tracker, the rule `follow` chooses whom it follows, and another person is followed only under a new id, after
the first one has been absent for `forget_after`. With several trackers, each new person gets one who is seen in some
images. A locked person keeps the tracker, and is absent in doubt.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.pipeline.people.choice import GUESS_AFTER_S, number_named
from lassokin_ros.pipeline.people.image_tracks import (
    FARTHEST_GUARDED,
    RIVAL,
    RUNS_PER_S,
    SAME_BODY,
    ImageTrack,
    ImageTracks,
)
from lassokin_ros.pipeline.people.matching import (
    SAME_PERSON,
    assign,
    cross_view_cost,
    distance,
    distances,
    match_radius,
)
from lassokin_ros.pipeline.people.roster import Person, Roster
from lassokin_ros.pipeline.seen import Image, Seen, Sight
from lassokin_ros.pipeline.settings import LASTING

CONFIRMING_MESSAGES = 3
"""A person without a lasting number gets a tracker after this many detections; one message in between may miss them."""
DOUBTFUL = 2.0
"""A person who is seen first by one camera is not added, if the cost of being somebody whom only other cameras see is
below this times SAME_PERSON."""
WALKED = (0.0, 0.5, 1.0)
"""Shares of the time out of sight: a person whom no camera sees, as in a gap between two, walks on for one of these."""
LONGEST_STALL_S = 1.0
"""s: after a longer silence of the detector, who is found by place is a guess in any case."""
AT_ONCE_NS = 100_000_000
"""ns: images of several cameras within this time show the same people."""


class View:
    """What one camera sees: its newest image, and the tracks of all people in its images."""

    def __init__(self, image: Image, sure: bool) -> None:
        self.image = image
        self.tracks = ImageTracks(sure)

    @property
    def seen(self) -> list[ImageTrack]:
        """The tracks with a detection in the newest image."""
        return self.tracks.seen_at(self.image.stamp_ns)


class WhoIsWho:
    """Finds the people of a roster in images, and adds those who are new. views: by camera."""

    def __init__(self, roster: Roster) -> None:
        self._roster = roster
        self.views: dict[str, View] = {}
        self._left_ns: int | None = None  # last sight of a person without a number, after whom there was a new id

    def reset(self) -> None:
        """Forget all images."""
        self.views.clear()
        self._left_ns = None

    def people_in(self, image: Image, patience: float, found: Collection[Person]) -> dict[Person, Seen]:
        """Return the known people in an image, and those who are new. found: those in other images of the instant.

        patience: s, see `ImageTracks.update`.
        """
        name, stamp_ns = image.camera.name, image.stamp_ns
        view = self.views.get(name)
        if view is None:
            view = self.views[name] = View(image, self._roster.config.person_ids == LASTING)
        view.image = image
        if image.identified:
            return self._identified(view, found)
        if self._roster.one and not image.numbered and self._roster.locked is None:
            return self._only_one(view, patience)
        if view.tracks.hear(stamp_ns, [one.number for one in image.people], image.lasting):
            self._roster.numbers.renumbered = True
            if (locked := self._roster.held) is not None and (track := locked.tracks.get(name)) is not None:
                track.silent_s = track.unseen_s(stamp_ns)  # who stands still is found by place, guessed
        own = self._own_tracks(image)
        numbers = {track.number for track in own} if image.lasting else ()
        usable = [one for one in image.people if one.trackable]
        usable += [one for one in image.people if one.number in numbers and one not in usable and _has_points(one)]
        expected = {track: person.body.predicted_landmarks(stamp_ns, image.camera) for track, person in own.items()}
        guarded = [track for track, person in own.items() if self._roster.is_guarded(person)]
        placed = [track for track, person in own.items() if self._elsewhere(person, image) is not None]
        view.tracks.update(stamp_ns, usable, image.lasting, patience, expected, guarded, placed)
        for track, person in own.items():
            if track.seen_ns == stamp_ns and track.by_place:
                person.guessed |= self._may_be_another(view, person, track)
        self._link(view, patience)
        if self._roster.one:
            self._choose(view, patience)
        elif image.camera.known:
            self._add_strangers(view, found)
        return {
            p: t.detection
            for p in self._roster.people
            if (t := p.tracks.get(name)) is not None and t.seen_ns == stamp_ns
        }

    def _may_be_another(self, view: View, person: Person, track: ImageTrack) -> bool:
        """Return whether a person who is found by place may be somebody else.

        A locked person may not after a stall of the detector of up to LONGEST_STALL_S, if nobody else could have come
        there meanwhile, and may after each pause of the detections in which somebody could.
        """
        numbers, image = view.tracks.numbers, view.image
        away_s = min(track.gap_s, person.body.unseen_s(image.stamp_ns))
        if person is not self._roster.held or away_s > LONGEST_STALL_S:
            return away_s > GUESS_AFTER_S
        if not numbers.is_pause(away_s):
            return False
        rivals = view.tracks.rivals(track, away_s)
        if away_s <= GUESS_AFTER_S or rivals:
            return bool(rivals)
        stalled = numbers.gap_s >= away_s - 1e-3 and track.detection.pixels is not None
        return not stalled or _near_border(track.detection, image, RUNS_PER_S * away_s)

    def _identified(self, view: View, found: Collection[Person]) -> dict[Person, Seen]:
        """Return the people of an image whose numbers are their own. found: as in `_people_in`."""
        name, stamp_ns = view.image.camera.name, view.image.stamp_ns
        people = {person.number: person for person in self._roster.people}
        here: dict[Person, Seen] = {}
        for seen in view.image.people:
            person = people.get(seen.number)
            if person is None and seen.trackable:
                person = self._roster.add(seen.number, {*found, *here})
            if person is not None and _has_points(seen):
                person.tracks[name] = ImageTrack(seen, seen.points, stamp_ns, number=seen.number)
                here[person] = seen
        return here

    def _only_one(self, view: View, patience: float) -> dict[Person, Seen]:
        """Return the only person of a message without numbers, whoever it is.

        Somebody who comes after an absence may be another person, so the id is new.
        """
        (person,), (seen,), stamp_ns = self._roster.people, view.image.people, view.image.stamp_ns
        if not seen.trackable:
            return {}
        left_ns = person.body.seen_ns
        if left_ns not in (None, self._left_ns) and person.body.unseen_s(stamp_ns) > patience:
            self._roster.rename(person)
            self._left_ns = left_ns
        person.tracks[view.image.camera.name] = view.tracks.begin_alone(seen, stamp_ns)
        return {person: seen}

    def _own_tracks(self, image: Image) -> dict[ImageTrack, Person]:
        """Return the tracks of people in the images of a camera.

        A track ends that is older than GUESS_AFTER_S if other cameras see the person: they tell the place.
        """
        name, own = image.camera.name, {}
        for person in self._roster.people:
            track = person.tracks.get(name)
            if track is None:
                continue
            if track.unseen_s(image.stamp_ns) > GUESS_AFTER_S and self._elsewhere(person, image) is not None:
                del person.tracks[name]
            else:
                own[track] = person
        return own

    def _elsewhere(self, person: Person, image: Image) -> Sight | None:
        """Return the newest sight of a person by another camera, as it is expected at the image's stamp."""
        others = [
            (track, self.views[name].image)
            for name, track in person.tracks.items()
            if name != image.camera.name
            and self.views[name].image.camera.known
            and abs(image.stamp_ns - track.seen_ns) <= GUESS_AFTER_S * 1e9
        ]
        if not others:
            return None
        track, other = max(others, key=lambda pair: pair[0].seen_ns)
        seen = replace(track.detection, points=track.predicted(image.stamp_ns))
        return Sight(image.stamp_ns, seen, other.lens, other.camera)

    def _link(self, view: View, patience: float) -> None:
        """Give people who have no track in the images of a camera one that is nobody's: see the module's docstring."""
        image = view.image
        name = image.camera.name
        people = [person for person in self._roster.people if name not in person.tracks]
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
            if self._roster.is_guarded(person) and costs[row, column] > RIVAL * others.min(initial=np.inf):
                continue
            person.tracks[name] = tracks[column]
            person.guessed |= GUESS_AFTER_S < person.body.unseen_s(image.stamp_ns) < math.inf

    def _costs(self, person: Person, view: View, tracks: Sequence[ImageTrack], patience: float) -> np.ndarray:
        """Return the costs (t,) of tracks as those of a person who has none in this view; at most 1 for the person."""
        image, body = view.image, person.body
        elsewhere, unseen_s = self._elsewhere(person, image), body.unseen_s(image.stamp_ns)
        if elsewhere is not None:
            size = body.tracker.learned.size_check
            sights = [Sight(image.stamp_ns, track.detection, image.lens, image.camera) for track in tracks]
            return np.array([cross_view_cost(elsewhere, sight, size) for sight in sights]) / SAME_PERSON
        away = person.id in self._roster.out_of_view.ids
        if unseen_s > patience and not (away and person is self._roster.held):
            return np.full(len(tracks), np.inf)
        stopped = (body.predicted_landmarks(image.stamp_ns, image.camera, unseen_s * share) for share in WALKED)
        points = [one for one in stopped if one is not None]
        if not points:
            return np.full(len(tracks), np.inf)
        reach = match_radius(unseen_s)
        reach = min(reach, FARTHEST_GUARDED) if self._roster.is_guarded(person) and not away else reach
        return distances(np.stack(points), [track.detection for track in tracks], 0.0).min(axis=0) / reach

    def _nobodys(self, view: View) -> list[ImageTrack]:
        """Return the tracks in the newest image of a camera that are nobody's."""
        owned = [person.tracks.get(view.image.camera.name) for person in self._roster.people]
        return [track for track in view.seen if track not in owned]

    def _is_crowd(self, image: Image) -> bool:
        """Return True if a camera has seen several people lately: it is not known who is who in another image."""
        views = self.views.values()
        return any(len(v.seen) > 1 for v in views if abs(v.image.stamp_ns - image.stamp_ns) <= AT_ONCE_NS)

    def _choose(self, view: View, patience: float) -> None:
        """Follow the best person in the image, if nobody is followed yet, or if the followed person has left."""
        (person,), image = self._roster.people, view.image
        if self._roster.locked is not None or self._elsewhere(person, image) is not None:
            return
        track, body = person.tracks.get(image.camera.name), person.body
        here = track is not None and track.seen_ns == image.stamp_ns and track.detection.trackable
        if person.tracks and body.seen_ns is not None and (here or body.unseen_s(image.stamp_ns) <= patience):
            return
        candidates = [track for track in view.seen if track.detection.trackable]
        if (chosen := self.best(candidates, image)) is not None:
            self._roster.begin(person, chosen, image.camera.name)

    def best(self, tracks: Sequence[ImageTrack], image: Image) -> ImageTrack | None:
        """Return the track in an image that the rule `follow` prefers; None if there is none."""
        number = number_named(self._roster.config.follow)
        if number is not None:
            return next((track for track in tracks if image.lasting and track.detection.number == number), None)
        return tracks[self._roster.preferred(tracks, [image] * len(tracks))] if tracks else None

    def _add_strangers(self, view: View, found: Collection[Person]) -> None:
        """Give trackers to people in the newest image of a camera who have none.

        found: people in other images of the same instant.
        """
        image, nobodys = view.image, self._nobodys(view)
        known = [track for track in view.seen if track not in nobodys]
        numbers = view.tracks.numbers
        at_once = image.lasting and numbers.believed(image.stamp_ns) and not self._roster.config.several_cameras
        for track in nobodys:
            if (track.run < CONFIRMING_MESSAGES and not at_once) or not track.detection.trackable:
                continue
            if any(distance(other.points, track.detection, 0.0) <= SAME_BODY for other in known):
                continue  # a duplicate
            if self._is_near_anybody(track, image):
                continue
            here = [p for p in self._roster.people if p.tracks.get(image.camera.name) in known]
            if (person := self._roster.add_seen(track, at_once, {*found, *here})) is not None:
                person.tracks[image.camera.name] = track
                known.append(track)

    def _is_near_anybody(self, track: ImageTrack, image: Image) -> bool:
        """Return True if a stranger may be somebody whom only other cameras have seen."""
        stranger = Sight(image.stamp_ns, track.detection, image.lens, image.camera)
        for person in self._roster.people:
            if image.camera.name in person.tracks or (elsewhere := self._elsewhere(person, image)) is None:
                continue
            if cross_view_cost(elsewhere, stranger, person.body.tracker.learned.size_check) < DOUBTFUL * SAME_PERSON:
                return True
        return False


def _near_border(one: Seen, image: Image, reach: float) -> bool:
    """Return whether somebody could have come from beyond the left or right border. reach: of the person's sizes."""
    assert one.pixels is not None
    points = one.pixels[np.isfinite(one.pixels).all(axis=1)]
    far = reach * float(np.linalg.norm(np.ptp(points, axis=0)))
    return bool(points[:, 0].min() < far or points[:, 0].max() > image.lens.extent[0] - far)


def _has_points(one: Seen) -> bool:
    return bool(np.count_nonzero(np.isfinite(one.points)))
