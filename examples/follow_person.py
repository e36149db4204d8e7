"""Follow a person at 1.5 m: a Twist on cmd_vel, zero at once if the person is lost or anything is late.

ros2 run lassokin_ros tracker --ros-args -p lock:=true ...    # never another person
python3 examples/follow_person.py    # --ros-args -p camera_frame:=NAME: the optical frame of the robot's camera
"""

import math

from geometry_msgs.msg import Twist
from rclpy.node import Node

from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, camera_frame


class FollowPerson(Node):
    """Drives at most 0.5 m/s and 1 rad/s, and speeds up by at most 0.5 m/s^2."""

    def __init__(self):
        super().__init__("follow_person")
        self.people, self.speed = PeopleWatch(self, frame=camera_frame(self)), 0.0
        self.publisher = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_timer(0.05, self.on_timer)

    def on_timer(self):
        """Drive to a person who is tracked now, and surely the same as before."""
        command = Twist()
        for person in self.people.followed()[:1]:
            wanted = min(0.5 * max(float(person["z"]) - 1.5, 0.0), 0.5)
            command.linear.x = min(wanted, self.speed + 0.5 * 0.05)
            command.angular.z = max(min(math.atan2(-person["x"], person["z"]), 1.0), -1.0)
        self.speed = command.linear.x
        self.publisher.publish(command)


if __name__ == "__main__":
    run(FollowPerson)
