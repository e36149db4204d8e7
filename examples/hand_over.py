"""Publish a position for a hand-over: the right wrist, while it is visible and its deviation is small.

python3 examples/hand_over.py
"""

import numpy as np
from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from lassokin_ros import joints
from lassokin_ros.node.executable import run

ACROSS, ALONG = 0.1, 0.3  # m


class HandOver(Node):
    """Reads position and deviation of one joint; silent while the wrist is hidden or nobody is tracked."""

    def __init__(self):
        super().__init__("hand_over")
        self.publisher = self.create_publisher(PointStamped, "hand", 10)
        self.create_subscription(PointCloud2, "/tracker/skeleton", self.on_skeleton, 10)

    def on_skeleton(self, message):
        """Publish the wrist in the optical frame, where z is the direction of the least certainty."""
        point = np.dtype([(field.name, "<i4" if field.datatype == field.INT32 else "<f4") for field in message.fields])
        wrist = np.frombuffer(message.data, point)[joints.RIGHT_WRIST]
        across = max(wrist["xx"], wrist["yy"]) ** 0.5
        if wrist["observed"] and across < ACROSS and wrist["zz"] ** 0.5 < ALONG:
            place = Point(x=float(wrist["x"]), y=float(wrist["y"]), z=float(wrist["z"]))
            self.publisher.publish(PointStamped(header=message.header, point=place))


if __name__ == "__main__":
    run(HandOver)
