"""ruff on everything, and ament's linters with the plugins of ROS machines (ros-$ROS_DISTRO-ament-lint-common)."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OWN = ["lassokin_ros/node", "msg_adapters/detectors", "launch"]
"""Of what is installed, a sample: ruff has the same rules, and checks everything in a fiftieth of the time."""


def run(linter, arguments):
    if find_spec(linter) is None:
        pytest.skip(f"{linter} is not installed; on a ROS machine: rosdep install --from-paths . -t test")
    main = pytest.importorskip(f"{linter}.main").main
    assert main(argv=arguments) == 0


def test_everything_passes_ruff():
    pytest.importorskip("ruff")
    for command in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *command, "-q", "."], cwd=ROOT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout


def test_xml_files_pass_xmllint():
    run("ament_xmllint", [str(ROOT / "package.xml")])


def test_sources_pass_flake8():
    run("ament_flake8", ["--config", str(ROOT / "setup.cfg"), *(str(ROOT / folder) for folder in OWN)])


def test_docstrings_pass_pep257():
    folders = [str(ROOT / folder) for folder in OWN[:2]]
    run("ament_pep257", ["--convention", "numpy", "--add-ignore", IGNORED, "--", *folders])


IGNORED = "D100,D104,D105,D107,D203,D205,D212,D213,D400,D401,D403,D407,D413,D415"
"""The same as ruff's in pyproject.toml."""


def test_pep257_ignores_what_ruff_ignores():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert ", ".join(f'"{code}"' for code in IGNORED.split(",")) + "]" in text
