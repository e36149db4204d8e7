"""The one person who is followed, of all in a message: chosen first, and then found again until lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.estimate import Status
from lassokin_ros.pipeline.detections import MOST_PEOPLE, detection, everybody
from lassokin_ros.pipeline.lens import Lens
from lassokin_ros.pipeline.people.matching import distances, reach, usable
from lassokin_ros.pipeline.people.tracked_person import Detection, TrackedPerson
from msg_adapters.keypoints import Keypoints

PERSON_ABSENT = "person_absent"
"""The reason against a message that has people, but not the one who is followed."""


class SinglePersonTracker:
    """Knows by which number the message calls the person of `body`, and whom it has shown beside them."""

    def __init__(self, body: TrackedPerson) -> None:
        self._body = body
        self._count = body.tracker.kinematics.landmark_count
        self.reset()

    def reset(self) -> None:
        """Choose anew with the next message."""
        self._number: int | None = None
        self._bystanders: frozenset[int] = frozenset()

    def of(self, keypoints: Keypoints, stamp_ns: int, lens: Lens, lasting: bool) -> Detection:
        """Their detection; an empty one when they are not in the message.

        lasting: the message's numbers tell who is who. Raises AdapterError for points that no layout can have.
        """
        if keypoints.persons is None or len(keypoints.persons) == 0:
            return detection(keypoints, None, self._count, lens)
        if self._body.status is Status.TRACKING:
            seen = self._found(keypoints, stamp_ns, lens, lasting)
            # A silent detector tells nobody that the person is lost: the first stamp after it does.
            lost = self._body.status_at(stamp_ns) is Status.LOST and not usable(seen, self._body.tracker.config)
            if not lost:
                return seen
        return self._chosen(keypoints, lens)

    def absence(self, keypoints: Keypoints, seen: Detection, lasting: bool) -> str:
        """In words, that a message shows others, where of this person nothing was `seen` in it; else empty.

        To say that there were no landmarks would send people after their detector's confidences.
        """
        tracked = self._body.status is Status.TRACKING
        if not tracked or keypoints.persons is None or np.isfinite(seen.points).any():
            return ""
        config = self._body.tracker.config
        confident = keypoints.present & (keypoints.confidence >= config.min_confidence)
        others = len(np.unique(keypoints.persons[confident]))
        if not others:
            return ""
        who = f"person {self._number} is not among" if lasting else "nobody is near where they are expected, of"
        waits = f"another is followed after lost_after {config.lost_after:g} s"
        return f"one person is followed, and {who} the {others} in the message; {waits} (see person_ids, max_people)"

    def _found(self, keypoints: Keypoints, stamp_ns: int, lens: Lens, lasting: bool) -> Detection:
        """The person who is tracked: by their number where it lasts, else by their place."""
        if not lasting:
            return self._nearest(everybody(keypoints, self._count, lens), stamp_ns)
        if self._number is None:
            return self._chosen(keypoints, lens)
        assert keypoints.persons is not None
        numbers = frozenset(keypoints.persons[keypoints.present].tolist())
        if self._number not in numbers and (strangers := numbers - self._bystanders):
            # A detector that lost the person for an image or two gives them another number when it finds them again.
            people = [seen for seen in everybody(keypoints, self._count, lens) if seen.number in strangers]
            seen = self._nearest(people, stamp_ns)
            if usable(seen, self._body.tracker.config):
                self._number = seen.number
        if self._number in numbers:
            self._bystanders = numbers - {self._number}
        return detection(keypoints, self._number, self._count, lens)

    def _chosen(self, keypoints: Keypoints, lens: Lens) -> Detection:
        """The one seen with the highest confidence in all, of those who can be tracked if there are any."""
        assert keypoints.persons is not None
        people, index = np.unique(keypoints.persons, return_inverse=True)
        counted = keypoints.present & np.isfinite(keypoints.confidence)
        scores = np.where(counted, keypoints.confidence, 0.0).clip(max=1.0)
        best_first = people[np.argsort(-np.bincount(index, scores), kind="stable")][:MOST_PEOPLE]
        detections = (detection(keypoints, int(person), self._count, lens) for person in best_first)
        best = next(detections)
        config = self._body.tracker.config
        chosen = best if usable(best, config) else next((d for d in detections if usable(d, config)), best)
        self._number, self._bystanders = chosen.number, frozenset(people.tolist()) - {chosen.number}
        return chosen

    def _nearest(self, people: Sequence[Detection], stamp_ns: int) -> Detection:
        """The detection nearest to where the person is expected; an empty one when none is near."""
        expected, body = self._body.expected(stamp_ns), self._body
        assert expected is not None
        apart = distances(expected[None], people, body.tracker.config.min_confidence)[0]
        best = int(np.argmin(apart))
        if apart[best] <= reach(body.unseen_s(stamp_ns)):
            return people[best]
        return Detection(np.full_like(expected, np.nan), np.zeros(len(expected)))
