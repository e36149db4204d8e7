"""Publish the right wrist in base_link, as soon as TF has the transform of its image. Needs tf2_ros, tf2_geometry_msgs.

python3 examples/wrist_in_base.py
"""

from collections import deque

import tf2_geometry_msgs  # noqa: F401  (teaches tf2 to transform points)
from geometry_msgs.msg import PointStamped, PoseArray
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import Buffer, TransformListener

from lassokin_ros import joints
from lassokin_ros.node.executable import run


class WristInBase(Node):
    """Keeps each wrist for at most 0.5 s. Waiting inside a callback would stop the messages of TF, too."""

    def __init__(self):
        super().__init__("wrist_in_base")
        self.buffer, self.waiting = Buffer(), deque()
        self.listener = TransformListener(self.buffer, self)
        self.publisher = self.create_publisher(PointStamped, "right_wrist", 10)
        self.create_subscription(PoseArray, "tracker/joints", self.on_joints, 10)
        self.create_timer(0.02, self.on_timer)

    def on_joints(self, message):
        """Keep the wrist."""
        self.waiting.append(PointStamped(header=message.header, point=message.poses[joints.RIGHT_WRIST].position))

    def on_timer(self):
        """Publish the wrists whose transform has come, in their order, and drop those that are not of now."""
        while self.waiting:
            wrist, now = self.waiting[0], self.get_clock().now()
            if not -1e8 <= (now - Time.from_msg(wrist.header.stamp)).nanoseconds <= 5e8:
                self.get_logger().warn("dropped: no TF, or not a stamp of now", throttle_duration_sec=5.0)
            elif self.buffer.can_transform("base_link", wrist.header.frame_id, wrist.header.stamp):
                self.publisher.publish(self.buffer.transform(wrist, "base_link"))
            else:
                return
            self.waiting.popleft()


if __name__ == "__main__":
    run(WristInBase)
