"""The tracker with what one looks at it with: RViz, robot_state_publisher, a recording.

ros2 launch lassokin_ros tracker.launch.py keypoints:=/detector/keypoints camera:=/camera frame:=camera_optical_frame
ros2 launch lassokin_ros tracker.launch.py params:=webcam_yolo bag:=walk rviz:=true
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from lassokin_ros.pipeline.outputs.urdf_from_parameters import urdf_from_parameters

CONFIG = Path(__file__).resolve().parent.parent / "config"
ARGUMENTS = {
    "keypoints": ("keypoints", "topic of the 2D keypoints"),
    "camera": ("", "namespace of the camera: its camera_info is read; empty for the topic camera_info"),
    "params": ("tracker", "YAML file of parameters, or the name of one in config/"),
    "frame": ("", "the camera's optical frame, on which the body hangs in TF; empty for the parameter base_frame"),
    "bag": ("", "a recording to play, with its own clock"),
    "rviz": ("false", "show RViz"),
    "frames": ("true", "TF of the limbs by robot_state_publisher (one person)"),
    "use_sim_time": ("", "time from /clock; empty: when a recording is played"),
}
STATE_PUBLISHER = "robot_state_publisher"
PUBLISH_FREQUENCY = 120.0
"""Hz; by default robot_state_publisher passes on 20 joint states a second and drops the rest."""


def generate_launch_description() -> LaunchDescription:
    """Arguments: see ARGUMENTS, or `ros2 launch lassokin_ros tracker.launch.py --show-args`."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list:
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    params = Path(given["params"])
    if not params.suffix:
        params = CONFIG / f"{params}.yaml"
    sim_time = {"use_sim_time": (given["use_sim_time"] or str(bool(given["bag"]))).lower() == "true"}
    own_frame = [{"base_frame": given["frame"]}] if given["frame"] else []
    followers = [{"state_publisher": STATE_PUBLISHER}] if given["frames"].lower() == "true" else []
    camera_info = f"{given['camera'].rstrip('/')}/camera_info" if given["camera"] else "camera_info"
    tracker = Node(
        package="lassokin_ros",
        executable="tracker",
        name="tracker",
        output="screen",
        parameters=[str(params), sim_time, *own_frame, *followers],
        remappings=[("keypoints", given["keypoints"]), ("camera_info", camera_info)],
    )
    rviz = _rviz(given["camera"].rstrip("/"), given["frame"], sim_time)
    return [tracker, _frames(params, given["frame"], sim_time), rviz, *_bag(given["bag"])]


def _frames(params: Path, frame: str, sim_time: dict) -> Node:
    """TF from joint_states.

    It publishes its URDF too, under another name: the tracker's is the first to follow the camera's frame and the
    calibrated lengths, and is handed on to it.
    """
    description = ParameterValue(urdf_from_parameters(params, frame), value_type=str)
    return Node(
        package="robot_state_publisher",
        executable="robot_state_publisher",
        name=STATE_PUBLISHER,
        parameters=[{"robot_description": description, "publish_frequency": PUBLISH_FREQUENCY}, sim_time],
        remappings=[("robot_description", "robot_state_publisher/robot_description")],
        condition=IfCondition(LaunchConfiguration("frames")),
    )


def _rviz(camera: str, frame: str, sim_time: dict) -> Node:
    """RViz with the camera's image; it derives the name of camera_info from the image's, both as they are remapped."""
    own_frame = ["-f", frame] if frame else []
    return Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", str(CONFIG / "lassokin.rviz"), *own_frame],
        parameters=[sim_time],
        remappings=[(name, f"{camera}/{name}") for name in ("image_raw", "camera_info")] if camera else [],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )


def _bag(bag: str) -> list:
    return [ExecuteProcess(cmd=["ros2", "bag", "play", bag, "--clock"], output="screen")] if bag else []
