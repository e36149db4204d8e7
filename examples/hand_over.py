"""Publish a position for a hand-over: the right wrist, while it is visible, certain, and held still.

python3 examples/hand_over.py    # hand; --ros-args -p frame:=base_link

One camera needs the height, given or measured by depth or a floor: else the distance is uncertain, and nothing comes.
"""

import numpy as np
from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node

from lassokin_ros import joints
from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, Stillness, covariance, position

ACROSS, ALONG, STILL = 0.1, 0.3, 0.1  # m: largest deviations across the most uncertain direction and along it; motion


class HandOver(Node):
    """Silent while the wrist is hidden, moves, is in doubt or guessed; TF or the image is 0.5 s old."""

    def __init__(self):
        super().__init__("hand_over")
        self.watch = PeopleWatch(self, frame=self.declare_parameter("frame", "").value)
        self.publisher, self.still = self.create_publisher(PointStamped, "hand", 10), Stillness(seconds=0.5)
        self.watch.subscribe("skeleton", self.on_skeleton)

    def on_skeleton(self, message):
        """Publish the wrist in the parameter `frame`; if it is empty, in that of the tracker."""
        body = self.watch.joints(message)
        if body is None or not (wrist := body[joints.RIGHT_WRIST])["observed"]:
            return
        _, across, along = np.linalg.eigvalsh(covariance(wrist))  # m^2
        still = self.still.moved(message.header.stamp, position(wrist)) < STILL
        if still and across < ACROSS**2 and along < ALONG**2:
            message.header.frame_id, (x, y, z) = self.watch.frame_id, position(wrist).tolist()
            self.publisher.publish(PointStamped(header=message.header, point=Point(x=x, y=y, z=z)))


if __name__ == "__main__":
    run(HandOver)
