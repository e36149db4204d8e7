"""The README's commands: each is run, parsed by the command's own parser, or compared with the code.

Not run here: `git clone`, `rosdep` and `colcon` (test/package/test_colcon.py), pip, `make demo` (test/demo), a webcam
and ROS' launch (test/launch).
"""

import importlib.util
import re
import shlex
from pathlib import Path

import pytest
from recordings import write_recording

from lassokin_ros.cli.lassokin import COMMANDS
from lassokin_ros.cli.replay import main as replay
from lassokin_ros.cli.replay import parser as replay_parser
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.parameter_files import all_settings
from lassokin_ros.video.command import parser as track_parser

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONSOLE = [line[2:] for line in re.findall(r"^\$ .*$", README, re.MULTILINE)]
SHELL = [line for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL) for line in block.splitlines()]
INLINE = re.findall(r"`((?:lassokin|ros2|pip|python3|make) [^`]+)`", README)
LINES = [shlex.split(line, comments=True) for line in [*CONSOLE, *SHELL, *INLINE]]
SETUP = (ROOT / "setup.py").read_text(encoding="utf-8")
SETTINGS = {item.name for item in all_settings()}


def starting_with(*words):
    found = [line for line in LINES if tuple(line[: len(words)]) == words]
    assert found, f"the README has no command '{' '.join(words)}'"
    return found


def options_after(line, flag):
    """Values of a repeated option such as -p."""
    return [value for option, value in zip(line, line[1:]) if option == flag]


def test_every_command_is_of_a_tested_kind():
    kinds = ("cd", "rosdep", "pip", "colcon", "make", "lassokin", "ros2", "python3")
    assert LINES and {line[0] for line in LINES} <= set(kinds)
    assert {line[1] for line in LINES if line[0] == "lassokin"} <= set(COMMANDS)
    assert {line[1] for line in LINES if line[0] == "ros2"} <= {"run", "launch"}


def test_track_options_are_those_of_the_command():
    for line in starting_with("lassokin", "track"):
        track_parser().parse_args(line[2:])


def test_the_replay_command_runs_and_writes_its_report(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_recording(tmp_path / "BAG", frames=10)
    (line,) = starting_with("lassokin", "replay")
    replay_parser().parse_args(line[2:])
    assert replay(line[2:]) == 0
    assert (tmp_path / "walk.html").stat().st_size > 10_000 and (tmp_path / "BAG_tracked").is_dir()


def test_node_commands_have_existing_parameters_and_topics():
    inputs = {topics.KEYPOINTS, topics.CAMERA_INFO}
    (line,) = starting_with("ros2", "run", "lassokin_ros", "tracker")
    assert line[2:4] == ["lassokin_ros", "tracker"] and line[3] in COMMANDS
    assert {item.partition(":=")[0] for item in options_after(line, "-r")} <= inputs
    given = options_after(line, "-p") + re.findall(r"-p (\w+:=\S+)", README)
    assert given and {item.partition(":=")[0] for item in given} <= SETTINGS


def test_launch_commands_have_existing_files_and_arguments():
    for line in starting_with("ros2", "launch"):
        text = "".join((ROOT / "launch" / name).read_text(encoding="utf-8") for name in {line[3], "tracker.launch.py"})
        assert line[2] == "lassokin_ros"
        assert all(f'"{item.partition(":=")[0]}": ' in text for item in line[4:])


def test_extras_exist():
    pages = README + (ROOT / "docs" / "first-skeleton.md").read_text(encoding="utf-8")
    extras = [extra for group in re.findall(r"'\.\[([\w,]+)\]'", pages) for extra in group.split(",")]
    assert len(extras) >= 4 and all(f'"{extra}": ' in SETUP for extra in extras)
    assert all(f'"{package}' in SETUP for package in ("proxsuite", "qpsolvers"))
    assert starting_with("pip", "install")


def test_make_targets_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert all(re.search(rf"^{line[1]}:", makefile, re.MULTILINE) for line in starting_with("make"))


def test_examples_exist_and_are_tested():
    (line,) = starting_with("python3", "examples/NAME.py")
    named = set(re.findall(r"\(examples/(\w+)\.py\)", README))
    tested = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "test" / "examples").glob("test_*.py"))
    assert named and all((ROOT / "examples" / f"{name}.py").is_file() and name in tested for name in named)


def test_named_parameters_topics_and_services_exist():
    (ten,) = re.findall(r"The ten parameters that people set:\n(.*?)\. All topics", README, re.DOTALL)
    names = re.findall(r"`(\w+)`", ten)
    assert len(names) == 10 and set(names) <= SETTINGS
    outputs = {topic.name.removeprefix("~/") for topic in topics.PERSON_OUTPUTS}
    listed = ("joint_states", "translation", "joints", "pose", "skeleton", "robot_description", "markers")
    assert set(listed) <= outputs and all(f"`{name}`" in README or f"/{name}`" in README for name in listed)


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="the node needs rclpy")
def test_the_node_starts_with_the_command_of_the_readme():
    import rclpy

    from lassokin_ros.node.node import TrackerNode

    (line,) = starting_with("ros2", "run", "lassokin_ros", "tracker")
    context = rclpy.Context()
    rclpy.init(context=context, args=line[line.index("--ros-args") :])
    try:
        node = TrackerNode(context=context)
        subscribed = {subscription.topic_name for subscription in node.subscriptions}
        assert {"/pose/keypoints", "/camera/camera_info"} <= subscribed
        assert node.get_parameter("height").value == 1.8
        node.destroy_node()
    finally:
        context.try_shutdown()
