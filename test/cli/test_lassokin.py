"""The command `lassokin`: its sub-commands, and one line for a wrong one."""

import re
import subprocess
import sys
from concurrent.futures import Future

import pytest

from lassokin_ros.cli import lassokin
from lassokin_ros.node import executable


@pytest.mark.parametrize("arguments", [[], ["replya"], ["--verbose"], ["--version", "x"]])
def test_a_wrong_command_is_one_line_and_exit_code_2(arguments, capsys):
    assert lassokin.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "track, replay, tracker, detector, camera" in error


def test_the_version_is_printed(capsys, monkeypatch):
    monkeypatch.setattr(lassokin, "version", lambda: "1.2.3")
    assert lassokin.main(["--version"]) == 0
    assert capsys.readouterr().out == "lassokin_ros 1.2.3\n"


def test_help_names_every_command(capsys):
    assert lassokin.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"lassokin {name}" in text for name in lassokin.COMMANDS)


def test_a_command_gets_its_own_arguments(capsys, monkeypatch):
    pytest.importorskip("proxsuite")
    monkeypatch.setattr(sys, "argv", ["pytest"])
    assert lassokin.main(["replay", "no_such_bag"]) == 2
    assert "no_such_bag" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["tracker", "detector", "camera"])
def test_a_node_without_ros_is_one_line(name, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["pytest"])
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.setattr(executable, "await_signal", Future)  # no signal handlers in the test's process
    assert lassokin.main([name]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "rclpy" in error


@pytest.mark.parametrize("arguments", [["replay", "bag"], ["tracker"]])
def test_a_missing_solver_is_named(arguments, tmp_path):
    """In a process in which the package cannot be imported."""
    without = "import sys; sys.modules['proxsuite'] = None"
    code = f"{without}; from lassokin_ros.cli import lassokin; sys.exit(lassokin.main({arguments}))"
    (tmp_path / "bag").mkdir()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (2, "") and done.stderr.count("\n") == 1
    assert re.search("the Python package proxsuite is not installed: pip install .*proxsuite\n$", done.stderr)
