"""Follow one person among all people in a message: choose the person once, and never exchange them silently.

Another person is followed only under a new id, after the first one has been absent for `forget_after`; and not at all
if the person is locked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.detections import detection, detections_by_person
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.people.choice import (
    CONFIDENT,
    GUESS_AFTER_S,
    SCORES,
    NoPersonError,
    nobody_to_lock,
    number_named,
)
from lassokin_ros.pipeline.people.image_tracks import ImageTrack, ImageTracks
from lassokin_ros.pipeline.people.matching import is_trackable
from lassokin_ros.pipeline.people.people_tracker import PeopleImage
from lassokin_ros.pipeline.people.presence import Presence, reported_status
from lassokin_ros.pipeline.people.tracked_person import Detection, TrackedPerson

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
        self._follow, self._lock_first, self._persistent = follow, lock, False
        self._tracks = ImageTracks()
        self._number_of_person = 0
        self._forget_identity()

    def _forget_identity(self) -> None:
        self._followed: ImageTrack | None = None
        self._newest_ns: int | None = None
        self._locked, self._guessed, self._lock_next = False, False, self._lock_first
        self._tracks.clear()

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
        return self._id if self._locked else None

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
        return self._person.flush()

    def reset(self) -> None:
        """Forget the person. The next message chooses a person anew."""
        self._person.reset()
        self._forget_identity()

    def tune(self, follow: str, lock: bool) -> None:
        """See PeopleTracker.tune."""
        if lock != self._lock_first:
            self._lock_next = lock
        self._follow, self._lock_first = follow, lock

    def lock(self) -> str:
        """See PeopleTracker.lock."""
        present = [] if self._newest_ns is None else self._tracks.seen_at(self._newest_ns)
        candidates = [track for track in present if self._is_trackable(track.detection)]
        tracked = self._person.status is Status.TRACKING and self._person.seen_ns == self._newest_ns
        if tracked and (self._follow == CONFIDENT or not candidates):
            chosen = self._followed
        else:
            chosen = self._best(candidates)
            if chosen is None:
                raise NoPersonError(nobody_to_lock(self._follow, len(candidates)))
        if chosen is not self._followed:
            self._begin(chosen)
        self._locked, self._guessed, self._lock_next = True, False, False
        return self._id

    def release(self) -> None:
        """See PeopleTracker.release."""
        self._locked = self._lock_next = False

    def update(self, image: PeopleImage, forget_after: float) -> list[FrameResult]:
        """Track the followed person; see PeopleTracker.update. A refused message gives a result with the reason."""
        found = self._select(image, forget_after)
        results = self._person.track(image.stamp_ns, image.frame_id, found, image.lens)
        number = found.number if image.persistent else -1
        results = [replace(one, label=self._id, detector_id=number, guessed=self._guessed) for one in results]
        rejected = any(not result.accepted for result in results)
        if rejected and (absence := self._absence(image, forget_after)):
            results[-1] = replace(results[-1], rejection=PERSON_ABSENT, detail=absence)
        if self._lock_next and self.tracked_at(image.stamp_ns):
            self._locked, self._lock_next = True, False
        return results

    def _select(self, image: PeopleImage, forget_after: float) -> Detection:
        """Return the detection of the followed person; an empty detection if the person is not in the message."""
        keypoints, stamp_ns = image.keypoints, image.stamp_ns
        self._newest_ns, self._persistent = stamp_ns, image.persistent
        if keypoints.persons is None or len(keypoints.persons) == 0:
            return detection(keypoints, None, self._count, image.lens)
        people = detections_by_person(keypoints, self._count, image.lens)
        patience = max(forget_after, self._person.tracker.config.lost_after)
        self._update_tracks(people, image, patience)
        followed = self._followed
        if followed is not None and followed.seen_ns == stamp_ns and followed.by_place:
            self._guessed = self._guessed or followed.gap_s > GUESS_AFTER_S
        if followed is None or self._is_forgotten(stamp_ns, patience):
            followed = self._choose_anew(people, stamp_ns)
        if followed is None:
            return self._nobody(people)
        return followed.detection if followed.seen_ns == stamp_ns else self._nobody(())

    def _update_tracks(self, people: Sequence[Detection], image: PeopleImage, patience: float) -> None:
        usable = [one for one in people if self._is_trackable(one)]
        if image.persistent and self._followed is not None:  # the followed person may be seen in part
            number = self._followed.detection.number
            usable += [one for one in people if one.number == number and one not in usable and _has_points(one)]
        expected = None if self._followed is None else self._person.predicted_landmarks(image.stamp_ns)
        self._tracks.update(image.stamp_ns, usable, image.persistent, patience, self._followed, expected)

    def _is_forgotten(self, stamp_ns: int, patience: float) -> bool:
        """Return True if the followed person has left, so that another one may be followed."""
        if self._person.seen_ns is None and not self._locked:
            return True  # never tracked: there is nothing to keep
        followed = self._followed
        absent = followed is None or followed.seen_ns != stamp_ns or not self._is_trackable(followed.detection)
        return absent and not self._locked and self._person.unseen_s(stamp_ns) > patience

    def _choose_anew(self, people: Sequence[Detection], stamp_ns: int) -> ImageTrack | None:
        """Follow the best person in the image. Return the track, None if nobody can be tracked."""
        best = self._best([t for t in self._tracks.seen_at(stamp_ns) if self._is_trackable(t.detection)])
        if best is not None and best is not self._followed:
            self._begin(best)
        return best

    def _begin(self, track: ImageTrack | None) -> None:
        """Follow another person, under a new id."""
        self._followed, self._guessed = track, False
        if self._person.seen_ns is not None:
            self._person.reset(same_camera=True)
            self._number_of_person = max(self._number_of_person, 1) + 1

    def _best(self, tracks: Sequence[ImageTrack]) -> ImageTrack | None:
        """Return the track that the rule `follow` prefers; None if there is none."""
        number = number_named(self._follow)
        if number is not None:
            lasting = tracks if self._persistent else ()
            return next((track for track in lasting if track.detection.number == number), None)
        score = SCORES[self._follow]
        return max(tracks, key=lambda track: score(track.detection), default=None)

    def _nobody(self, people: Sequence[Detection]) -> Detection:
        """Return the detection with the most points of those who cannot be tracked, so that the reason is reported."""
        empty = Detection(np.full((self._count, 2), np.nan), np.zeros(self._count))
        untrackable = [one for one in people if not self._is_trackable(one)]
        return max(untrackable, key=SCORES[CONFIDENT], default=empty)

    def _absence(self, image: PeopleImage, forget_after: float) -> str:
        """Return the explanation for a message that shows other people only; empty if that is not the case.

        Without it the message would be refused for too few landmarks. This reason would be misleading, because it
        suggests that the detector's confidences are too low.
        """
        keypoints, followed = image.keypoints, self._followed
        if keypoints.persons is None or followed is None or followed.seen_ns == image.stamp_ns:
            return ""
        config = self._person.tracker.config
        confident = keypoints.present & (keypoints.confidence >= config.min_confidence)
        others = len(np.unique(keypoints.persons[confident]))
        if not others:
            return ""
        number = followed.detection.number
        who = f"person {number} is not" if image.persistent else "nobody is near the predicted position"
        waits = f"another person is followed after forget_after {forget_after:g} s"
        if self._locked:
            waits = "the person is locked, until ~/lock is called with false"
        return (
            f"one person is followed, and {who} among the {others} in the message; {waits} (see person_ids, max_people)"
        )

    def _is_trackable(self, one: Detection) -> bool:
        return is_trackable(one, self._person.tracker.config)


def _has_points(one: Detection) -> bool:
    return bool(np.isfinite(one.points).any())
