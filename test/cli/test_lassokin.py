"""The command `lassokin`: its sub-commands, and one line for a wrong one."""

import sys
from concurrent.futures import Future

import pytest

from lassokin_ros.cli import lassokin
from lassokin_ros.node import executable


@pytest.mark.parametrize("arguments", [[], ["replya"], ["--version"]])
def test_a_wrong_command_is_one_line_and_exit_code_2(arguments, capsys):
    assert lassokin.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "track, replay, tracker, detector" in error


def test_help_names_every_command(capsys):
    assert lassokin.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"lassokin {name}" in text for name in lassokin.COMMANDS)


def test_a_command_gets_its_own_arguments(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["pytest"])
    assert lassokin.main(["replay", "no_such_bag"]) == 2
    assert "no_such_bag" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["tracker", "detector"])
def test_without_ros_a_node_is_one_line(name, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["pytest"])
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.setattr(executable, "await_signal", Future)  # it would block the signals of the test's process
    assert lassokin.main([name]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "rclpy" in error
