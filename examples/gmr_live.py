"""Feed GMR (general_motion_retargeting) live: joint_commands of a robot for which GMR has a model.

python3 examples/gmr_live.py --ros-args -p robot:=unitree_g1 -p pelvis:=0.79    # m, of the standing robot's pelvis

GMR scales by heights of the pelvis; the orientations of arms, which one camera hardly shows, are not used.
"""

import numpy as np
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from lassokin_ros import joints
from lassokin_ros.node.executable import run
from lassokin_ros.watch import PeopleWatch, points, position

ARMS = {f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist")}
FIRST = 60  # images of a standing person, from which the height of the pelvis is taken


def human(seen: np.ndarray, floor: float = 0.0) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return what GMR calls human data: place (3,) m, z up, and quaternion (4,) w, x, y, z, of each joint by name.

    seen: (24,) points of ~/skeleton. floor: m, its height, see `pelvis_height`.
    """
    level, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [[float(seen[0][f"up_{axis}"]) for axis in "xyz"]])
    places = level.apply(position(seen).T) - [0.0, 0.0, floor]
    turns = level * Rotation.from_quat(np.stack([seen[name] for name in ("qx", "qy", "qz", "qw")], axis=1))
    return dict(zip(joints.NAMES, zip(places, turns.as_quat(scalar_first=True))))


def pelvis_height(images: list) -> tuple[float, float]:
    """Return the heights, m, of the floor and of the pelvis above it. images: what `human` returned for floor 0."""
    places = np.array([[place for place, _ in image.values()] for image in images])
    floor = float(np.percentile(places[:, [joints.LEFT_FOOT, joints.RIGHT_FOOT], 2].min(axis=1), 10))
    return floor, float(np.median(places[:, joints.PELVIS, 2])) - floor


def height_for_gmr(robot: float, person: float) -> float:
    """Return GMR's actual_human_height, m. robot, person: m, heights of the pelvis of both, standing.

    GMR's tables are for 1.8 m and shrink the pelvis's height to 0.9 of it.
    """
    return 1.8 * robot / (0.9 * person)


def without_arm_turns(retargeting) -> None:
    """Let a GeneralMotionRetargeting use the places of the arms alone."""
    for tasks in (retargeting.human_body_to_task1, retargeting.human_body_to_task2):
        for body in ARMS & tasks.keys():
            tasks[body].set_orientation_cost(0.0)


class GmrLive(Node):
    """Retargets each certain image; it takes GMR about 20 ms."""

    def __init__(self):
        super().__init__("gmr_live")
        self.robot = self.declare_parameter("robot", "unitree_g1").value
        self.pelvis = self.declare_parameter("pelvis", 0.79).value
        self.first, self.floor, self.gmr, self.names = [], 0.0, None, []
        self.publisher = self.create_publisher(JointState, "joint_commands", 10)
        PeopleWatch(self).subscribe("skeleton", self.on_skeleton)

    def on_skeleton(self, message):
        """Measure the person in the first images; then publish."""
        seen = points(message)
        if self.gmr is None:
            self.first.append(human(seen))
            if len(self.first) == FIRST:
                self.start()
            return
        body = {name: value for name, value in human(seen, self.floor).items() if name in self.gmr.human_scale_table}
        q = self.gmr.retarget(body)
        self.publisher.publish(JointState(header=message.header, name=self.names, position=q[7:].tolist()))

    def start(self):
        """Make GMR's object for the person's height."""
        from general_motion_retargeting import GeneralMotionRetargeting

        self.floor, person = pelvis_height(self.first)
        self.gmr = GeneralMotionRetargeting("smplx", self.robot, height_for_gmr(self.pelvis, person))
        without_arm_turns(self.gmr)
        self.names = [self.gmr.model.joint(index).name for index in range(1, self.gmr.model.njnt)]


if __name__ == "__main__":
    run(GmrLive)
