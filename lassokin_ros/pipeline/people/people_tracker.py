"""The people in the images of one or several cameras: who they are, whom the lock holds, and their results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

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
from lassokin_ros.pipeline.people.roster import Person, Roster
from lassokin_ros.pipeline.people.who_is_who import View, WhoIsWho
from lassokin_ros.pipeline.seen import Image, Seen, Sight

FORGOTTEN = "the locked person was forgotten: nobody is followed until ~/lock is called"
"""What GONE in place of a locked person's id means, in words."""
PERSON_ABSENT = "person_absent"
"""Rejection of a message that contains people, but not the followed person."""
MOST_REINITIALISED = 4
"""Lost people re-initialised per message; the others wait for the next message. Initialisation takes 7 to 50
times as long as a step. If many people were initialised at once, a slow machine would be busy for longer than
`lost_after`, and they would be lost again."""


class PeopleTracker:
    """Assigns the people in each image to trackers, which are created at the start and reused. Stamps are ns."""

    def __init__(self, roster: Roster) -> None:
        """roster: who can be tracked, and the settings."""
        self.roster = roster
        self._who = WhoIsWho(roster)
        nowhere = np.full((roster.tracker.kinematics.landmark_count, 2), np.nan)
        self._nothing = Seen(nowhere, np.zeros(len(nowhere)), pixels=nowhere)

    @property
    def jumped_number(self) -> int | None:
        """A number of a detector that has moved to another person lately, so that its numbers are not used."""
        jumped = [view.tracks.numbers.jumped for view in self._who.views.values() if view.image.lasting]
        return next((number for number in jumped if number is not None), None)

    @property
    def numbers_may_be_indices(self) -> bool:
        """Whether people are guessed, and a detector's numbers have only been 0, 1, ... or 1, 2, ... in each image."""
        unproven = any(view.image.lasting and not view.tracks.numbers.proven for view in self._who.views.values())
        return unproven and any(person.guessed for person in self.roster.people)

    def reset(self, unlock: bool = True, same_person: bool = False) -> None:
        """Forget all people. Ids are not used again, so that nobody inherits the id of another person.

        unlock: whether a lock ends too; otherwise it stays, on nobody (`GONE`). same_person: keep what was learned of
        the only person, who is seen from elsewhere.
        """
        self.roster.reset(unlock, same_person)
        self._who.reset()

    def lock(self) -> str:
        """Lock the person whom the setting `follow` names in the newest image, and return the id.

        Raises NoPersonError if there is nobody.
        """
        person = self._chosen_of_one() if self.roster.one else self._chosen_of_several()
        self.roster.hold(person)
        person.guessed = False
        return person.id

    def _chosen_of_several(self) -> Person:
        """Return the person whom `follow` names among those who have trackers and were seen lately."""
        follow, newest_ns = self.roster.config.follow, self.roster.newest_ns
        there = [one for one in self.roster.people if one.tracks and one.body.unseen_s(newest_ns) <= GUESS_AFTER_S]
        number = number_named(follow)
        if number is None and there:
            tracks = [track for one in there if (track := one.newest) is not None]
            images = [view.image for track in tracks for view in self._who.views.values() if track in view.tracks]
            return there[self.roster.preferred(tracks, images)]
        if (found := next((one for one in there if one.number == number), None)) is None:
            raise NoPersonError(nobody_to_lock(follow, len(there)))
        return found

    def _chosen_of_one(self) -> Person:
        """Return the only person with a tracker, who is from now on the one whom `follow` names in the image."""
        (person,) = self.roster.people
        view = self._view_to_lock(person)
        candidates = [] if view is None else [track for track in view.seen if track.detection.trackable]
        newest_ns = 0 if view is None else view.image.stamp_ns
        tracked = person.body.status is Status.TRACKING and person.body.unseen_s(newest_ns) <= GUESS_AFTER_S
        if not (tracked and (self.roster.config.follow == CONFIDENT or not candidates)):
            chosen = None if view is None else self._who.best(candidates, view.image)
            if chosen is None or view is None:
                raise NoPersonError(nobody_to_lock(self.roster.config.follow, len(candidates)))
            self.roster.begin(person, chosen, view.image.camera.name)
        return person

    def _view_to_lock(self, person: Person) -> View | None:
        """Return the view with the newest sight of the person, else that of the newest image."""
        newest = max(self._who.views.values(), key=lambda view: view.image.stamp_ns, default=None)
        if newest is None:
            return None
        since_ns = newest.image.stamp_ns - GUESS_AFTER_S * 1e9
        shown = {name: track.seen_ns for name, track in person.tracks.items() if track.seen_ns >= since_ns}
        return self._who.views[max(shown, key=lambda name: shown[name])] if shown else newest

    def update(self, images: Sequence[Image], frame_id: str) -> list[FrameResult]:
        """Track the people in one image, or in those of several cameras at one instant.

        frame_id: of the results. If one person is followed, a refused message gives a result with the reason; of
        several people accepted results only are returned, and rejections are counted.
        """
        if self.roster.listed:
            return self._of_body(images[0], frame_id)
        stamp_ns = self.roster.newest_ns = max(image.stamp_ns for image in images)
        forget_after = self.roster.config.forget_after
        for person in list(self.roster.people):
            if not self.roster.is_guarded(person) and person.body.unseen_s(stamp_ns) > forget_after:
                self.roster.remove(person)
        patience = max(forget_after, self.roster.tracker.config.lost_after)
        sights: dict[Person, list[Sight]] = {}
        for image in images:
            for person, seen in self._who.people_in(image, patience, sights).items():
                sights.setdefault(person, []).append(Sight(image.stamp_ns, seen, image.lens, image.camera))
        results = self._track(images, frame_id, sights)
        if self.roster.lock_next and any(self.roster.tracked_at(image.stamp_ns) for image in images):
            with suppress(NoPersonError):  # wait for the next image
                if self.roster.one:
                    self.roster.hold(self.roster.people[0])
                else:
                    self.lock()
        left, self.roster.left = self.roster.left, []
        return left + results

    def _of_body(self, image: Image, frame_id: str) -> list[FrameResult]:
        """The results of an image of one person of the detector's list. A refused one gives one with the reason."""
        self.roster.newest_ns = image.stamp_ns
        sight = Sight(image.stamp_ns, [*image.people, self._nothing][0], image.lens, image.camera)
        people = [person for person in self.roster.people if person.id == image.body]
        return people[0].body.track([sight], frame_id, image.body) if people else []

    def _track(self, images: Sequence[Image], frame_id: str, sights: Mapping[Person, list[Sight]]) -> list[FrameResult]:
        """Return the results of all people at one instant."""
        lost = [one for one in self.roster.people if one.body.status_at(self.roster.newest_ns) is Status.LOST]
        results: list[FrameResult] = []
        errors: list[Exception] = []
        found = 0
        for person in list(self.roster.people):
            seen = sights.get(person) if person not in lost or found < MOST_REINITIALISED else None
            try:
                if self.roster.one:
                    results += self._results_of_one(images, frame_id, seen)
                else:
                    results += self._results_of(person, images[0], frame_id, seen)
            except Exception as error:  # the others are tracked all the same
                errors.append(error)
            found += seen is not None and person in lost and person.body.status is Status.TRACKING
        if errors:
            raise errors[0]
        return results

    def _results_of(
        self, person: Person, image: Image, frame_id: str, seen: Sequence[Sight] | None
    ) -> list[FrameResult]:
        """The accepted results of one of several people; rejections are counted. seen: None if not in the images."""
        if seen is None:
            nothing = Sight(self.roster.newest_ns, self._nothing, image.lens, image.camera)
            return person.body.mark_absent(nothing) if image.camera.known else []
        number = self._detectors_number(person)
        answers = person.body.track(seen, frame_id, person.id, detector_id=number, guessed=person.guessed)
        refused = [result for result in answers if not result.accepted]
        for result in refused if any(sight.camera.known for sight in seen) else ():
            late = result.rejection == Rejection.LATE.value
            self.roster.counts[LATE if late else f"rejected: {result.rejection} (a person)"] += 1
        if refused and person.body.seen_ns is None:  # never tracked: there is no state to keep
            self.roster.remove(person)
        return [result for result in answers if result.accepted]

    def _results_of_one(
        self, images: Sequence[Image], frame_id: str, seen: Sequence[Sight] | None
    ) -> list[FrameResult]:
        """The results of the only person. A refused message gives one with the reason. seen: None if not in the images.

        Without sights of the person those are used who cannot be tracked, so that the reason is reported.
        """
        (person,) = self.roster.people
        seen = seen or [Sight(i.stamp_ns, self._untrackable(i), i.lens, i.camera) for i in images]
        number, guessed = self._detectors_number(person), person.guessed
        results = person.body.track(seen, frame_id, label=person.id, detector_id=number, guessed=guessed)
        if results and not results[-1].accepted and (absence := self._absence(images[0])):
            results[-1] = replace(results[-1], rejection=PERSON_ABSENT, detail=absence)
        return results

    def _detectors_number(self, person: Person) -> int:
        """Return the number of a person in the images of the first camera that has seen them lately; -1 without one."""
        since_ns = self.roster.newest_ns - GUESS_AFTER_S * 1e9
        for name, view in self._who.views.items():
            track = person.tracks.get(name)
            if track is not None and view.image.lasting and track.seen_ns >= since_ns:
                return track.detection.number
        return -1

    def _untrackable(self, image: Image) -> Seen:
        """Return the person with the most points of those who cannot be tracked; nobody without one."""
        known = image.lasting and image.camera.name in self.roster.people[0].tracks
        people = [] if known else [one for one in image.people if not one.trackable]
        return people[preferred(CONFIDENT, people)] if people else self._nothing

    def _absence(self, image: Image) -> str:
        """Return the explanation for a message that shows other people only; empty if that is not the case.

        Without it the message would be refused for too few landmarks. This reason would be misleading, because it
        suggests that the detector's confidences are too low.
        """
        (person,), view = self.roster.people, self._who.views[image.camera.name]
        named = number_named(self.roster.config.follow)
        track = person.tracks.get(image.camera.name)
        unfound = not (self.roster.gone or person.tracks) and named is not None and bool(view.seen)
        if track is None and not (self.roster.gone or unfound):
            return ""
        if track is not None and track.seen_ns == image.stamp_ns:
            return ""
        if not image.lasting and not view.seen:
            return ""  # those who are shown in part may be the followed person
        limit = max(self.roster.tracker.config.min_confidence, 1e-9)
        others = sum(bool(np.count_nonzero(one.confidence >= limit)) for one in image.people)
        if not others:
            return ""
        if unfound:
            lasting = "" if image.lasting else ", and the numbers of its people do not last"
            return (
                f"follow is '{self.roster.config.follow}', and no person of this number is among the {others} in the "
                f"message{lasting}; nobody else is followed: set follow to {', '.join(RULES)}, or to a lasting number"
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
        waits = f"{another} is followed after forget_after {self.roster.config.forget_after:g} s"
        if self.roster.held is not None:
            waits = "the person is locked, until ~/lock is called with false"
        return (
            f"one person is followed, and {who} among the {others} in the message; {waits} (see person_ids, max_people)"
        )
