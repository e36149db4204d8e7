"""What to do about a missing package of messages, with a ROS from apt and without."""

import re
import sys
from pathlib import Path

import pytest
from installation.message_packages import PACKAGES

from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.node.message_types import BUILD, BUILT, message_class

ROOT = Path(__file__).resolve().parents[2]


def test_a_missing_package_is_named_with_what_works_without_apt(monkeypatch):
    monkeypatch.setitem(sys.modules, "tf2_msgs", None)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    with pytest.raises(ConfigurationError) as caught:
        message_class("tf2_msgs/msg/TFMessage")
    said = str(caught.value)
    assert "apt install ros-$ROS_DISTRO-tf2-msgs" in said and "\n" not in said
    assert said.endswith("message_packages.py tf2_msgs") and "pip install '.[messages]'" in said


def test_the_command_exists_and_builds_these_packages():
    extra, file = re.fullmatch(r"pip install '\.\[(\w+)\]' && python (\S+)", BUILD).groups()
    assert (ROOT / file).is_file() and f'"{extra}":' in (ROOT / "setup.py").read_text(encoding="utf-8")
    assert set(BUILT) == set(PACKAGES)


def test_another_package_is_not_said_to_be_built(monkeypatch):
    with pytest.raises(ConfigurationError) as caught:
        message_class("absent_msgs/msg/Thing")
    assert "ros-$ROS_DISTRO-absent-msgs" in str(caught.value) and "checkout" not in str(caught.value)
