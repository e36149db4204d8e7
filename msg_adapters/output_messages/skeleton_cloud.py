"""All joints of one person, or of everybody, as sensor_msgs/PointCloud2.

Each joint has a position, a velocity, a covariance, whether it is observed, and the deviation of its rotation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.clouds import Cloud, CloudBuilder
from msg_adapters.output_messages.joint_uncertainty import COVARIANCE, UPPER
from msg_adapters.output_messages.serialised_messages import SerialisedMessage

MOTION = ("x", "y", "z", "vx", "vy", "vz")
_BEFORE = [(name, "<f4") for name in (*MOTION, *COVARIANCE)] + [
    (name, "<i4") for name in ("index", "observed", "contact")
]
_TURN = ("rotation_deviation", "<f4")
POINT = np.dtype([*_BEFORE, _TURN])
SKELETONS_POINT = np.dtype([*_BEFORE, ("person", "<i4"), _TURN])


class SkeletonCloudBuilder(Cloud):
    """One point per joint.

    x, y, z in m, vx, vy, vz in m/s, xx, xy, xz, yy, yz, zz in m^2: the absolute covariance, all in the frame of the
    header. index: of the joint. observed: 1 if keypoints of this image observe the joint, 0 if only the prior does.
    contact: 1 for the ankle of a foot that stands still. rotation_deviation: rad, of the joint's rotation relative to
    its parent, see `JointUncertainty.rotation_deviation`.
    """

    def __init__(self, backend: Backend, count: int) -> None:
        """count: number of joints."""
        super().__init__(backend, POINT)
        self._points = np.zeros(count, POINT)
        self._points["index"] = np.arange(count)
        self._values = self._points.view("<f4").reshape(count, -1)

    def numbers(
        self,
        positions: np.ndarray,
        velocities: np.ndarray,
        covariance: np.ndarray,
        observed: np.ndarray,
        contact: np.ndarray,
        rotation_deviation: np.ndarray,
    ) -> np.ndarray:
        """positions: (n, 3) m; velocities: (n, 3) m/s; covariance: (n, 3, 3) m^2; observed, contact: (n,) bool;
        rotation_deviation: (n,) rad.
        """
        self._values[:, :3] = positions
        self._values[:, 3:6] = velocities
        self._values[:, 6:12] = covariance.reshape(-1, 9).take(UPPER, axis=1)
        self._values[:, -1] = rotation_deviation
        self._points["observed"], self._points["contact"] = observed, contact
        return self._points.view(np.uint8)


@dataclass(frozen=True, eq=False)
class JointsReport:
    """The joints of one person.

    Attributes
    ----------
    person: number of the person, see `people.number_of`.
    positions: (n, 3) m; velocities: (n, 3) m/s; covariance: (n, 3, 3) m^2; observed, contact: (n,)
    bool; rotation_deviation: (n,) rad.
    """

    person: int
    positions: np.ndarray
    velocities: np.ndarray
    covariance: np.ndarray
    observed: np.ndarray
    contact: np.ndarray
    rotation_deviation: np.ndarray


class SkeletonsCloudBuilder:
    """One point per joint and person, all joints of a person in a row: the fields of SkeletonCloudBuilder and person.

    person: number of the person, as in ~/people.
    """

    def __init__(self, backend: Backend, count: int, serialised: bool = False) -> None:
        """count: number of joints. serialised: return serialised messages where there are people."""
        self._count = count
        self._cloud = CloudBuilder(backend, SKELETONS_POINT)
        self._fill = SerialisedMessage(self._cloud, backend).fill if serialised else self._cloud.fill

    def fill(self, stamp_ns: int, frame_id: str, people: Sequence[JointsReport]) -> Any:
        """Return the message. Without people it is empty."""
        points = np.zeros((len(people), self._count), SKELETONS_POINT)
        values = points.view("<f4").reshape(len(people), self._count, SKELETONS_POINT.itemsize // 4)
        for row, person in zip(values, people):
            row[:, :3], row[:, 3:6] = person.positions, person.velocities
            row[:, 6:12] = person.covariance.reshape(-1, 9).take(UPPER, axis=1)
            row[:, -1] = person.rotation_deviation
        for row, person in zip(points, people):
            row["person"], row["observed"], row["contact"] = person.person, person.observed, person.contact
        points["index"] = np.arange(self._count)
        fill = self._fill if len(people) > 0 else self._cloud.fill
        return fill(stamp_ns, frame_id, points.reshape(-1))
