"""Log when the left hand is raised above the head.

python3 examples/raised_hand.py
"""

from rclpy.node import Node

from lassokin_ros import joints
from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, points, position


class RaisedHand(Node):
    """Compares wrist and head along the body, unless the wrist is out of view: the pose prior may raise such an arm.

    Poses in doubt, of a person who is guessed, or 0.5 s old are left out.
    """

    def __init__(self):
        super().__init__("raised_hand")
        self.raised = False
        PeopleWatch(self).subscribe("skeleton", self.on_skeleton)

    def on_skeleton(self, message):
        """Compare along the line from the pelvis to the head: in a fixed frame z points up, in the optical one -y."""
        body = position(seen := points(message)).T
        up = body[joints.HEAD] - body[joints.PELVIS]
        raised = seen["observed"][joints.LEFT_WRIST] and (body[joints.LEFT_WRIST] - body[joints.HEAD]) @ up > 0
        if raised and not self.raised:
            self.get_logger().info("left hand raised")
        self.raised = raised


if __name__ == "__main__":
    run(RaisedHand)
