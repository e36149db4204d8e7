"""Several people: the tracker with its tools, and RViz with everybody's topics.

ros2 launch lassokin_ros people.launch.py rviz:=true keypoints:=/detector/keypoints camera:=/camera max_people:=4

It takes the arguments of tracker.launch.py.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource

TRACKER = Path(__file__).resolve().parent / "tracker.launch.py"
ARGUMENTS = {"max_people": ("4", "people followed at once, whatever params says")}


def generate_launch_description() -> LaunchDescription:
    """Arguments: max_people, and those of tracker.launch.py. They replace the values of params."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list:
    people = str(context.launch_configurations["max_people"]).strip()
    source = PythonLaunchDescriptionSource(str(TRACKER))
    return [IncludeLaunchDescription(source, launch_arguments={"max_people": people}.items())]
