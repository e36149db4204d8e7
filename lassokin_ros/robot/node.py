"""The node `imitate`: joint commands of a robot that imitates the person of a tracker. Off until `enable` is called.

It holds whenever it is not sure whom it follows or where the joints are, and says why on `imitating`. What a robot does
with the commands, balance above all, is the business of its controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import String
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from lassokin_ros import joints
from lassokin_ros.robot.imitation import Imitation
from lassokin_ros.robot.model import RobotModel
from lassokin_ros.robot.person import Person
from lassokin_ros.robot.robot_file import SHIPPED, SIDES, RobotError, load_robot
from lassokin_ros.watch import PeopleWatch, points, position

FOLLOWING, HOLDING = "following", "holding"
JOINT_STATE, TRAJECTORY = "joint_state", "trajectory"
RATES = 20.0, 1000.0
"""Hz"""
LONGEST_INTERVAL_S = 0.1
"""s between two images, in which the robot's targets reach the newer one; a longer gap counts as this one."""
FAR_RAD = 0.1
"""rad (m): a robot's joint that is further outside its limits is not commanded."""
PARAMETERS: dict[str, tuple[Any, str]] = {
    "robot": ("", f"the robot's file: {', '.join(SHIPPED)}, or a path; docs/humanoids.md has its table"),
    "robot_description": ("", "URDF of the robot; empty: the topic robot_description"),
    "tracker": ("tracker", "name of the tracker's node, in this node's namespace unless it starts with a slash"),
    "free_base": (False, "command the legs and the base, too: a reference, which needs a controller that balances"),
    "base_frame": ("odom", "frame of base_target, z up, the floor at z = 0"),
    "rate": (100.0, f"Hz, of the commands, {RATES[0]:g} to {RATES[1]:g}"),
    "commands": (JOINT_STATE, f"{JOINT_STATE}: sensor_msgs/JointState; {TRAJECTORY}: trajectory_msgs/JointTrajectory"),
    "stale_after": (0.3, "s: hold if the newest certain image of the person is older"),
    "solver": ("proxqp", "any dense solver of qpsolvers that is installed"),
}
"""Default value and description of each parameter."""


