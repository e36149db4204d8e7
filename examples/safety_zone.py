"""Say whether the 2 m in front of the camera are free: "safe", "occupied" or "unknown" on the topic zone.

python3 examples/safety_zone.py    # --ros-args -p camera_frame:=NAME: the optical frame of the camera

This is no safety function in the sense of a standard. The camera must see the whole zone.
"""

import numpy as np
from rclpy.node import Node
from std_msgs.msg import String

from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, camera_frame, covariance, position

RADIUS, REACH, SIGMAS = 2.0, 0.9, 2.0  # m, m from the pelvis to a stretched hand, standard deviations


def nearest(person):
    """Return the least distance of the body from the camera, m, with the doubt along the line of sight."""
    distance = np.linalg.norm(position(person))
    sight = position(person) / distance
    return distance - REACH - SIGMAS * np.sqrt(sight @ covariance(person) @ sight)


class SafetyZone(Node):
    """Publishes 50 times per second. A person who is lost may be anywhere, and silence is not safe."""

    def __init__(self):
        super().__init__("safety_zone")
        self.people = PeopleWatch(self, frame=camera_frame(self))
        self.publisher = self.create_publisher(String, "zone", 10)
        self.create_timer(0.02, lambda: self.publisher.publish(String(data=self.verdict())))

    def verdict(self):
        """Return safe only if the images of now show that everybody is outside, or that nobody is there."""
        people, state = self.people.tracked(), self.people.state
        if any(nearest(person) < RADIUS for person in people):
            return "occupied"
        all_seen = len(people) == len(self.people.everybody())  # the place of some may be too old to be used
        shown = state == "nobody" or (state == "tracking" and len(people) > 0)
        return "safe" if all_seen and shown else "unknown"


if __name__ == "__main__":
    run(SafetyZone)
