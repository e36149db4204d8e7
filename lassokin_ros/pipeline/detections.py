"""Keypoints of a message as detections: one per person, with the points as normalised image coordinates."""

from __future__ import annotations

from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.people.tracked_person import Detection
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

MOST_PEOPLE = 100
"""Largest number of people in one message. A message with more is refused before any of them is processed."""


def detection(keypoints: Keypoints, person: int | None, count: int, lens: Lens) -> Detection:
    """Return the detection of one person, or of all points if `person` is None.

    count: number of landmarks in the layout. Raises AdapterError, see `Keypoints.as_landmarks`.
    """
    pixels, confidence = keypoints.as_landmarks(count, person)
    depth = keypoints.depth_as_landmarks(count, person)
    return Detection(
        lens.normalise(pixels),
        confidence,
        person or 0,
        pixels,
        depth,
        keypoints.depth_of_surface,
        keypoints.depth_age,
    )


def detections_by_person(keypoints: Keypoints, count: int, lens: Lens) -> list[Detection]:
    """Return one detection per person.

    count: number of landmarks in the layout. Raises AdapterError, see `Keypoints.as_landmarks`, and with the reason
    `too_many_people` for more than MOST_PEOPLE.
    """
    numbers, pixels, confidence = keypoints.by_person(count)
    if len(numbers) > MOST_PEOPLE:
        raise AdapterError("too_many_people", f"{len(numbers)} people; expected at most {MOST_PEOPLE}")
    points = lens.normalise(pixels.reshape(-1, 2)).reshape(pixels.shape)
    return [
        Detection(
            points[i],
            confidence[i],
            number,
            pixels[i],
            keypoints.depth_as_landmarks(count, number),
            keypoints.depth_of_surface,
            keypoints.depth_age,
        )
        for i, number in enumerate(numbers.tolist())
    ]