class ImitateNode(Node):
    """Reads ~/skeleton and ~/people of a tracker and the robot's robot_description and joint_states."""

    def __init__(self, node_name: str = "imitate", **options: Any) -> None:
        """options: of rclpy's Node. Raises RobotError."""
        super().__init__(node_name, **options)
        self._given = {name: self._declare(name) for name in PARAMETERS}
        rate, commands = self._given["rate"], self._given["commands"]
        if not RATES[0] <= rate <= RATES[1]:
            raise RobotError(f"rate is {rate:g} Hz; expected {RATES[0]:g} to {RATES[1]:g}")
        if commands not in (JOINT_STATE, TRAJECTORY):
            raise RobotError(f"commands is '{commands}'; expected {JOINT_STATE} or {TRAJECTORY}")
        self._robot_file = load_robot(self._given["robot"])
        self._robot: Imitation | None = None
        self._enabled, self._person, self._why = False, -1, "not enabled: call the service enable"
        self._stamp_ns: int | None = None  # of the newest image that the robot was shown
        self._seen_ns: int | None = None  # of the newest certain image
        self._measured: dict[str, float] = {}
        self._said = ""
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        kind = JointState if commands == JOINT_STATE else JointTrajectory
        self._commands = self.create_publisher(kind, "joint_commands", 10)
        self._base = self.create_publisher(PoseStamped, "base_target", 10) if self._given["free_base"] else None
        self._imitating = self.create_publisher(String, "imitating", latched)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_service(SetBool, "enable", self._on_enable)
        self.create_subscription(JointState, "joint_states", self._on_joint_states, 10)
        if self._given["robot_description"]:
            self._load(self._given["robot_description"])
        else:
            self.create_subscription(String, "robot_description", self._on_description, latched)
        self._watch = PeopleWatch(self, self._given["tracker"])
        self._watch.subscribe("skeleton", self._on_skeleton)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1 / rate, self._on_timer, clock=steady)
        self.create_timer(1.0, self._diagnose, clock=steady)
        self._say()

    def _declare(self, name: str) -> Any:
        value, description = PARAMETERS[name]
        return self.declare_parameter(name, value, ParameterDescriptor(description=description, read_only=True)).value

    def _load(self, urdf: str) -> None:
        """Use a URDF. One that does not fit is said, and the robot holds; another one ends what was enabled."""
        self._robot, self._enabled = None, False
        try:
            model = RobotModel(urdf, self._robot_file, self._given["free_base"])
            self._robot = Imitation(model, self._given["rate"], self._given["solver"])
            self._why = "not enabled: call the service enable"
            self.get_logger().info(f"{self._robot_file.name}: {len(model.names)} joints are commanded")
        except RobotError as error:
            self._why = str(error)
            self.get_logger().error(self._why)
        self._say()

    def _on_description(self, message: String) -> None:
        self._load(message.data)

    def _on_joint_states(self, message: JointState) -> None:
        self._measured.update(zip(message.name, message.position))

    def _on_enable(self, request: Any, response: Any) -> Any:
        """Begin at the measured joints, or at rest; or stop. The person who is followed then is the only one."""
        response.success, response.message = self._enable() if request.data else (True, "disabled: holding")
        if not request.data:
            self._enabled, self._why = False, "not enabled: call the service enable"
            if self._robot is not None:
                self._robot.hold()
        self._say()
        return response

    def _enable(self) -> tuple[bool, str]:
        if self._robot is None:
            return False, f"there is no robot: {self._why or 'robot_description was not received'}"
        model = self._robot.model
        known = [self._measured.get(name, np.nan) for name in model.names]
        start = np.where(np.isfinite(known), known, self._robot.positions)
        outside = np.maximum(model.lowest - start, start - model.highest)
        if outside.max() > FAR_RAD:
            worst = int(np.argmax(outside))
            low, high = model.lowest[worst], model.highest[worst]
            return False, f"{model.names[worst]} is at {start[worst]:.2f}; expected {low:.2f} to {high:.2f}"
        if not self._enabled:
            self._robot.place(start)
        self._enabled, self._person, self._why = True, -1, "nobody was seen yet"
        self._stamp_ns = self._seen_ns = None
        words = "" if np.isfinite(known).all() else "; joint_states were not received: it begins at its rest angles"
        return True, f"enabled{words}"

    def _on_skeleton(self, message: PointCloud2) -> None:
        """Use a skeleton that is fresh and certain, see PeopleWatch."""
        if self._robot is None or not self._enabled:
            return
        stamp_ns = self._seen_ns = Time.from_msg(message.header.stamp).nanoseconds
        seen, people = points(message), self._watch.followed()
        if len(seen) != len(joints.NAMES) or "up_x" not in (seen.dtype.names or ()):
            return self._hold(
                f"the skeleton has {len(seen)} joints; expected the built-in one, and a tracker of this release"
            )
        if len(people) != 1:
            several = f"{len(people)} people are tracked; lock one with the tracker's service lock"
            return self._hold(several if len(people) else "nobody certain is tracked")
        person = int(people["person"][0])
        if self._person not in (-1, person):
            return self._hold("another person is tracked; call the service enable to follow this one")
        observed = seen["observed"] == 1
        if not observed[[joints.LEFT_SHOULDER, joints.RIGHT_SHOULDER]].all():
            return self._hold("the shoulders are not seen")
        ankles = [joints.INDEX[f"{side}_ankle"] for side in SIDES]
        if self._given["free_base"] and not observed[ankles].any():
            return self._hold("the feet are not seen")
        up = np.array([seen[name][0] for name in ("up_x", "up_y", "up_z")], dtype=float)
        before_ns = stamp_ns if self._stamp_ns is None else self._stamp_ns
        interval = min(max((stamp_ns - before_ns) * 1e-9, 0.0), LONGEST_INTERVAL_S)
        view = Person(position(seen).T, observed, up, seen["contact"][ankles] == 1)
        refused, self._stamp_ns = self._robot.see(view, interval), stamp_ns
        if not refused:
            self._person = person
        self._give_reason(refused)  # the robot holds already

    def _hold(self, why: str) -> None:
        assert self._robot is not None
        self._robot.hold()
        self._give_reason(why)

    def _give_reason(self, why: str) -> None:
        self._why = why
        self._say()

    def _on_timer(self) -> None:
        """Publish the next command."""
        if self._robot is None or not self._enabled:
            return
        now = self.get_clock().now()
        if self._seen_ns is not None and (now.nanoseconds - self._seen_ns) * 1e-9 > self._given["stale_after"]:
            self._hold(f"nobody certain was seen for {self._given['stale_after']:g} s")
        self._robot.step()
        self._publish(now)

    def _publish(self, now: Time) -> None:
        assert self._robot is not None
        names, place, speed = list(self._robot.model.names), self._robot.positions.tolist(), self._robot.speeds.tolist()
        if self._given["commands"] == JOINT_STATE:
            command: Any = JointState(name=names, position=place, velocity=speed)
        else:
            ahead = Duration(seconds=1 / self._given["rate"]).to_msg()
            point = JointTrajectoryPoint(positions=place, velocities=speed, time_from_start=ahead)
            command = JointTrajectory(joint_names=names, points=[point])
        command.header.stamp = now.to_msg()
        self._commands.publish(command)
        if self._base is not None:
            target = PoseStamped()
            target.header.stamp, target.header.frame_id = now.to_msg(), self._given["base_frame"]
            p, q = target.pose.position, target.pose.orientation
            p.x, p.y, p.z, q.x, q.y, q.z, q.w = self._robot.base.tolist()
            self._base.publish(target)

    @property
    def _state(self) -> str:
        return f"{HOLDING}: {self._why}" if self._why else FOLLOWING

    def _say(self) -> None:
        """Publish and log the state if it has changed."""
        if self._state != self._said:
            self._said = self._state
            self._imitating.publish(String(data=self._state))
            self.get_logger().info(self._state)

    def _diagnose(self) -> None:
        status = DiagnosticStatus(name=f"{self.get_fully_qualified_name()[1:]}: imitation", message=self._state)
        status.level = DiagnosticStatus.WARN if self._why and self._enabled else DiagnosticStatus.OK
        values: Sequence[tuple[str, Any]] = [("robot", self._robot_file.name), ("enabled", self._enabled)]
        if self._robot is not None:
            values = [*values, ("unsolved ticks", self._robot.unsolved), ("speed share", f"{self._robot.share:.2f}")]
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
