"""The ends of the limbs relative to their roots, as sensor_msgs/PointCloud2: for a robot that imitates a person."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.clouds import Cloud
from msg_adapters.output_messages.joint_uncertainty import COVARIANCE, UPPER

POINT = np.dtype(
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
        super().__init__(backend, POINT)
        self._points = np.zeros(len(ends), POINT)
        self._points["index"], self._points["root"] = ends, roots
        self._values = self._points.view("<f4").reshape(len(ends), POINT.itemsize // 4)

    def numbers(self, positions: np.ndarray, covariance: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """positions: (k, 3) m; covariance: (k, 3, 3) m^2; observed: (k,) bool."""
        self._values[:, :3] = positions
        covariance = covariance.reshape(-1, 9)
        self._values[:, 3:9] = covariance.take(UPPER, axis=1)
        self._values[:, 9] = np.sqrt(np.add.reduce(covariance[:, ::4], axis=1))  # np.trace takes three times as long
        self._points["observed"] = observed
        return self._points.view(np.uint8)
