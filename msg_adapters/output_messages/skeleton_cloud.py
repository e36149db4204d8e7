"""All joints of one person, or of everybody, as sensor_msgs/PointCloud2.

Each joint has a position, a velocity, a covariance, a rotation, deviations of both, and whether it is observed, stands
still, and is on the floor. The vertical is in each point, so that one message is enough to use a person.

The ends of the limbs relative to their roots are a cloud of their own, for a robot that imitates a person.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import Cloud, CloudBuilder
from msg_adapters.output_messages.joint_uncertainty import COVARIANCE, UPPER
from msg_adapters.output_messages.serialised_messages import SerialisedMessage

MOTION = ("x", "y", "z", "vx", "vy", "vz")
_FIRST = [(name, "<f4") for name in (*MOTION, *COVARIANCE)] + [
    (name, "<i4") for name in ("index", "observed", "contact")
]
_TURN = ("rotation_deviation", "deviation", "qx", "qy", "qz", "qw", "up_x", "up_y", "up_z")
_LAST = [(name, "<f4") for name in _TURN] + [("still", "<i4")]
POINT = np.dtype([*_FIRST, *_LAST])
SKELETONS_POINT = np.dtype([*_FIRST, ("person", "<i4"), *_LAST])


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
        super().__init__(backend, POINT)
        self._points = np.zeros(count, POINT)
        self._points["index"] = np.arange(count)
        self._values = self._points.view("<f4").reshape(count, -1)

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
        values = points.view("<f4").reshape(len(people), self._count, SKELETONS_POINT.itemsize // 4)
        for row, row_values, person in zip(points, values, people):
            person.write(row, row_values)
            row["person"] = person.person
        points["index"] = np.arange(self._count)
        return self._fill(stamp_ns, frame_id, points.reshape(-1))


LIMB_POINT = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", *COVARIANCE, "deviation")]
    + [(name, "<i4") for name in ("index", "root", "observed")]
)


class LimbCloudBuilder(Cloud):
    """One point per end of a limb.

    x, y, z in m and xx to zz in m^2: from the root to the end, in axes of the chest (arms) or the pelvis (legs), x
    front, y left, z up, which are not those of the header's frame. deviation: m. index, root: indices of the joints.
    observed: 1 if keypoints of this image observe the end, 0 if only the prior does.
    """

    def __init__(self, backend: Backend, ends: Sequence[int], roots: Sequence[int]) -> None:
        """ends, roots: (k,) indices of joints."""
        super().__init__(backend, LIMB_POINT)
        self._points = np.zeros(len(ends), LIMB_POINT)
        self._points["index"], self._points["root"] = ends, roots
        self._values = self._points.view("<f4").reshape(len(ends), LIMB_POINT.itemsize // 4)

    def numbers(self, positions: np.ndarray, covariance: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """positions: (k, 3) m; covariance: (k, 3, 3) m^2; observed: (k,) bool."""
        self._values[:, :3] = positions
        covariance = covariance.reshape(-1, 9)
        self._values[:, 3:9] = covariance.take(UPPER, axis=1)
        self._values[:, 9] = np.sqrt(np.add.reduce(covariance[:, ::4], axis=1))  # np.trace takes three times as long
        self._points["observed"] = observed
        return self._points.view(np.uint8)
