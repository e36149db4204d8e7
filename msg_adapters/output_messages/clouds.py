"""Joints, ends of limbs and hands of people as sensor_msgs/PointCloud2: a point for each, with its covariance.

The vertical is in each joint of a skeleton, so that one message is enough to use a person.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.errors import AdapterError
from msg_adapters.output_messages.builders import Cloud, CloudBuilder, StampedBuilder, as_floats
from msg_adapters.output_messages.serialised_messages import SerialisedMessage

COVARIANCE = ("xx", "xy", "xz", "yy", "yz", "zz")
UPPER = np.array([3 * "xyz".index(name[0]) + "xyz".index(name[1]) for name in COVARIANCE])
"""Indices of these entries in a flattened matrix."""


def floats(*names: str) -> list[tuple[str, str]]:
    """Return fields of a point, little-endian float32."""
    return [(name, "<f4") for name in names]


def whole(*names: str) -> list[tuple[str, str]]:
    """Return fields of a point, little-endian int32."""
    return [(name, "<i4") for name in names]


MOTION = ("x", "y", "z", "vx", "vy", "vz")
_FIRST = [*floats(*MOTION, *COVARIANCE), *whole("index", "observed", "contact")]
_LAST = [*floats("rotation_deviation", "deviation", "qx", "qy", "qz", "qw", "up_x", "up_y", "up_z"), *whole("still")]
SKELETON_POINT = np.dtype([*_FIRST, *_LAST])
SKELETONS_POINT = np.dtype([*_FIRST, *whole("person"), *_LAST])
UNCERTAINTY_POINT = np.dtype([*floats("x", "y", "z"), *whole("joint"), *floats("deviation", *COVARIANCE)])
_RELATIVE = floats("x", "y", "z", *COVARIANCE, "deviation")
LIMB_POINT = np.dtype([*_RELATIVE, *whole("index", "root", "observed")])
OF_HAND = (
    *("wrist_x", "wrist_y", "wrist_z", "qx", "qy", "qz", "qw", "ray_x", "ray_y", "ray_z"),
    *("ray_deviation", "gesture_confidence"),
)
HAND_POINT = np.dtype([*_RELATIVE, *whole("index", "side", "observed", "person", "gesture"), *floats(*OF_HAND)])
HAND_POINTS = 21
"""Points of a hand: the wrist, then thumb, index, middle, ring and pinky finger, from the root to the tip."""


class UncertaintyCloudBuilder(Cloud):
    """One point per joint: x, y, z in m, its index, the deviation in m and the six entries of the covariance in m^2."""

    def __init__(self, backend: Backend, count: int) -> None:
        """count: number of joints."""
        super().__init__(backend, UNCERTAINTY_POINT, joint=np.arange(count))

    def numbers(self, positions: np.ndarray, covariance: np.ndarray, deviation: np.ndarray) -> np.ndarray:
        """positions: (n, 3) m; covariance: (n, 3, 3) m^2; deviation: (n,) m."""
        self._values[:, :3], self._values[:, 4] = positions, deviation
        self._values[:, 5:] = covariance.reshape(-1, 9).take(UPPER, axis=1)
        return self._points.view(np.uint8)


def read_uncertainty_cloud(message: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions (n, 3) m, covariance (n, 3, 3) m^2 and deviation (n,) m of a message of the builder above.

    Raises AdapterError with reason `wrong_layout`.
    """
    size, step = len(message.data), UNCERTAINTY_POINT.itemsize
    if message.point_step != step or size % step or message.is_bigendian:
        raise AdapterError(
            "wrong_layout", f"{size} bytes, point_step {message.point_step}; expected {step} bytes per joint"
        )
    points = np.frombuffer(message.data, UNCERTAINTY_POINT)
    covariance = np.empty((len(points), 9))
    for name, place in zip(COVARIANCE, UPPER):
        row, column = divmod(int(place), 3)
        covariance[:, place] = covariance[:, 3 * column + row] = points[name]
    positions = np.stack([points[axis] for axis in "xyz"], axis=1).astype(float)
    return positions, covariance.reshape(-1, 3, 3), points["deviation"].astype(float)


