"""Show the commands of the node imitate in MuJoCo: set them (kinematic), or follow them with torques (pd).

python3 examples/humanoid_in_mujoco.py --ros-args -p urdf:=g1_29dof.urdf -p mode:=pd    # pip install mujoco '.[robot]'

Publishes joint_states of the simulated robot. The pelvis is fixed: a standing robot needs a controller that balances.
"""

from pathlib import Path
from xml.etree import ElementTree

import mujoco.viewer
import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from lassokin_ros.node.executable import run
from lassokin_ros.robot.model import kinematic_tree

KINEMATIC, PD, PERIOD = "kinematic", "pd", 0.02  # modes; s
COMPILER = {"boundmass": "0.01", "boundinertia": "0.001", "fusestatic": "false"}
STIFFNESS, DAMPING, ARMATURE = 200.0, 5.0, 0.05  # N m/rad, N m s/rad, kg m^2 (the gears' inertia)


class Simulation:
    """A robot without shapes, so that no mesh is needed: its links are seen as their inertias."""

    def __init__(self, urdf: str, mode: str = KINEMATIC) -> None:
        """urdf: its text. Raises RobotError, ValueError for an unknown mode, or what MuJoCo says about the URDF."""
        if mode not in (KINEMATIC, PD):
            raise ValueError(f"mode is '{mode}'; expected {KINEMATIC} or {PD}")
        xml = kinematic_tree(urdf)
        for old in xml.findall("mujoco"):
            xml.remove(old)
        ElementTree.SubElement(ElementTree.SubElement(xml, "mujoco"), "compiler", COMPILER)
        self.model = mujoco.MjModel.from_xml_string(ElementTree.tostring(xml, encoding="unicode"))
        self.model.dof_armature[:] = ARMATURE
        self.data, self.mode = mujoco.MjData(self.model), mode
        joints = [self.model.joint(index) for index in range(self.model.njnt)]
        self.at = {joint.name: int(joint.qposadr[0]) for joint in joints if joint.type in (2, 3)}  # slide, hinge
        self.target = self.data.qpos.copy()

    def command(self, names, positions) -> None:
        """Set the targets, rad, of some joints; those that the robot lacks are left out."""
        for name, value in zip(names, positions):
            if name in self.at and np.isfinite(value):
                self.target[self.at[name]] = value

    def advance(self, seconds: float) -> None:
        """Move: at once, or by torques of springs and dampers that carry the robot's weight, too."""
        if self.mode == KINEMATIC:
            self.data.qpos[:] = self.target
            mujoco.mj_forward(self.model, self.data)
            return
        for _ in range(round(seconds / self.model.opt.timestep)):
            off = self.target - self.data.qpos  # a URDF with a fixed pelvis has as many speeds as positions
            self.data.qfrc_applied[:] = STIFFNESS * off - DAMPING * self.data.qvel + self.data.qfrc_bias
            mujoco.mj_step(self.model, self.data)


class HumanoidInMujoco(Node):
    """Advances at 50 Hz, and publishes where the joints are."""

    def __init__(self):
        super().__init__("humanoid_in_mujoco")
        urdf = Path(self.declare_parameter("urdf", "robot.urdf").value).read_text(encoding="utf-8")
        self.simulation = Simulation(urdf, self.declare_parameter("mode", KINEMATIC).value)
        shown = self.declare_parameter("viewer", True).value
        self.viewer = mujoco.viewer.launch_passive(self.simulation.model, self.simulation.data) if shown else None
        self.publisher = self.create_publisher(JointState, "joint_states", 10)
        self.create_subscription(JointState, "joint_commands", self.on_command, 10)
        self.create_timer(PERIOD, self.on_timer)

    def on_command(self, message):
        """Keep the newest command."""
        self.simulation.command(message.name, message.position)

    def on_timer(self):
        """Advance and publish."""
        self.simulation.advance(PERIOD)
        names, places = list(self.simulation.at), self.simulation.data.qpos
        state = JointState(name=names, position=[float(places[self.simulation.at[name]]) for name in names])
        state.header.stamp = self.get_clock().now().to_msg()
        self.publisher.publish(state)
        if self.viewer is not None:
            self.viewer.sync()


if __name__ == "__main__":
    run(HumanoidInMujoco)
