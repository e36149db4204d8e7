"""All people in one message: vision_msgs/Detection3DArray, people_msgs/People, or sensor_msgs/PointCloud2.

The first two need packages outside of common_interfaces, which are imported when the builder is made.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import CloudBuilder, as_floats, set_header
from msg_adapters.output_messages.clouds import COVARIANCE, MOTION, UPPER, floats, whole
from msg_adapters.output_messages.serialised_messages import SerialisedMessage

CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
DETECTIONS_TYPE, PEOPLE_TYPE = "vision_msgs/msg/Detection3DArray", "people_msgs/msg/People"
TYPES = (CLOUD_TYPE, DETECTIONS_TYPE, PEOPLE_TYPE)
"""Of messages about all people; the first one is the default."""
CLASS_ID = "person"
TRACKING, LOST = "tracking", "lost"
LARGEST_NUMBER = 0x7FFFFFFF
"""Largest number of a person that a field of type int32 can have."""
VELOCITY_COVARIANCE = tuple(f"v{name}" for name in COVARIANCE)
FLAGS = ("guessed", "doubtful", "locked", "out_of_view")
POINT = np.dtype(
    [
        *floats(*MOTION, *COVARIANCE, "confidence", "age"),
        *whole("person", "tracked", "detector_id", *FLAGS),
        *floats(*VELOCITY_COVARIANCE),
    ]
)


@dataclass(frozen=True, eq=False)
class PersonReport:
    """One person, in the frame of the message.

    Attributes
    ----------
    id: text.
    tracked: False for a person who is lost. All other fields are then those of the last frame with the person, but for
    the covariance, which grows as far as people walk.
    confidence: 0 to 1, that the pose is right; 0 for a person who is lost.
    position: (3,) m, of the pelvis; quaternion: (4,) x, y, z, w, of the body (x front, y left, z up).
    velocity: (3,) m/s, of the pelvis.
    covariance: (6, 6), of position (m) and rotation about the axes of the frame (rad).
    joints: (n, 3) m, positions.
    age: s by which the last frame with the person is older than the message.
    detector_id: the person's number from the detector; -1 if it has none that lasts.
    guessed: True if the person was re-identified by position only after an absence, and may be somebody else.
    doubtful: True if the pose is likely wrong.
    locked: True if the person is locked.
    out_of_view: True for a person who is lost, and at whose place no camera has looked since.
    velocity_covariance: (3, 3), m^2/s^2.
    """

    id: str
    tracked: bool
    confidence: float
    position: np.ndarray
    quaternion: np.ndarray
    velocity: np.ndarray
    covariance: np.ndarray
    joints: np.ndarray
    age: float = 0.0
    detector_id: int = -1
    guessed: bool = False
    doubtful: bool = False
    locked: bool = False
    out_of_view: bool = False
    velocity_covariance: np.ndarray = field(default_factory=lambda: np.full((3, 3), np.nan))

    @property
    def number(self) -> int:
        """See `number_of`."""
        return number_of(self.id)


@lru_cache(maxsize=256)
def number_of(person: str) -> int:
    """Return the number n of an id "pn"; of another id the lower 31 bits of its CRC-32."""
    found = re.fullmatch(r"p(\d{1,9})", person)
    return int(found[1]) if found else zlib.crc32(person.encode()) & LARGEST_NUMBER


def _detection(backend: Backend, stamp_ns: int, frame_id: str, person: PersonReport) -> Any:
    """Return a vision_msgs/Detection3D. score: the confidence, 0 for a person who is lost. It has no velocity."""
    detection = backend.make("vision_msgs/msg/Detection3D")
    result = backend.make("vision_msgs/msg/ObjectHypothesisWithPose")
    set_header(detection.header, stamp_ns, frame_id)
    detection.id = person.id
    result.hypothesis.class_id, result.hypothesis.score = CLASS_ID, person.confidence
    place, turn = result.pose.pose.position, result.pose.pose.orientation
    place.x, place.y, place.z = person.position.tolist()
    turn.x, turn.y, turn.z, turn.w = person.quaternion.tolist()
    result.pose.covariance = person.covariance.reshape(36)
    detection.results = [result]
    centre, size = detection.bbox.center, detection.bbox.size
    least, greatest = person.joints.min(axis=0), person.joints.max(axis=0)
    centre.position.x, centre.position.y, centre.position.z = ((least + greatest) / 2).tolist()
    centre.orientation.w = 1.0
    size.x, size.y, size.z = (greatest - least).tolist()
    return detection


def _person(backend: Backend, stamp_ns: int, frame_id: str, person: PersonReport) -> Any:
    """Return a people_msgs/Person. reliability: the confidence.

    Tags: state, xx to zz of the position's covariance, age, detector_id, and FLAGS (0 or 1).
    """
    message = backend.make("people_msgs/msg/Person")
    message.name, message.reliability = person.id, person.confidence
    place, velocity = message.position, message.velocity
    place.x, place.y, place.z = person.position.tolist()
    velocity.x, velocity.y, velocity.z = person.velocity.tolist()
    variances = person.covariance[:3, :3].reshape(9)[UPPER]
    message.tagnames = ["state", *COVARIANCE, "age", "detector_id", *FLAGS]
    tags = [TRACKING if person.tracked else LOST, *(f"{variance:.6g}" for variance in variances.tolist())]
    flags = [str(int(getattr(person, flag))) for flag in FLAGS]
    message.tags = [*tags, f"{person.age:.3f}", str(person.detector_id), *flags]
    return message


NESTED: Mapping[str, tuple[str, Callable[[Backend, int, str, PersonReport], Any]]] = {
    DETECTIONS_TYPE: ("detections", _detection),
    PEOPLE_TYPE: ("people", _person),
}
"""Message type -> its field of people, and what makes one of them."""


class NestedPeopleBuilder:
    """A message with a message for each person, of a type in NESTED."""

    def __init__(self, backend: Backend, message_type: str) -> None:
        self._backend, self._message = backend, backend.make(message_type)
        self._field, self._make = NESTED[message_type]

    def fill(self, stamp_ns: int, frame_id: str, people: Sequence[PersonReport], untracked: int = 0) -> Any:
        """Return the message. It does not tell untracked people."""
        set_header(self._message.header, stamp_ns, frame_id)
        made = [self._make(self._backend, stamp_ns, frame_id, person) for person in people]
        setattr(self._message, self._field, made)
        return self._message


class PeopleCloudBuilder:
    """sensor_msgs/PointCloud2, one point per person.

    x, y, z in m, vx, vy, vz in m/s, xx, xy, xz, yy, yz, zz in m^2: pelvis; confidence; person: `PersonReport.number`;
    tracked: 1, or 0 for a person who is lost. age, detector_id, guessed, doubtful, locked, out_of_view: as in
    PersonReport; vxx to vzz in m^2/s^2: of the velocity. A detector_id above LARGEST_NUMBER is -1. People whose place
    is not known come last: NaN, tracked 0, person -1.
    """

    def __init__(self, backend: Backend, serialised: bool = False) -> None:
        """serialised: return serialised messages where there are people."""
        cloud = CloudBuilder(backend, POINT, dense=False)
        self._fill = SerialisedMessage(cloud, backend).fill if serialised else cloud.fill

    def fill(self, stamp_ns: int, frame_id: str, people: Sequence[PersonReport], untracked: int = 0) -> Any:
        """Return the message. untracked: number of further people in the image, whose place is not known."""
        points = np.zeros(len(people) + untracked, POINT)
        values = as_floats(points)
        if untracked:
            values[len(people) :, :12] = values[len(people) :, -6:] = np.nan
            points["person"] = points["detector_id"] = -1
        for row, person in zip(values, people):
            row[:3], row[3:6] = person.position, person.velocity
            row[6:12] = person.covariance[:3, :3].take(UPPER)
            row[12:14], row[-6:] = (person.confidence, person.age), person.velocity_covariance.take(UPPER)
        numbers = points[: len(people)]
        numbers["person"] = [person.number for person in people]
        numbers["tracked"] = [person.tracked for person in people]
        numbers["detector_id"] = [p.detector_id if p.detector_id <= LARGEST_NUMBER else -1 for p in people]
        for flag in FLAGS:
            numbers[flag] = [getattr(person, flag) for person in people]
        return self._fill(stamp_ns, frame_id, points)


def people_builder(
    backend: Backend, message_type: str, serialised: bool = False
) -> PeopleCloudBuilder | NestedPeopleBuilder:
    """Return the builder of a message type of TYPES, all people in one message. Its package must be installed.

    serialised: return serialised messages where that is faster.
    """
    if message_type == CLOUD_TYPE:
        return PeopleCloudBuilder(backend, serialised)
    return NestedPeopleBuilder(backend, message_type)
