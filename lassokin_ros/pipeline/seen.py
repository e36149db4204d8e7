"""What comes in: people in an image, as arrays. Made once, by `people_in` from the keypoints of a message."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import HERE, CameraPose
from lassokin_ros.pipeline.camera.lens import Lens
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

MOST_PEOPLE = 100
"""Largest number of people in one message. A message with more is refused before any of them is processed."""


@dataclass(eq=False)
class Seen:
    """One person in one image.

    points: (l, 2) normalised, NaN = missing; confidence: (l,); number: the person number in the message; pixels:
    (l, 2) px from the detector, None without a detection. depth, depth_of_surface, depth_age: as in Observation.
    sampled: (l,) m, those of a depth image, also if they are left out; None without one. trackable: whether it has
    enough confident landmarks for a tracker.
    """

    points: np.ndarray
    confidence: np.ndarray
    number: int = 0
    pixels: np.ndarray | None = None
    depth: np.ndarray | None = None
    depth_of_surface: bool = True
    depth_age: float = 0.0
    sampled: np.ndarray | None = None
    trackable: bool = True


@dataclass(eq=False)
class Image:
    """All people in one image, and how it was taken.

    stamp_ns: ns; frame_id: frame of the keypoints; people: in the order of their numbers. numbered: False if the
    messages have no person numbers: all keypoints are those of one person; lasting: True if the numbers stay the same
    from message to message; stamped: False if the stamp is the time of arrival; camera: which camera, and where it is;
    shown: number of people who are in the image, also of those whose keypoints cannot be used. identified: True if the
    numbers are the people's own, in the images of all cameras. body: id of the only person, with a topic per body.
    """

    people: Sequence[Seen]
    stamp_ns: int
    frame_id: str
    lens: Lens
    numbered: bool = True
    lasting: bool = False
    stamped: bool = True
    camera: CameraPose = HERE
    shown: int = 0
    identified: bool = False
    body: str = ""

    @property
    def source(self) -> str:
        """Whose messages it is from: the body's, or the camera's."""
        return self.body or self.camera.name


@dataclass(eq=False)
class Sight:
    """A person as seen by a camera, and how the image was taken. stamp_ns: ns. camera: which one, and where it is."""

    stamp_ns: int
    seen: Seen
    lens: Lens
    camera: CameraPose = HERE


def key_of(points: np.ndarray) -> bytes:
    """Return what identifies the points of a person in all images of a camera: they differ by noise at least."""
    return hashlib.blake2b(points.tobytes(), digest_size=8).digest()


def identified(image: Image, numbers: Mapping[tuple[str, bytes], int]) -> Image:
    """Return an image with those people whose numbers are known, by camera and `key_of`."""
    known = [(seen, numbers.get((image.camera.name, key_of(seen.points)))) for seen in image.people]
    people = [replace(seen, number=number) for seen, number in known if number is not None]
    return replace(image, people=people, numbered=True, lasting=True, identified=True)


def people_in(
    keypoints: Keypoints, count: int, lens: Lens, config: TrackerConfig | None = None, sampled: Keypoints | None = None
) -> list[Seen]:
    """Return the people of a message, one if it has no person numbers.

    count: number of landmarks in the layout. config: tells who is trackable; None: everybody. sampled: the keypoints
    with the depths of a depth image, None without one. Raises AdapterError, see `Keypoints.as_landmarks`, and with the
    reason `too_many_people` for more than MOST_PEOPLE.
    """
    numbers, pixels, confidence = keypoints.by_person(count)
    if len(numbers) > MOST_PEOPLE:
        raise AdapterError("too_many_people", f"{len(numbers)} people; expected at most {MOST_PEOPLE}")
    points = lens.normalise(pixels.reshape(-1, 2)).reshape(pixels.shape)
    trackable = [True] * len(numbers)
    if config is not None:
        finite, confident = np.isfinite(points), confidence >= max(config.min_confidence, 1e-9)
        found = np.count_nonzero(confident & finite[..., 0] & finite[..., 1], axis=1)
        trackable = (found >= config.min_landmarks).tolist()
    return [
        Seen(
            points[i],
            confidence[i],
            number,
            pixels[i],
            keypoints.depth_as_landmarks(count, number),
            keypoints.depth_of_surface,
            keypoints.depth_age,
            None if sampled is None else sampled.depth_as_landmarks(count, number),
            trackable[i],
        )
        for i, number in enumerate(numbers.tolist())
    ]
