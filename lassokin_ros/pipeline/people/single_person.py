"""Follow one person among all people in a message: choose the person once, and never exchange them silently.

Another person is followed only under a new id, after the first one has been absent for `forget_after`; and not at all
if the person is locked. In messages without person numbers everything is one person: it has a new id after such an
absence, and if the person is locked, it must be near the place where the person is expected. Of several cameras, the
one that sees the person first chooses; in the images of the others the person is the one whose keypoints lie on the
epipolar lines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from lassokin_ros.core.observation import HERE, Status
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.people.choice import (
    CONFIDENT,
    GUESS_AFTER_S,
    RULES,
    NoPersonError,
    nobody_to_lock,
    number_named,
    preferred,
)
from lassokin_ros.pipeline.people.cross_view import same_person
from lassokin_ros.pipeline.people.image_tracks import RIVAL, ImageTrack, ImageTracks
from lassokin_ros.pipeline.people.matching import is_trackable
from lassokin_ros.pipeline.people.people_tracker import GONE
from lassokin_ros.pipeline.people.presence import Presence, reported_status
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Image, Seen, Sight

PERSON_ABSENT = "person_absent"
"""Rejection of a message that contains people, but not the followed person."""


class SinglePersonTracker:
    """Implements PeopleTracker for one person.

    The tracks of all people in the image decide who is who; one of them is that of the followed person.
    """

    ids: list[str] | None = None

    def __init__(self, person: TrackedPerson, follow: str = CONFIDENT, lock: bool = False) -> None:
        """follow, lock: see NodeSettings."""
        self._person = person
        self._count = person.tracker.kinematics.landmark_count
        self._follow, self._lock_first = follow, lock
        self._number_of_person = 0
        self._left: list[FrameResult] = []  # results of the person before, which waited for smoothing_lag
        self._forget_identity()

    def _forget_identity(self) -> None:
        self._locked, self._guessed, self._lock_next = False, False, self._lock_first
        self._gone = False  # whether the locked person was forgotten
        self._views: dict[str, _View] = {}
        self._left_ns: int | None = None  # last sight of a person without a number, after whom there was a new id

    @property
    def tracked(self) -> dict[str, TrackedPerson]:
        """See PeopleTracker.tracked."""
        return {"": self._person}

    @property
    def status(self) -> Status:
        """See PeopleTracker.status."""
        return self._person.status

    @property
    def locked(self) -> str | None:
        """See PeopleTracker.locked."""
        return GONE if self._gone else self._id if self._locked else None

    @property
    def _id(self) -> str:
        return f"p{max(self._number_of_person, 1)}"

    def presence_at(self, stamp_ns: int, forget_after: float, stale_after: float = math.inf) -> Presence:
        """See PeopleTracker.presence_at."""
        return Presence(reported_status(self._person, stamp_ns, stale_after))

    def tracked_at(self, stamp_ns: int) -> bool:
        """See PeopleTracker.tracked_at."""
        return self._person.seen_ns == stamp_ns

    def flush(self) -> list[FrameResult]:
        """See PeopleTracker.flush."""
        left, self._left = self._left, []
        return left + self._person.flush()

    def reset(self, unlock: bool = True) -> None:
        """Forget the person. The next message chooses a person anew, under a new id; nobody if a lock stays."""
        gone = self._locked and not unlock
        if self._person.seen_ns is not None:
            self._number_of_person = max(self._number_of_person, 1) + 1
        self._person.reset()
        self._left.clear()
        self._forget_identity()
        if gone:
            self._locked, self._gone, self._lock_next = True, True, False

    def tune(self, follow: str, lock: bool) -> None:
        """See PeopleTracker.tune."""
        if lock != self._lock_first:
            self._lock_next = lock
        self._follow, self._lock_first = follow, lock

    def lock(self) -> str:
        """See PeopleTracker.lock."""
        view = self._view_to_lock()
        candidates = [t for t in view.tracks.seen_at(view.seen_ns) if self._is_trackable(t.detection)]
        tracked = self._person.status is Status.TRACKING and self._person.unseen_s(view.seen_ns) <= GUESS_AFTER_S
        if not (tracked and (self._follow == CONFIDENT or not candidates)):
            chosen = self._best(candidates, view.persistent)
            if chosen is None:
                raise NoPersonError(nobody_to_lock(self._follow, len(candidates)))
            if chosen is not view.followed:
                self._begin(chosen, view)
        self._lock_followed(view)
        self._guessed = False
        return self._id

    def _view_to_lock(self) -> _View:
        """Return the view with the newest sight of the followed person, else that of the newest image."""
        newest = max(self._views.values(), key=lambda view: view.seen_ns, default=_View())
        shown = [view for view in self._views.values() if newest.seen_ns - view.shown_ns <= GUESS_AFTER_S * 1e9]
        return max(shown, key=lambda view: view.shown_ns, default=newest)

    def _lock_followed(self, view: _View) -> None:
        """Lock the followed person. One without a number is known by place from now on."""
        self._locked, self._gone, self._lock_next = True, False, False
        if view.followed is None and view.unnumbered is not None:
            view.tracks.clear()
            view.tracks.update(view.unnumbered_ns, [view.unnumbered], False, math.inf)
            view.followed = view.tracks.tracks[0]

    def release(self) -> None:
        """See PeopleTracker.release."""
        self._locked = self._gone = self._lock_next = False

    def update(self, images: Sequence[Image], frame_id: str, forget_after: float) -> list[FrameResult]:
        """Track the followed person; see PeopleTracker.update. A refused message gives a result with the reason."""
        found = [(image, self._select(image, forget_after)) for image in images]
        if len(found) > 1:
            found = [(image, one) for image, one in found if self._is_followed(image, one)] or found
        sights = [Sight(image.stamp_ns, one, image.lens, image.camera) for image, one in found]
        number = self._number_at(max(image.stamp_ns for image in images))
        results = self._person.track(sights, frame_id, label=self._id, detector_id=number, guessed=self._guessed)
        rejected = results and not results[-1].accepted
        if rejected and (absence := self._absence(images[0], forget_after)):
            results[-1] = replace(results[-1], rejection=PERSON_ABSENT, detail=absence)
        if self._lock_next and any(self.tracked_at(image.stamp_ns) for image in images):
            self._lock_followed(self._view_to_lock())
        left, self._left = self._left, []
        return left + results

    def _select(self, image: Image, forget_after: float) -> Seen:
        """Return the detection of the followed person; an empty detection if the person is not in the message."""
        people, stamp_ns = image.people, image.stamp_ns
        if image.camera.name not in self._views:
            self._views[image.camera.name] = _View()
        view = self._views[image.camera.name]
        view.seen_ns, view.persistent = stamp_ns, image.lasting
        view.lens, view.camera = image.lens, image.camera
        patience = max(forget_after, self._person.tracker.config.lost_after)
        if not image.numbered:
            (one,) = people
            if self._is_trackable(one):
                view.unnumbered, view.unnumbered_ns = one, stamp_ns
            if not self._locked:
                view.followed = None
                self._count_absence(one, stamp_ns, patience)
                return one
        elif not people:
            return self._nobody(())
        else:
            view.unnumbered = None
        self._update_tracks(people, image, view, patience)
        followed = view.followed
        if followed is not None and followed.seen_ns == stamp_ns and followed.by_place:
            self._guessed = self._guessed or followed.gap_s > GUESS_AFTER_S
        if elsewhere := self._sight_elsewhere(view):
            if followed is None or self._person.seen_ns is None or followed.unseen_s(stamp_ns) > GUESS_AFTER_S:
                followed = view.followed = self._found_again(view, elsewhere)
        elif self._is_free(view, patience):
            followed = self._choose_anew(view)
        if followed is None:
            return self._nobody(people)
        if followed.seen_ns == stamp_ns:
            return followed.detection
        return self._nobody(() if image.lasting else people)

    def _number_at(self, stamp_ns: int) -> int:
        """Return the person's number in the messages of the first camera that has seen them lately; -1 without one."""
        since_ns = stamp_ns - GUESS_AFTER_S * 1e9
        lasting = [one.followed for one in self._views.values() if one.persistent and one.shown_ns >= since_ns]
        return next((track.detection.number for track in lasting if track is not None), -1)

    def _is_followed(self, image: Image, one: Seen) -> bool:
        """Return True if a detection in an image shows the followed person, and no bystander."""
        view = self._views[image.camera.name]
        shown = view.unnumbered if view.followed is None else view.followed.detection
        return one is shown and _has_points(one)

    def _count_absence(self, one: Seen, stamp_ns: int, patience: float) -> None:
        """Note that somebody without a number comes after an absence: it may be another person, so the id is new."""
        left_ns = self._person.seen_ns
        if left_ns is None or left_ns == self._left_ns or not self._is_trackable(one):
            return
        if self._person.unseen_s(stamp_ns) > patience:
            self._number_of_person, self._left_ns = max(self._number_of_person, 1) + 1, left_ns

    def _update_tracks(self, people: Sequence[Seen], image: Image, view: _View, patience: float) -> None:
        usable = [one for one in people if self._is_trackable(one)]
        if image.lasting and view.followed is not None:  # the followed person may be seen in part
            number = view.followed.detection.number
            usable += [one for one in people if one.number == number and one not in usable and _has_points(one)]
        expected = partial(self._person.predicted_landmarks, image.stamp_ns, image.camera)
        view.tracks.update(image.stamp_ns, usable, image.lasting, patience, view.followed, expected)

    def _sight_elsewhere(self, view: _View) -> Sight | None:
        """Return the newest sight of the followed person by another camera, as it is expected at the view's stamp."""
        others = [
            other
            for other in self._views.values()
            if other is not view
            and other.followed is not None
            and other.camera.known
            and abs(view.seen_ns - other.followed.seen_ns) <= GUESS_AFTER_S * 1e9
        ]
        newest = max(others, key=lambda other: other.followed.seen_ns if other.followed else 0, default=None)
        if newest is None or newest.followed is None:
            return None
        seen = replace(newest.followed.detection, points=newest.followed.predicted(view.seen_ns))
        return newest.sight(seen)

    def _found_again(self, view: _View, elsewhere: Sight) -> ImageTrack | None:
        """Return the track of the person whom another camera sees; None if there is none, or in doubt.

        In the image of a camera whose place is not known yet, it is the only one.
        """
        tracks = view.tracks.seen_at(view.seen_ns)
        if not view.camera.known:
            return tracks[0] if len(tracks) == 1 else None
        candidates = [view.sight(track.detection) for track in tracks]
        found = same_person(elsewhere, candidates, self._person.tracker.learned.size_check, RIVAL)
        return None if found is None else tracks[candidates.index(found)]

    def _is_free(self, view: _View, patience: float) -> bool:
        """Return True if another person may be followed: nobody is yet, or the followed person has left."""
        if self._locked:
            return False
        if self._person.seen_ns is None or all(one.followed is None for one in self._views.values()):
            return True
        followed, stamp_ns = view.followed, view.seen_ns
        absent = followed is None or followed.seen_ns != stamp_ns or not self._is_trackable(followed.detection)
        return absent and self._person.unseen_s(stamp_ns) > patience

    def _choose_anew(self, view: _View) -> ImageTrack | None:
        """Follow the best person in the image. Return the track, None if nobody can be tracked."""
        tracks = [t for t in view.tracks.seen_at(view.seen_ns) if self._is_trackable(t.detection)]
        chosen = self._best(tracks, view.persistent)
        if chosen is not None and chosen is not view.followed:
            self._begin(chosen, view)
        return chosen

    def _begin(self, track: ImageTrack | None, view: _View) -> None:
        """Follow another person, under a new id. The images of other cameras will show who it is there."""
        for other in self._views.values():
            other.followed = None
        view.followed, self._guessed = track, False
        if self._person.seen_ns is not None:
            self._left += self._person.flush()
            self._person.reset(same_camera=True)
            self._number_of_person = max(self._number_of_person, 1) + 1

    def _best(self, tracks: Sequence[ImageTrack], persistent: bool) -> ImageTrack | None:
        """Return the track that the rule `follow` prefers; None if there is none."""
        number = number_named(self._follow)
        if number is not None:
            lasting = tracks if persistent else ()
            return next((track for track in lasting if track.detection.number == number), None)
        return tracks[preferred(self._follow, [track.detection for track in tracks])] if tracks else None

    def _nobody(self, people: Sequence[Seen]) -> Seen:
        """Return the detection with the most points of those who cannot be tracked, so that the reason is reported."""
        untrackable = [one for one in people if not self._is_trackable(one)]
        if untrackable:
            return untrackable[preferred(CONFIDENT, untrackable)]
        nowhere = np.full((self._count, 2), np.nan)
        return Seen(nowhere, np.zeros(self._count), pixels=nowhere)

    def _absence(self, image: Image, forget_after: float) -> str:
        """Return the explanation for a message that shows other people only; empty if that is not the case.

        Without it the message would be refused for too few landmarks. This reason would be misleading, because it
        suggests that the detector's confidences are too low.
        """
        view = self._views[image.camera.name]
        followed, named = view.followed, number_named(self._follow)
        chosen = self._gone or any(one.followed is not None for one in self._views.values())
        unfound = not chosen and named is not None and bool(view.tracks.seen_at(image.stamp_ns))
        if followed is None and not (self._gone or unfound):
            return ""
        if followed is not None and followed.seen_ns == image.stamp_ns:
            return ""
        if not image.lasting and not view.tracks.seen_at(image.stamp_ns):
            return ""  # those who are shown in part may be the followed person
        config = self._person.tracker.config
        limit = max(config.min_confidence, 1e-9)
        others = sum(bool(np.count_nonzero(one.confidence >= limit)) for one in image.people)
        if not others:
            return ""
        if unfound:
            lasting = "" if image.lasting else ", and the numbers of its people do not last"
            return (
                f"follow is '{self._follow}', and no person of this number is among the {others} in the message"
                f"{lasting}; nobody else is followed: set follow to {', '.join(RULES)}, or to a lasting number"
            )
        if followed is None:
            return (
                "the person who was locked is not known any more, because height, camera or time have changed; "
                f"nobody among the {others} in the message is followed until ~/lock is called; in a recorded run set "
                "lock to false"
            )
        number = followed.detection.number
        who = f"person {number} is not" if image.lasting else "nobody is near the predicted position"
        another = "another person" if named is None else f"nobody but person {named}, whom follow names,"
        waits = f"{another} is followed after forget_after {forget_after:g} s"
        if self._locked:
            waits = "the person is locked, until ~/lock is called with false"
        return (
            f"one person is followed, and {who} among the {others} in the message; {waits} (see person_ids, max_people)"
        )

    def _is_trackable(self, one: Seen) -> bool:
        return is_trackable(one, self._person.tracker.config)


class _View:
    """What one camera sees: the tracks of all people, which of them is the followed person's, and the last image."""

    def __init__(self) -> None:
        self.tracks = ImageTracks()
        self.followed: ImageTrack | None = None
        self.unnumbered: Seen | None = None  # the last one who could be tracked, if messages have no numbers
        self.seen_ns, self.unnumbered_ns, self.persistent = 0, 0, False
        self.lens: Lens | None = None
        self.camera = HERE

    @property
    def shown_ns(self) -> float:
        """Stamp of the newest image that shows the followed person, ns; -inf if there is none."""
        if self.followed is not None:
            return self.followed.seen_ns
        return -math.inf if self.unnumbered is None else self.unnumbered_ns

    def sight(self, seen: Seen) -> Sight:
        """Return a detection as one of the last image."""
        assert self.lens is not None
        return Sight(self.seen_ns, seen, self.lens, self.camera)


def _has_points(one: Seen) -> bool:
    return bool(np.count_nonzero(np.isfinite(one.points)))
