"""The arguments of tracker.launch.py with the real launch and launch_ros, which PyPI does not have."""

import re
from pathlib import Path

import pytest

pytest.importorskip("launch_ros", reason="launch_ros is not installed; it is part of ROS 2 and not on PyPI")

from launch import LaunchContext  # noqa: E402
from launch.actions import ExecuteProcess  # noqa: E402
from launch.launch_description_sources import get_launch_description_from_python_launch_file  # noqa: E402
from launch_ros.actions import Node  # noqa: E402

FILE = Path(__file__).resolve().parents[2] / "launch" / "tracker.launch.py"


def actions_for(**given):
    """The result of the launch file for these arguments. Nothing is started."""
    context = LaunchContext()
    context.launch_configurations.update(given)
    found = []
    for entity in get_launch_description_from_python_launch_file(str(FILE)).entities:
        found += entity.visit(context) or []
    return [action for action in found if isinstance(action, ExecuteProcess)]


def test_every_argument_has_a_description():
    arguments = get_launch_description_from_python_launch_file(str(FILE)).get_launch_arguments()
    assert {"keypoints", "height", "fixed_frame", "namespace"} <= {argument.name for argument in arguments}
    assert all(argument.description for argument in arguments)


@pytest.mark.parametrize("text, rviz", [("true", True), ("1", True), ("False", False), ("no", False)])
def test_booleans_select_the_started_nodes(text, rviz):
    nodes = [action for action in actions_for(rviz=text) if isinstance(action, Node)]
    assert len(nodes) == 2 + rviz  # the tracker, the human's robot_state_publisher, RViz


@pytest.mark.parametrize(
    "given, words",
    [
        ({"rviz": "maybe"}, "rviz:=maybe; expected one of"),
        ({"frames": "never"}, "frames:=never"),
        ({"use_sim_time": "2"}, "use_sim_time:=2"),
        ({"height": "9"}, "0 to 2.6 m"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_returned(given, words):
    with pytest.raises(Exception, match=re.escape(words)):
        actions_for(**given)
