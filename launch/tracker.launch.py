"""The tracker with robot_state_publisher: ros2 launch lassokin_ros tracker.launch.py keypoints:=/detector/keypoints."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHARE = Path(__file__).resolve().parent.parent


def generate_launch_description() -> LaunchDescription:
    """Arguments: keypoints, camera_info (topics), params (YAML file), use_sim_time."""
    arguments = [
        DeclareLaunchArgument("keypoints", default_value="keypoints", description="topic of the 2D keypoints"),
        DeclareLaunchArgument(
            "camera_info", default_value="camera_info", description="topic of the camera's intrinsics"
        ),
        DeclareLaunchArgument(
            "params", default_value=str(SHARE / "config" / "tracker.yaml"), description="YAML file of parameters"
        ),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="time from /clock (bags, simulation)"),
    ]
    sim_time = {"use_sim_time": LaunchConfiguration("use_sim_time")}
    tracker = Node(
        package="lassokin_ros",
        executable="tracker",
        name="tracker",
        output="screen",
        parameters=[LaunchConfiguration("params"), sim_time],
        remappings=[
            ("keypoints", LaunchConfiguration("keypoints")),
            ("camera_info", LaunchConfiguration("camera_info")),
        ],
    )
    # Without publish_frequency it passes on 20 joint states a second and drops the rest.
    frames = Node(
        package="robot_state_publisher",
        executable="robot_state_publisher",
        parameters=[{"publish_frequency": 120.0}, sim_time],
    )
    return LaunchDescription([*arguments, tracker, frames])
