"""Log when the left hand is raised above the head.

python3 examples/raised_hand.py
"""

from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from lassokin_ros import joints
from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, points, position


class RaisedHand(Node):
    """Compares wrist and head along the body. Nothing is raised while nobody is tracked, or in a pose 0.5 s old."""

    def __init__(self):
        super().__init__("raised_hand")
        self.people, self.raised = PeopleWatch(self), False
        self.create_subscription(PointCloud2, "/tracker/skeleton", self.on_skeleton, 10)

    def on_skeleton(self, message):
        """Compare along the line from the pelvis to the head: in a fixed frame z points up, in the optical one -y."""
        body = position(points(message)).T
        up = body[joints.HEAD] - body[joints.PELVIS]
        raised = self.people.fresh(message.header) and (body[joints.LEFT_WRIST] - body[joints.HEAD]) @ up > 0
        if raised and not self.raised:
            self.get_logger().info("left hand raised")
        self.raised = raised


if __name__ == "__main__":
    run(RaisedHand)
