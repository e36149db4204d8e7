"""Merge a person whom two cameras see: the position in base_link, weighted by the covariances. Needs tf2_ros.

python3 examples/two_cameras.py    # trackers /left/tracker and /right/tracker; TF has both cameras
"""

import numpy as np
from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import Buffer, TransformException, TransformListener

from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, transformed


class TwoCameras(Node):
    """Publishes 10 times per second while at least one camera sees the person now."""

    def __init__(self):
        super().__init__("two_cameras")
        self.cameras = [PeopleWatch(self, f"/{side}/tracker") for side in ("left", "right")]
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.publisher = self.create_publisher(PointStamped, "person", 10)
        self.create_timer(0.1, self.on_timer)

    def on_timer(self):
        """Add the information of both cameras."""
        weight, total = np.zeros((3, 3)), np.zeros(3)
        for camera in [camera for camera in self.cameras if len(camera.tracked())]:
            try:
                moved = self.buffer.lookup_transform("base_link", camera.frame_id, Time())
            except TransformException as error:
                self.get_logger().warn(str(error), throttle_duration_sec=5.0)
                continue
            place, covariance = transformed(camera.tracked()[0], moved.transform)
            weight, total = weight + np.linalg.inv(covariance), total + np.linalg.solve(covariance, place)
        if weight.any():
            x, y, z = np.linalg.solve(weight, total).tolist()
            message = PointStamped(point=Point(x=x, y=y, z=z))
            message.header.stamp, message.header.frame_id = self.get_clock().now().to_msg(), "base_link"
            self.publisher.publish(message)


if __name__ == "__main__":
    run(TwoCameras)
