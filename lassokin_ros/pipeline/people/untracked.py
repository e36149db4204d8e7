"""How many people in an image are not tracked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.pipeline.people.image_tracks import SAME_BODY
from lassokin_ros.pipeline.people.matching import distances
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Image


def untracked(image: Image, people: Sequence[TrackedPerson], tracked_for: float) -> int:
    """Return the number of people who are in an image and not tracked.

    A detection where a tracked person is expected is that person: a duplicate, one with few keypoints, or one of an
    image that came late. people: all; tracked_for: s, for so long after the last accepted frame somebody is tracked.
    """
    stamp_ns, name = image.stamp_ns, image.camera.name
    matched = sum(person.seen_by.get(name) == stamp_ns for person in people)
    if image.shown <= matched:  # the usual case
        return 0
    expected = [p.predicted_landmarks(stamp_ns, image.camera) for p in people if p.unseen_s(stamp_ns) <= tracked_for]
    known = [points for points in expected if points is not None]
    if known:
        limit = people[0].tracker.config.min_confidence
        near = distances(np.stack(known), image.people, limit, fewest=1).min(axis=0, initial=np.inf) <= SAME_BODY
        matched = max(matched, int(np.count_nonzero(near)))
    return max(image.shown - matched, 0)
