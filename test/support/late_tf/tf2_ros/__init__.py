"""The part of tf2_ros that the examples use, over geometry_msgs/TransformStamped on /late_tf.

PyPI has no tf2_ros. As there, a transform is known from the first to the last stamp of those that were received. Only
frames are known that one message connects, from child to parent.
"""

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.time import Time

from lassokin_ros.core.body.rotations import from_quaternion


class TransformException(Exception):
    """A transform is not known, or not known at this time."""


class Buffer:
    """Transforms by (target, source) frames."""

    def __init__(self):
        self._stamps, self._newest = {}, {}

    def set_transform(self, message):
        """Keep a transform."""
        key = message.header.frame_id, message.child_frame_id
        self._stamps.setdefault(key, []).append(Time.from_msg(message.header.stamp).nanoseconds)
        self._newest[key] = message

    def lookup_transform(self, target, source, time):
        """Return the newest transform. time: a Time, 0 for any."""
        stamps = self._stamps.get((target, source))
        if stamps is None:
            raise TransformException(f"'{target}' and '{source}' are not connected")
        if time.nanoseconds and not min(stamps) <= time.nanoseconds <= max(stamps):
            raise TransformException(f"lookup would require extrapolation: {time.nanoseconds} not in {max(stamps)}")
        return self._newest[target, source]

    def can_transform(self, target, source, time):
        """Return True if the transform at this time is known. time: a builtin_interfaces/Time or a Time."""
        try:
            self.lookup_transform(target, source, time if isinstance(time, Time) else Time.from_msg(time))
        except TransformException:
            return False
        return True

    def transform(self, point, target):
        """Return a geometry_msgs/PointStamped in the target frame at its stamp."""
        found = self.lookup_transform(target, point.header.frame_id, Time.from_msg(point.header.stamp))
        turn, shift = found.transform.rotation, found.transform.translation
        place = from_quaternion(np.array([turn.x, turn.y, turn.z, turn.w])) @ [
            point.point.x,
            point.point.y,
            point.point.z,
        ]
        moved = type(point)(header=point.header)
        moved.header.frame_id = target
        moved.point.x, moved.point.y, moved.point.z = (place + [shift.x, shift.y, shift.z]).tolist()
        return moved


class TransformListener:
    """Fills a buffer."""

    def __init__(self, buffer, node):
        node.create_subscription(TransformStamped, "/late_tf", buffer.set_transform, 100)
