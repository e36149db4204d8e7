"""Publish where on the floor the tracked person points, with its covariance, while a hand points.

python3 examples/pointing.py    # the tracker has hands, and a fixed_frame with z up and the floor at z = 0
"""

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node

from lassokin_ros.gestures import GESTURES, on_floor
from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, points


class Pointing(Node):
    """Silent while no hand points at the floor, in doubt, and if the message is 0.5 s old."""

    def __init__(self):
        super().__init__("pointing")
        self.publisher = self.create_publisher(PoseWithCovarianceStamped, "pointed_at", 10)
        PeopleWatch(self).subscribe("hands", self.on_hands)

    def on_hands(self, message):
        """Follow the ray of a pointing hand to the floor, up to a deviation of 1 m."""
        for hand in points(message).reshape(-1, 21):
            place, covariance = on_floor(hand)
            points_at = hand[0]["gesture"] == GESTURES.index("pointing") and hand[8]["observed"]
            if points_at and covariance.trace() < 1.0:
                target = PoseWithCovarianceStamped(header=message.header)
                target.pose.pose.position.x, target.pose.pose.position.y = place.tolist()
                target.pose.covariance.reshape(6, 6)[:2, :2] = covariance
                self.publisher.publish(target)


if __name__ == "__main__":
    run(Pointing)
