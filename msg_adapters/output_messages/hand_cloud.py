"""The points of a person's hands, as sensor_msgs/PointCloud2: for robot hands that imitate them. And their gestures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import Cloud, StampedBuilder
from msg_adapters.output_messages.joint_uncertainty import COVARIANCE, UPPER

COUNT = 21
"""Points of a hand: the wrist, then thumb, index, middle, ring and pinky finger, from the root to the tip."""
_PLACE, _TURN, _RAY = ("wrist_x", "wrist_y", "wrist_z"), ("qx", "qy", "qz", "qw"), ("ray_x", "ray_y", "ray_z")
OF_HAND = (*_PLACE, *_TURN, *_RAY, "ray_deviation", "gesture_confidence")
POINT = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", *COVARIANCE, "deviation")]
    + [(name, "<i4") for name in ("index", "side", "observed", "person", "gesture")]
    + [(name, "<f4") for name in OF_HAND]
)


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

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        self._message.gesture, self._message.handedness = numbers.tolist()


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
        super().__init__(backend, POINT)
        self._points = np.zeros((hands, COUNT), POINT)
        self._points["index"] = np.arange(COUNT)
        self._values = self._points.view("<f4").reshape(hands, COUNT, -1)

    def numbers(self, hands: Sequence[HandReport]) -> np.ndarray:
        """hands: as many as given to __init__."""
        for points, values, hand in zip(self._points, self._values, hands, strict=True):
            covariance = hand.covariance.reshape(-1, 9)
            values[:, :3], values[:, 3:9] = hand.points, covariance.take(UPPER, axis=1)
            values[:, 9] = np.sqrt(covariance[:, ::4].sum(axis=1))
            points["side"], points["observed"], points["person"] = hand.side, hand.observed, hand.person
            points["gesture"] = hand.gesture
            ends = hand.ray_deviation, hand.gesture_confidence
            values[:, 15:] = np.concatenate([hand.wrist, hand.quaternion, hand.ray, ends])
        return self._points.reshape(-1).view(np.uint8)
