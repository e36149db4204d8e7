"""For robots: the people whom a tracker sees now. What is too old counts as unknown.

    watch = PeopleWatch(node)                         # in a node; reads /tracker/people and /tracker/state
    for person in watch.tracked():                    # the nearest one first; empty if nothing is known
        person["x"], person["z"], person["detector_id"]
    watch.state                                       # "tracking", "nobody", or "lost": somebody may be there

One age decides, that of the newest ~/people by its stamp. The tracker repeats this message with a stamp that advances,
so that the age is also too large if the tracker was killed or has no processor time, if the keypoints are late, and if
the clocks of two machines differ. A person who is lost, or a detector that stops, is in the message itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import String

from lassokin_ros.core.body.rotations import from_quaternion

TRACKING, LOST, NOBODY = "tracking", "lost", "nobody"
STALE_S = 0.5
"""s: age from which on a message is not used."""
KINDS = {PointField.FLOAT32: "<f4", PointField.INT32: "<i4"}


def points(message: PointCloud2) -> np.ndarray:
    """Return the points of ~/people, ~/skeleton or ~/skeletons as a structured array (k,), by the message's fields."""
    kind = np.dtype([(field.name, KINDS[field.datatype]) for field in message.fields])
    return np.frombuffer(bytes(message.data), kind)


def position(point: Any) -> np.ndarray:
    """Return the position (3,) m of one point."""
    return np.array([point[name] for name in "xyz"], dtype=float)


def covariance(point: Any) -> np.ndarray:
    """Return the covariance (3, 3) m^2 of the position of one point."""
    rows = ("xx", "xy", "xz"), ("xy", "yy", "yz"), ("xz", "yz", "zz")
    return np.array([[point[name] for name in row] for row in rows], dtype=float)


def transformed(point: Any, transform: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return position (3,) m and covariance (3, 3) m^2 of one point, moved by a geometry_msgs/Transform."""
    turn, shift = transform.rotation, transform.translation
    matrix = from_quaternion(np.array([turn.x, turn.y, turn.z, turn.w]))
    place = matrix @ position(point) + np.array([shift.x, shift.y, shift.z])
    return place, matrix @ covariance(point) @ matrix.T


class PeopleWatch:
    """Subscribes to ~/people and ~/state of a tracker. `people_type` must be the default, sensor_msgs/PointCloud2."""

    def __init__(self, node: Node, tracker: str = "/tracker", stale_s: float = STALE_S) -> None:
        """tracker: name of the tracker's node; stale_s: s, largest age of a message that is used."""
        self._clock, self._stale_s = node.get_clock(), stale_s
        self._people: PointCloud2 | None = None
        self._state = LOST
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(PointCloud2, f"{tracker}/people", self._on_people, 10)
        node.create_subscription(String, f"{tracker}/state", self._on_state, latched)

    def _on_people(self, message: PointCloud2) -> None:
        self._people = message

    def _on_state(self, message: String) -> None:
        self._state = message.data

    def age(self, header: Any) -> float:
        """Return the age of a std_msgs/Header by its stamp, s; negative if it lies in the future."""
        now_ns: int = self._clock.now().nanoseconds
        return (now_ns - Time.from_msg(header.stamp).nanoseconds) * 1e-9

    @property
    def known(self) -> bool:
        """True if the newest message is fresh: `stale_s` old at most, or as far in the future."""
        return self._people is not None and abs(self.age(self._people.header)) <= self._stale_s

    @property
    def state(self) -> str:
        """The tracker's state; "lost" if the newest message is not fresh."""
        return self._state if self.known else LOST

    @property
    def frame_id(self) -> str:
        """Frame of the positions: the camera's optical frame (x right, y down, z forward); empty before a message."""
        return "" if self._people is None else str(self._people.header.frame_id)

    def everybody(self) -> np.ndarray:
        """Return all people of the newest message, also those who are lost, the nearest one first; none if not fresh.

        The fields are x, y, z (m), vx, vy, vz (m/s), xx to zz (m^2), confidence, age (s), person, tracked, detector_id,
        guessed, doubtful.
        """
        if self._people is None or not self.known:
            return np.zeros(0, dtype=[("x", "<f4"), ("tracked", "<i4")])
        people = points(self._people)
        return people[np.argsort(people["x"] ** 2 + people["y"] ** 2 + people["z"] ** 2)]

    def tracked(self) -> np.ndarray:
        """Return the people whose last frame is fresh, the nearest one first; none if the newest message is not."""
        people = self.everybody()
        if self._people is None or len(people) == 0:
            return people
        fresh = self.age(self._people.header) + people["age"] <= self._stale_s
        return people[(people["tracked"] == 1) & fresh]
