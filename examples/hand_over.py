"""Publish a position for a hand-over: the right wrist, while it is visible and its deviation is small.

python3 examples/hand_over.py
"""

import numpy as np
from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node

from lassokin_ros import joints
from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, covariance, points, position

ACROSS, ALONG = 0.1, 0.3  # m: largest deviations across the direction of the least certainty, and along it


class HandOver(Node):
    """Reads position and covariance of one joint; silent while it is hidden, in doubt, or 0.5 s old."""

    def __init__(self):
        super().__init__("hand_over")
        self.publisher = self.create_publisher(PointStamped, "hand", 10)
        PeopleWatch(self).subscribe("skeleton", self.on_skeleton)

    def on_skeleton(self, message):
        """Publish the wrist in the frame of the message: the camera's optical frame, or the tracker's fixed_frame."""
        wrist = points(message)[joints.RIGHT_WRIST]
        _, across, along = np.linalg.eigvalsh(covariance(wrist))  # m^2
        if wrist["observed"] and across < ACROSS**2 and along < ALONG**2:
            x, y, z = position(wrist).tolist()
            self.publisher.publish(PointStamped(header=message.header, point=Point(x=x, y=y, z=z)))


if __name__ == "__main__":
    run(HandOver)
