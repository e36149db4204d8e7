"""Publish a position for a hand-over: the right wrist, while it is visible and its deviation is small.

python3 examples/hand_over.py
"""

import numpy as np
from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from lassokin_ros import joints
from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, covariance, points, position

ACROSS, ALONG = 0.1, 0.3  # m: largest deviations across the direction of the least certainty, and along it


class HandOver(Node):
    """Reads position and covariance of one joint; silent while the wrist is hidden, and if it is 0.5 s old."""

    def __init__(self):
        super().__init__("hand_over")
        self.people = PeopleWatch(self)
        self.publisher = self.create_publisher(PointStamped, "hand", 10)
        self.create_subscription(PointCloud2, "/tracker/skeleton", self.on_skeleton, 10)

    def on_skeleton(self, message):
        """Publish the wrist in the frame of the message: the camera's optical frame, or the tracker's fixed_frame."""
        wrist = points(message)[joints.RIGHT_WRIST]
        _, across, along = np.linalg.eigvalsh(covariance(wrist))  # m^2
        certain = across < ACROSS**2 and along < ALONG**2
        if certain and wrist["observed"] and self.people.fresh(message.header):
            x, y, z = position(wrist).tolist()
            self.publisher.publish(PointStamped(header=message.header, point=Point(x=x, y=y, z=z)))


if __name__ == "__main__":
    run(HandOver)
