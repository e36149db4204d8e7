"""All joints of one person as sensor_msgs/PointCloud2: position, velocity, covariance, and whether it is observed."""

from __future__ import annotations

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.clouds import Cloud
from msg_adapters.output_messages.joint_uncertainty import COVARIANCE, UPPER

MOTION = ("x", "y", "z", "vx", "vy", "vz")
POINT = np.dtype([*((name, "<f4") for name in (*MOTION, *COVARIANCE)), ("index", "<i4"), ("observed", "<i4")])


class SkeletonCloudBuilder(Cloud):
    """One point per joint.

    x, y, z in m, vx, vy, vz in m/s, xx, xy, xz, yy, yz, zz in m^2: the absolute covariance, all in the frame of the
    header. index: of the joint. observed: 1 if keypoints of this image observe the joint, 0 if only the prior does.
    """

    def __init__(self, backend: Backend, count: int) -> None:
        """count: number of joints."""
        super().__init__(backend, POINT)
        self._points = np.zeros(count, POINT)
        self._points["index"] = np.arange(count)
        self._values = self._points.view("<f4").reshape(count, -1)

    def numbers(
        self, positions: np.ndarray, velocities: np.ndarray, covariance: np.ndarray, observed: np.ndarray
    ) -> np.ndarray:
        """positions: (n, 3) m; velocities: (n, 3) m/s; covariance: (n, 3, 3) m^2; observed: (n,) bool."""
        self._values[:, :3] = positions
        self._values[:, 3:6] = velocities
        self._values[:, 6:12] = covariance.reshape(-1, 9).take(UPPER, axis=1)
        self._points["observed"] = observed
        return self._points.view(np.uint8)