@dataclass(frozen=True, eq=False)
class JointsReport:
    """The joints of one person, in the frame of the message.

    Attributes
    ----------
    person: number of the person, see `people.number_of`.
    positions: (n, 3) m; velocities: (n, 3) m/s; covariance: (n, 3, 3) m^2, absolute.
    observed: (n,) bool, whether keypoints of this image observe the joint; the prior alone places the others.
    contact: (n,) bool, ankles of feet that stand still on the floor; still: (n,) bool, of feet that stand still, also
    of one that is held in the air.
    rotation_deviation: (n,) rad, of the rotation relative to the parent, see `JointUncertainty.rotation_deviation`.
    deviation: (n,) m, of the position relative to the pelvis.
    quaternions: (n, 4) x, y, z, w, orientations. up: (3,) unit vector, the vertical.
    """

    person: int
    positions: np.ndarray
    velocities: np.ndarray
    covariance: np.ndarray
    observed: np.ndarray
    contact: np.ndarray
    still: np.ndarray
    rotation_deviation: np.ndarray
    deviation: np.ndarray
    quaternions: np.ndarray
    up: np.ndarray

    def write(self, points: np.ndarray, values: np.ndarray) -> None:
        """Write all but index and person into points (n,). values: (n, size / 4), the same memory as float32."""
        values[:, :3], values[:, 3:6] = self.positions, self.velocities
        values[:, 6:12] = self.covariance.reshape(-1, 9).take(UPPER, axis=1)
        values[:, -10], values[:, -9] = self.rotation_deviation, self.deviation
        values[:, -8:-4], values[:, -4:-1] = self.quaternions, self.up
        points["observed"], points["contact"], points["still"] = self.observed, self.contact, self.still


class SkeletonCloudBuilder(Cloud):
    """One point per joint: the fields of JointsReport without the person, and index: of the joint."""

    def __init__(self, backend: Backend, count: int) -> None:
        """count: number of joints."""
        super().__init__(backend, SKELETON_POINT, index=np.arange(count))

    def numbers(self, person: JointsReport) -> np.ndarray:
        """person: the joints of one person."""
        person.write(self._points, self._values)
        return self._points.view(np.uint8)


class SkeletonsCloudBuilder:
    """One point per joint and person, all joints of a person in a row: the fields of SkeletonCloudBuilder and person.

    person: number of the person, as in ~/people.
    """

    def __init__(self, backend: Backend, count: int, serialised: bool = False) -> None:
        """count: number of joints. serialised: return serialised messages where there are people."""
        self._count = count
        cloud = CloudBuilder(backend, SKELETONS_POINT)
        self._fill = SerialisedMessage(cloud, backend).fill if serialised else cloud.fill

    def fill(self, stamp_ns: int, frame_id: str, people: Sequence[JointsReport]) -> Any:
        """Return the message. Without people it is empty."""
        points = np.zeros((len(people), self._count), SKELETONS_POINT)
        for row, values, person in zip(points, as_floats(points), people):
            person.write(row, values)
            row["person"] = person.person
        points["index"] = np.arange(self._count)
        return self._fill(stamp_ns, frame_id, points.reshape(-1))


