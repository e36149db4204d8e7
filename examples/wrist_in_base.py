"""Publish the right wrist in base_link, through TF.

It needs tf2_ros and tf2_geometry_msgs, which package.xml does not require:
sudo apt install ros-jazzy-tf2-ros-py ros-jazzy-tf2-geometry-msgs

python3 examples/wrist_in_base.py
"""

import tf2_geometry_msgs  # noqa: F401  (registers PointStamped with tf2)
from geometry_msgs.msg import PointStamped, PoseArray
from rclpy.node import Node
from tf2_ros import Buffer, TransformException, TransformListener

from lassokin_ros import joints
from lassokin_ros.node.executable import run


class WristInBase(Node):
    """Transforms each wrist; warns if TF is missing; silent while nobody is tracked."""

    def __init__(self):
        super().__init__("wrist_in_base")
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.publisher = self.create_publisher(PointStamped, "right_wrist", 10)
        self.create_subscription(PoseArray, "/tracker/joints", self.on_joints, 10)

    def on_joints(self, message):
        """Transform the wrist from the optical frame to base_link."""
        point = PointStamped(header=message.header, point=message.poses[joints.RIGHT_WRIST].position)
        try:
            point = self.buffer.transform(point, "base_link")
        except TransformException as error:
            return self.get_logger().warn(str(error), throttle_duration_sec=5.0)
        self.publisher.publish(point)


if __name__ == "__main__":
    run(WristInBase)
