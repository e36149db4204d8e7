"""Publish where a robot looks at a person: the head, in a frame of the robot.

python3 examples/gaze.py    # gaze; --ros-args -p frame:=base_link
"""

from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node

from lassokin_ros import joints
from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, position


class Gaze(Node):
    """Silent while the head is hidden, the person in doubt or guessed, TF or the image 0.5 s old."""

    def __init__(self):
        super().__init__("gaze")
        self.watch = PeopleWatch(self, frame=self.declare_parameter("frame", "base_link").value)
        self.publisher = self.create_publisher(PointStamped, "gaze", 10)
        self.watch.subscribe("skeleton", self.on_skeleton)

    def on_skeleton(self, message):
        """Publish the head of the person, at the time of the image."""
        body = self.watch.joints(message)
        if body is not None and body[joints.HEAD]["observed"]:
            x, y, z = position(body[joints.HEAD]).tolist()
            target = PointStamped(header=message.header, point=Point(x=x, y=y, z=z))
            target.header.frame_id = self.watch.frame_id
            self.publisher.publish(target)


if __name__ == "__main__":
    run(Gaze)