class LimbCloudBuilder(Cloud):
    """One point per end of a limb, for a robot that imitates a person.

    x, y, z in m and xx to zz in m^2: from the root to the end, in axes of the chest (arms) or the pelvis (legs), x
    front, y left, z up, which are not those of the header's frame. deviation: m. index, root: indices of the joints.
    observed: 1 if keypoints of this image observe the end, 0 if only the prior does.
    """

    def __init__(self, backend: Backend, ends: Sequence[int], roots: Sequence[int]) -> None:
        """ends, roots: (k,) indices of joints."""
        super().__init__(backend, LIMB_POINT, index=ends, root=roots)

    def numbers(self, positions: np.ndarray, covariance: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """positions: (k, 3) m; covariance: (k, 3, 3) m^2; observed: (k,) bool."""
        _write_relative(self._values, positions, covariance)
        self._points["observed"] = observed
        return self._points.view(np.uint8)


def _write_relative(values: np.ndarray, positions: np.ndarray, covariance: np.ndarray) -> None:
    """Write the fields of `_RELATIVE` into values (n, size / 4). positions: (n, 3) m; covariance: (n, 3, 3) m^2."""
    covariance = covariance.reshape(-1, 9)
    values[:, :3], values[:, 3:9] = positions, covariance.take(UPPER, axis=1)
    values[:, 9] = np.sqrt(np.add.reduce(covariance[:, ::4], axis=1))  # trace takes three times as long


@dataclass(frozen=True, eq=False)
class HandReport:
    """One hand of a person.

    Attributes
    ----------
    side: 0 for the left hand, 1 for the right one. person: number of the person, see `people.number_of`.
    points: (21, 3) m, and covariance: (21, 3, 3) m^2, from the wrist, in axes of the hand.
    observed: (21,) bool, whether a keypoint of this image shows the point.
    wrist: (3,) m; quaternion: (4,) x, y, z, w, the axes of the hand; ray: (3,) unit vector, where the hand would point
    from the tip of its index finger on; these three in the frame of the message. ray_deviation: rad.
    gesture: number, gesture_confidence: 0 to 1, see lassokin_ros.gestures.
    """

    side: int
    person: int
    points: np.ndarray
    covariance: np.ndarray
    observed: np.ndarray
    wrist: np.ndarray
    quaternion: np.ndarray
    ray: np.ndarray
    ray_deviation: float
    gesture: int
    gesture_confidence: float


class HandCloudBuilder(Cloud):
    """One point per point of a hand, all of a hand in a row: the fields of HandReport, and index: 0 to 20.

    x, y, z and xx to zz are in the axes of the hand, which are not those of the header's frame. deviation: m. What
    follows `person` is the same in all points of a hand.
    """

    def __init__(self, backend: Backend, hands: int) -> None:
        """hands: their number, 1 or 2."""
        super().__init__(backend, HAND_POINT, index=np.tile(np.arange(HAND_POINTS), (hands, 1)))

    def numbers(self, hands: Sequence[HandReport]) -> np.ndarray:
        """hands: as many as given to __init__."""
        for points, values, hand in zip(self._points, self._values, hands, strict=True):
            _write_relative(values, hand.points, hand.covariance)
            for name in ("side", "observed", "person", "gesture"):
                points[name] = getattr(hand, name)
            ends = hand.ray_deviation, hand.gesture_confidence
            values[:, 15:] = np.concatenate([hand.wrist, hand.quaternion, hand.ray, ends])
        return self._points.reshape(-1).view(np.uint8)


REP155_GESTURES = {"fist": 7, "open_palm": 8, "pointing": 9, "thumbs_up": 11, "victory": 12}
"""Numbers of hri_msgs/Gesture since 2.2: CLOSED_FIST, OPEN_PALM, POINTING_UP, THUMB_UP, VICTORY. OTHER is 0."""
REP155_SIDES = 2, 1
"""LEFT and RIGHT of hri_msgs/Gesture."""


class GestureBuilder(StampedBuilder):
    """hri_msgs/Gesture."""

    def __init__(self, backend: Backend) -> None:
        message = backend.make("hri_msgs/msg/Gesture")
        super().__init__(message, [message.header])

    def numbers(self, gesture: int, side: int) -> np.ndarray:
        """gesture: number of the message. side: 0 for the left hand, 1 for the right one."""
        return np.array([gesture, REP155_SIDES[side]])

    def _write(self, numbers: np.ndarray) -> None:
        self._message.gesture, self._message.handedness = numbers.tolist()
