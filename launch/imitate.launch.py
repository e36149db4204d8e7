"""The tracker, and a humanoid that imitates the person: the node imitate, off until it is enabled.

ros2 launch lassokin_ros imitate.launch.py robot:=g1 urdf:=/path/to/g1_29dof.urdf keypoints:=/detector/keypoints
ros2 service call /enable std_srvs/srv/SetBool "{data: true}"

It takes the arguments of tracker.launch.py. The robot's links are in TF, under robot/: a static transform from the
tracker's frame to robot/<base> places them beside the person in RViz.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

TRACKER = Path(__file__).resolve().parent / "tracker.launch.py"
ARGUMENTS = {
    "robot": (None, "the robot's file: g1, h1, h1_2, talos, or the path of a YAML file"),
    "urdf": (None, "path of the robot's URDF"),
    "free_base": ("false", "command the legs and the base, too"),
    "robot_model": ("true", "publish TF of the commanded robot, with a robot_state_publisher"),
}


def generate_launch_description() -> LaunchDescription:
    """Arguments: those of ARGUMENTS, and those of tracker.launch.py."""
    arguments = [
        DeclareLaunchArgument(name, description=text, **({} if default is None else {"default_value": default}))
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list:
    given = {name: str(context.launch_configurations[name]).strip() for name in ARGUMENTS}
    urdf = Path(given["urdf"]).expanduser()
    if not urdf.is_file():
        raise RuntimeError(f"urdf:={given['urdf']}; expected the path of the robot's URDF")
    namespace = str(context.launch_configurations.get("namespace", ""))
    description = ParameterValue(urdf.read_text(encoding="utf-8"), value_type=str)
    free = given["free_base"].lower() in ("true", "1", "yes", "on")
    imitate = Node(
        package="lassokin_ros",
        executable="imitate",
        namespace=namespace,
        output="screen",
        parameters=[{"robot": given["robot"], "robot_description": description, "free_base": free}],
    )
    shown = Node(
        package="robot_state_publisher",
        executable="robot_state_publisher",
        name="imitated_robot_state_publisher",
        namespace=namespace,
        parameters=[{"robot_description": description, "frame_prefix": "robot/", "publish_frequency": 120.0}],
        remappings=[("joint_states", "joint_commands"), ("robot_description", "imitated_robot_description")],
    )
    tracker = IncludeLaunchDescription(PythonLaunchDescriptionSource(str(TRACKER)))
    return [tracker, imitate, *([shown] if given["robot_model"].lower() in ("true", "1", "yes", "on") else [])]
