"""Several cameras in one skeleton: the tracker with its tools, in a frame with z up.

ros2 launch lassokin_ros two_cameras.launch.py fixed_frame:=map cameras:="[left, right]" rviz:=true

Each camera has the topics <name>/keypoints and <name>/camera_info, and its pose in TF. The other arguments are those of
tracker.launch.py.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource

TRACKER = Path(__file__).resolve().parent / "tracker.launch.py"
ARGUMENTS = {
    "cameras": ("[left, right]", "names of the cameras, the beginning of their topics, whatever params says"),
    "fixed_frame": ("map", "frame with z up in which the skeleton is kept and published, whatever params says"),
}


def generate_launch_description() -> LaunchDescription:
    """Arguments: cameras, fixed_frame, and those of tracker.launch.py. They replace the values of params."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list:
    given = {name: str(context.launch_configurations[name]).strip() for name in ARGUMENTS}
    source = PythonLaunchDescriptionSource(str(TRACKER))
    return [IncludeLaunchDescription(source, launch_arguments=given.items())]
