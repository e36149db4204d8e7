"""Log when the left hand is raised above the head.

python3 examples/raised_hand.py
"""

from geometry_msgs.msg import PoseArray
from rclpy.node import Node

from lassokin_ros import joints
from lassokin_ros.node.executable import run


class RaisedHand(Node):
    """Compares the height of wrist and head; nothing happens while nobody is tracked."""

    def __init__(self):
        super().__init__("raised_hand")
        self.raised = False
        self.create_subscription(PoseArray, "/tracker/joints", self.on_joints, 10)

    def on_joints(self, message):
        """Compare heights in the optical frame, where y points down."""
        head, wrist = message.poses[joints.HEAD].position, message.poses[joints.LEFT_WRIST].position
        raised = wrist.y < head.y
        if raised and not self.raised:
            self.get_logger().info("left hand raised")
        self.raised = raised


if __name__ == "__main__":
    run(RaisedHand)
