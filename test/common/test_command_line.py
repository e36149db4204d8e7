"""What to install if a package is missing, in a virtual environment and in the system's Python."""

import sys

import pytest

from lassokin_ros.common.command_line import missing_package


@pytest.mark.parametrize(
    "prefix, command", [("/home/me/venv", "pip install"), ("/usr", "pip install --break-system-packages")]
)
def test_only_the_systems_python_needs_the_option(prefix, command, monkeypatch):
    monkeypatch.setattr(sys, "prefix", prefix)
    monkeypatch.setattr(sys, "base_prefix", "/usr")
    error = ModuleNotFoundError("No module named 'cv2'", name="cv2")
    said = "the Python package opencv-python-headless is not installed"
    assert missing_package(error) == f"{said}: {command} opencv-python-headless"
