"""Start a camera, the detector and the tracker: `ros2 launch lassokin_ros webcam.launch.py height:=1.8 rviz:=true`."""

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

CAMERAS = (("v4l2_camera", "v4l2_camera_node"), ("usb_cam", "usb_cam_node_exe"))


def camera_action():
    """Return the first camera driver that is installed."""
    for package, executable in CAMERAS:
        try:
            get_package_share_directory(package)
        except PackageNotFoundError:
            continue
        return Node(package=package, executable=executable, name="camera", output="screen")
    return LogInfo(msg="no camera driver is installed: sudo apt install ros-jazzy-v4l2-camera")


def generate_launch_description():
    """Return the camera, the detector, the tracker and, on request, RViz."""
    share = get_package_share_directory("lassokin_ros")
    height = ParameterValue(LaunchConfiguration("height"), value_type=float)
    return LaunchDescription(
        [
            DeclareLaunchArgument("height", default_value="1.75", description="height of the person [m]"),
            DeclareLaunchArgument("detector", default_value="mediapipe", description="mediapipe or a .onnx file"),
            DeclareLaunchArgument("landmarks", default_value="mediapipe33", description="layout of the detector"),
            DeclareLaunchArgument("rviz", default_value="false", description="start RViz"),
            camera_action(),
            Node(
                package="lassokin_ros",
                executable="detector",
                output="screen",
                parameters=[{"detector": LaunchConfiguration("detector")}],
            ),
            Node(
                package="lassokin_ros",
                executable="tracker",
                output="screen",
                parameters=[
                    {"height": height, "landmarks": LaunchConfiguration("landmarks"), "publish_tf": "all"},
                ],
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", f"{share}/config/lassokin.rviz"],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
