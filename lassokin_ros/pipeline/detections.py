"""A message's keypoints as detections: one for each person, their points as rays through the lens."""

from __future__ import annotations

from lassokin_ros.pipeline.lens import Lens
from lassokin_ros.pipeline.people.tracked_person import Detection
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

MOST_PEOPLE = 100
"""People in one message; more are refused before time is spent on them."""


def detection(keypoints: Keypoints, person: int | None, count: int, lens: Lens) -> Detection:
    """The detection of one person, or of all points; count: of the layout's landmarks. Raises as `as_landmarks`."""
    pixels, confidence = keypoints.as_landmarks(count, person)
    return Detection(lens.normalise(pixels), confidence, person or 0, pixels)


def everybody(keypoints: Keypoints, count: int, lens: Lens) -> list[Detection]:
    """One detection for each person; count: of the layout's landmarks. Raises AdapterError, of too many people too."""
    numbers, pixels, confidence = keypoints.everybody(count)
    if len(numbers) > MOST_PEOPLE:
        raise AdapterError("too_many_people", f"{len(numbers)} people; expected at most {MOST_PEOPLE}")
    points = lens.normalise(pixels.reshape(-1, 2)).reshape(pixels.shape)
    return [Detection(points[i], confidence[i], number, pixels[i]) for i, number in enumerate(numbers.tolist())]
