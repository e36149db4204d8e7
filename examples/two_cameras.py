"""Merge a person whom two cameras see: the position in base_link, weighted by the covariances. Needs tf2_ros.

python3 examples/two_cameras.py    # trackers left/tracker and right/tracker; TF has both cameras
"""

import numpy as np
from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node

from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, covariance, position

SIGMAS = 3.0  # largest distance of two positions of one person, in standard deviations


def merge(people):
    """Return the position (3,) m of one person, and False if the positions are those of different people."""
    places, weights = [position(one) for one in people], [np.linalg.inv(covariance(one)) for one in people]
    place = np.linalg.solve(sum(weights), sum(w @ p for w, p in zip(weights, places)))
    return place, sum((p - place) @ w @ (p - place) for w, p in zip(weights, places)) < SIGMAS**2


class TwoCameras(Node):
    """Publishes 10 times per second while at least one camera sees the person now, and no camera another one."""

    def __init__(self):
        super().__init__("two_cameras")
        self.cameras = [PeopleWatch(self, f"{side}/tracker", frame="base_link") for side in ("left", "right")]
        self.publisher = self.create_publisher(PointStamped, "person", 10)
        self.create_timer(0.1, self.on_timer)

    def on_timer(self):
        """Merge the people of both cameras."""
        people = [one for camera in self.cameras for one in camera.followed()[:1]]
        place, same = merge(people) if people else (None, False)
        if same:
            x, y, z = place.tolist()
            message = PointStamped(point=Point(x=x, y=y, z=z))
            message.header.stamp, message.header.frame_id = self.get_clock().now().to_msg(), "base_link"
            self.publisher.publish(message)
        elif people:
            self.get_logger().warn("the cameras follow two people", throttle_duration_sec=5.0)


if __name__ == "__main__":
    run(TwoCameras)
