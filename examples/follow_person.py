"""Follow a person at 1.5 m: a Twist on cmd_vel from the tracker's translation; zero while nobody is tracked.

python3 examples/follow_person.py
"""

import math

from geometry_msgs.msg import PointStamped, Twist
from rclpy.node import Node

from lassokin_ros.node.executable import run


class FollowPerson(Node):
    """Turns to the person and keeps a distance of 1.5 m."""

    def __init__(self):
        super().__init__("follow_person")
        self.seen = None
        self.publisher = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(PointStamped, "/tracker/translation", self.on_translation, 10)
        self.create_timer(0.1, self.on_timer)

    def on_translation(self, message):
        """Keep the position; the optical frame has x to the right and z forward."""
        self.seen = self.get_clock().now()
        self.forward, self.left = message.point.z, -message.point.x

    def on_timer(self):
        """Publish a command, at most 0.5 m/s; zero if the last position is older than half a second."""
        command = Twist()
        if self.seen and (self.get_clock().now() - self.seen).nanoseconds < 5e8:
            command.linear.x = min(0.5 * max(self.forward - 1.5, 0.0), 0.5)
            command.angular.z = 1.0 * math.atan2(self.left, self.forward)
        self.publisher.publish(command)


if __name__ == "__main__":
    run(FollowPerson)
