"""Follow one person among all people in a message: select the person once, then find the same person again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.detections import MOST_PEOPLE, detection, detections_by_person
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.people.matching import distances, is_trackable, match_radius
from lassokin_ros.pipeline.people.people_tracker import PeopleImage
from lassokin_ros.pipeline.people.presence import Presence, reported_status
from lassokin_ros.pipeline.people.tracked_person import Detection, TrackedPerson
from msg_adapters.keypoints import Keypoints

PERSON_ABSENT = "person_absent"
"""Rejection of a message that contains people, but not the followed person."""


class SinglePersonTracker:
    """Implements PeopleTracker for one person.

    Stores the person's number in the messages and the numbers of the bystanders.
    """

    ids: list[str] | None = None

    def __init__(self, person: TrackedPerson) -> None:
        self._person = person
        self._count = person.tracker.kinematics.landmark_count
        self._forget_numbers()

    def _forget_numbers(self) -> None:
        self._number: int | None = None
        self._bystanders: frozenset[int] = frozenset()

    @property
    def tracked(self) -> dict[str, TrackedPerson]:
        """See PeopleTracker.tracked."""
        return {"": self._person}

    @property
    def status(self) -> Status:
        """See PeopleTracker.status."""
        return self._person.status

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
        """Forget the person. The next message selects a person anew."""
        self._person.reset()
        self._forget_numbers()

    def update(self, image: PeopleImage, forget_after: float) -> list[FrameResult]:
        """Track the followed person; see PeopleTracker.update. A refused message gives a result with the reason."""
        found = self._select(image)
        results = self._person.track(image.stamp_ns, image.frame_id, found, image.lens)
        rejected = any(not result.accepted for result in results)
        if rejected and (absence := self._absence(image, found)):
            results[-1] = replace(results[-1], rejection=PERSON_ABSENT, detail=absence)
        return results

    def _select(self, image: PeopleImage) -> Detection:
        """Return the detection of the followed person; an empty detection if the person is not in the message."""
        keypoints, stamp_ns, lens = image.keypoints, image.stamp_ns, image.lens
        if keypoints.persons is None or len(keypoints.persons) == 0:
            return detection(keypoints, None, self._count, lens)
        if self._person.status is Status.TRACKING:
            found = self._reidentify(image)
            # The status changes to LOST with time alone. After a silence of the detector the new stamp decides.
            lost = self._person.status_at(stamp_ns) is Status.LOST and not self._is_trackable(found)
            if not lost:
                return found
        return self._select_person(keypoints, lens)

    def _absence(self, image: PeopleImage, found: Detection) -> str:
        """Return the explanation for a message that shows other people only; empty if that is not the case.

        Without it the message would be refused for too few landmarks. This reason would be misleading, because it
        suggests that the detector's confidences are too low.
        """
        keypoints = image.keypoints
        tracking = self._person.status is Status.TRACKING
        if not tracking or keypoints.persons is None or np.isfinite(found.points).any():
            return ""
        config = self._person.tracker.config
        confident = keypoints.present & (keypoints.confidence >= config.min_confidence)
        others = len(np.unique(keypoints.persons[confident]))
        if not others:
            return ""
        who = f"person {self._number} is not" if image.persistent else "nobody is near the predicted position"
        waits = f"another person is followed after lost_after {config.lost_after:g} s"
        return (
            f"one person is followed, and {who} among the {others} in the message; {waits} (see person_ids, max_people)"
        )

    def _reidentify(self, image: PeopleImage) -> Detection:
        """Return the detection of the tracked person: by a persistent number, else by position."""
        keypoints, stamp_ns, lens = image.keypoints, image.stamp_ns, image.lens
        if not image.persistent:
            return self._nearest(detections_by_person(keypoints, self._count, lens), stamp_ns)
        if self._number is None:
            return self._select_person(keypoints, lens)
        assert keypoints.persons is not None
        numbers = frozenset(keypoints.persons[keypoints.present].tolist())
        if self._number not in numbers and (strangers := numbers - self._bystanders):
            # A detector that lost the person for an image or two assigns a new number.
            people = [one for one in detections_by_person(keypoints, self._count, lens) if one.number in strangers]
            found = self._nearest(people, stamp_ns)
            if self._is_trackable(found):
                self._number = found.number
        if self._number in numbers:
            self._bystanders = numbers - {self._number}
        return detection(keypoints, self._number, self._count, lens)

    def _select_person(self, keypoints: Keypoints, lens: Lens) -> Detection:
        """Return the detection with the highest total confidence. Trackable detections have priority."""
        assert keypoints.persons is not None
        people, index = np.unique(keypoints.persons, return_inverse=True)
        counted = keypoints.present & np.isfinite(keypoints.confidence)
        scores = np.where(counted, keypoints.confidence, 0.0).clip(max=1.0)
        best_first = people[np.argsort(-np.bincount(index, scores), kind="stable")][:MOST_PEOPLE]
        detections = (detection(keypoints, int(person), self._count, lens) for person in best_first)
        best = next(detections)
        chosen = best if self._is_trackable(best) else next(filter(self._is_trackable, detections), best)
        self._number, self._bystanders = chosen.number, frozenset(people.tolist()) - {chosen.number}
        return chosen

    def _nearest(self, people: Sequence[Detection], stamp_ns: int) -> Detection:
        """Return the detection nearest to the predicted landmarks; an empty detection if none is within reach."""
        predicted, person = self._person.predicted_landmarks(stamp_ns), self._person
        assert predicted is not None
        apart = distances(predicted[None], people, person.tracker.config.min_confidence)[0]
        best = int(np.argmin(apart))
        if apart[best] <= match_radius(person.unseen_s(stamp_ns)):
            return people[best]
        return Detection(np.full_like(predicted, np.nan), np.zeros(len(predicted)))

    def _is_trackable(self, one: Detection) -> bool:
        return is_trackable(one, self._person.tracker.config)
