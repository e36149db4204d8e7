"""Joint commands of one robot arm, a URDF with one chain, from the target of imitate_arm.py: arm_target.

python3 examples/imitate_arm_joints.py --ros-args -p urdf:=arm.urdf -p tip:=tool0    # pip install '.[robot]'

The URDF's base is taken for the shoulder: x front, y left, z up. The arm stays when no target comes: the person is not
seen, or doubtful. Joints stay in their limits; no joint is faster than 1 rad/s.
"""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pink
import pinocchio as pin
import qpsolvers
from geometry_msgs.msg import PoseWithCovarianceStamped
from pink.solve_ik import build_ik
from rclpy.node import Node
from sensor_msgs.msg import JointState

from lassokin_ros.node.executable import run
from lassokin_ros.robot.model import kinematic_tree

RATE, SPEED, STALE_S = 100.0, 1.0, 0.3  # Hz; rad/s; s


class Arm:
    """An arm whose tip goes to a place. positions: (n,) rad of `names`."""

    def __init__(self, urdf: str, tip: str) -> None:
        """urdf: its text. tip: a link. Raises RobotError, or ValueError for a link that the URDF lacks."""
        model = pin.buildModelFromXML(ElementTree.tostring(kinematic_tree(urdf), encoding="unicode"))
        if not model.existBodyName(tip):
            raise ValueError(f"the URDF has no link '{tip}'; expected one of {[frame.name for frame in model.frames]}")
        self.speed = np.minimum(np.where(model.velocityLimit > 0, model.velocityLimit, SPEED), SPEED)
        middle = np.clip(pin.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
        self.names, self.configuration = list(model.names)[1:], pink.Configuration(model, model.createData(), middle)
        self.task = pink.FrameTask(tip, position_cost=1.0, orientation_cost=0.0, gain=0.2)
        self.rest = pink.PostureTask(cost=1e-3)
        self.rest.set_target(middle)

    def step(self, place: np.ndarray, seconds: float) -> np.ndarray:
        """Return the positions (n,) rad after `seconds`. place: (3,) m, of the tip in axes of the base."""
        self.task.set_target(pin.SE3(np.eye(3), place))
        model, q, step = self.configuration.model, self.configuration.q, self.speed * seconds
        problem = build_ik(self.configuration, [self.task, self.rest], seconds, limits=[])
        problem.lb = np.maximum(model.lowerPositionLimit - q, -step)  # one box, never empty: q is in its limits
        problem.ub = np.minimum(model.upperPositionLimit - q, step)
        solution = qpsolvers.solve_problem(problem, "proxqp").x
        if solution is not None and np.isfinite(solution).all():
            moved = q + np.clip(solution, problem.lb, problem.ub)
            self.configuration.update(np.clip(moved, model.lowerPositionLimit, model.upperPositionLimit))
        return self.configuration.q


class ImitateArmJoints(Node):
    """Publishes joint_commands at 100 Hz while targets come."""

    def __init__(self):
        super().__init__("imitate_arm_joints")
        urdf = Path(self.declare_parameter("urdf", "arm.urdf").value).read_text(encoding="utf-8")
        self.arm, self.place, self.seen_ns = Arm(urdf, self.declare_parameter("tip", "tool0").value), None, 0
        self.publisher = self.create_publisher(JointState, "joint_commands", 10)
        self.create_subscription(PoseWithCovarianceStamped, "arm_target", self.on_target, 10)
        self.create_timer(1 / RATE, self.on_timer)

    def on_target(self, message):
        """Keep a target without NaN."""
        place = message.pose.pose.position
        if np.isfinite(target := np.array([place.x, place.y, place.z])).all():
            self.place, self.seen_ns = target, self.get_clock().now().nanoseconds

    def on_timer(self):
        """Go towards the target, unless it is old."""
        now = self.get_clock().now()
        if self.place is None or (now.nanoseconds - self.seen_ns) * 1e-9 > STALE_S:
            return
        command = JointState(name=self.arm.names, position=self.arm.step(self.place, 1 / RATE).tolist())
        command.header.stamp = now.to_msg()
        self.publisher.publish(command)


if __name__ == "__main__":
    run(ImitateArmJoints)
