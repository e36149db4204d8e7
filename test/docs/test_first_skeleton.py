"""docs/first-skeleton.md: its commands, as far as this machine allows, and its tables."""

import ast
import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from recordings import beginning_of

from lassokin_ros.cli.lassokin import COMMANDS
from lassokin_ros.video.command import parser

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "first-skeleton.md").read_text(encoding="utf-8")
LINES = [shlex.split(line) for line in re.findall(r"^    (\S.*)$", PAGE, re.MULTILINE)]
TRACK = [line[2:] for line in LINES if line[:2] == ["lassokin", "track"]]
SAMPLE, FRAMES = "examples/balancing.mp4", 12


def table(header):
    """(names, default) of each row of the table with this first column."""
    body = PAGE.split(f"| {header} |")[1].split("\n\n")[0].splitlines()[2:]
    return {tuple(re.findall(r"`([^`]+)`", row.split("|")[1])): row.split("|")[2].strip() for row in body}


def commands(*first):
    return [line for line in LINES if line[: len(first)] == list(first)]


def test_every_command_is_of_a_tested_kind():
    known = [("pip", "install"), ("lassokin",), ("ros2", "launch"), ("ros2", "run"), ("python3", "-m")]
    assert LINES and all(any(tuple(line[: len(kind)]) == kind for kind in known) for line in LINES), LINES


def test_options_are_those_of_the_command():
    assert TRACK and all(parser().parse_args(line) for line in TRACK)
    actions = [action for action in parser()._actions if action.option_strings and action.dest != "help"]
    assert {name for names in table("option") for name in names} == {a.option_strings[0] for a in actions}


def test_arguments_and_parameters_are_those_of_the_code():
    launch = ast.parse((ROOT / "launch" / "webcam.launch.py").read_text(encoding="utf-8"))
    assigned = {ast.unparse(node.targets[0]): node.value for node in launch.body if isinstance(node, ast.Assign)}
    arguments = {key.value for key in assigned["ARGUMENTS"].keys}
    assert {names[0] for names in table("argument")} | {"height", "rviz"} == arguments
    for line in commands("ros2", "launch"):
        assert line[2:4] == ["lassokin_ros", "webcam.launch.py"]
        assert {item.partition(":=")[0] for item in line[4:]} <= arguments
    for line in commands("ros2", "run"):
        assert line[2] == "lassokin_ros" and line[3] in COMMANDS
    assert all(importlib.util.find_spec(line[2]) for line in commands("python3", "-m"))


def test_the_cameras_parameters_are_those_of_the_node():
    pytest.importorskip("rclpy", reason="the node camera needs rclpy")
    from lassokin_ros.camera.node import PARAMETERS

    documented = {names[0]: default.strip("`") for names, default in table("parameter").items()}
    assert documented == {
        name: f'"{value}"' if isinstance(value, str) else str(value) for name, (value, _) in PARAMETERS.items()
    }
    (camera,) = [line for line in commands("ros2", "run") if line[3] == "camera"]
    given = [item.partition(":=")[0] for before, item in zip(camera, camera[1:]) if before == "-p"]
    assert given and set(given) <= set(PARAMETERS)


def test_the_longest_track_command_of_the_page_runs(tmp_path):
    """A recorded video replaces the webcam. The window of --view needs a screen and is not opened.

    test_track_commands.py runs all of them with a detector that costs nothing.
    """
    line = max((line for line in TRACK if line[0] in ("0", SAMPLE) and line[-1] != "--view"), key=len)
    if "--view" in line:
        pytest.importorskip("rerun", reason="--view needs rerun-sdk")
    pytest.importorskip("mediapipe", reason="the detector of the page needs mediapipe")
    given = [str(beginning_of(ROOT / SAMPLE, tmp_path / "sample.mp4", FRAMES)), *line[1:]]
    command = [sys.executable, "-m", "lassokin_ros.cli.lassokin", "track", *given]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert f"{FRAMES} in, {FRAMES} tracked" in done.stdout
    assert all(line.startswith("lassokin track: ") for line in done.stderr.splitlines()), done.stderr
    files = [word for word in line[1:] if re.search(r"\.\w+$", word) and not word[0].isdecimal()]
    assert files and sorted(file.name for file in tmp_path.iterdir()) == sorted([*files, "sample.mp4"])
    assert all((tmp_path / file).stat().st_size > 10_000 for file in files)
