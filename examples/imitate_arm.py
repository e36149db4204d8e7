"""Publish a target for a robot's hand: the person's right wrist relative to the shoulder, in axes of the trunk.

python3 examples/imitate_arm.py    # arm_target: x front, y left, z up, m, with covariance; silent while in doubt

Its frame_id is empty, or the parameter shoulder_frame: a frame of the robot with these axes, at its shoulder.
"""

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node

from lassokin_ros import joints
from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, covariance, points, position

SCALE, LARGEST_DEVIATION = 0.8, 0.2  # robot's arm / person's arm; m


class ImitateArm(Node):
    """Forwards a wrist that is seen, certain, and 0.5 s old at most. The robot must stop if no target comes."""

    def __init__(self):
        super().__init__("imitate_arm")
        self.frame = self.declare_parameter("shoulder_frame", "").value
        self.publisher = self.create_publisher(PoseWithCovarianceStamped, "arm_target", 10)
        PeopleWatch(self).subscribe("limbs", self.on_limbs)

    def on_limbs(self, message):
        """Publish the target, scaled to the robot's arm."""
        (wrist,) = [limb for limb in points(message) if limb["index"] == joints.RIGHT_WRIST]
        if not wrist["observed"] or wrist["deviation"] > LARGEST_DEVIATION:
            return
        target = PoseWithCovarianceStamped()
        target.header.stamp, target.header.frame_id = message.header.stamp, self.frame
        place, doubt = target.pose.pose.position, target.pose.covariance.reshape(6, 6)
        place.x, place.y, place.z = (SCALE * position(wrist)).tolist()
        doubt[:3, :3] = SCALE**2 * covariance(wrist)
        self.publisher.publish(target)


if __name__ == "__main__":
    run(ImitateArm)
