"""Permitted imports between packages: the contracts of pyproject.toml, checked by import-linter."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("importlinter")
ROOT = Path(__file__).resolve().parents[2]
MOST_FILES = 16
"""Largest number of Python files in one folder, __init__.py included."""


def lint(folder):
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as run; run()"]
    return subprocess.run([*command, "--no-cache"], cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture
def checkout(tmp_path):
    for name in ("lassokin_ros", "msg_adapters"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_imports_run_down_only():
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    "module, line",
    [
        ("lassokin_ros/core/tracker.py", "from lassokin_ros.pipeline import lens"),
        ("lassokin_ros/core/lasso/dual.py", "import rclpy"),
        ("lassokin_ros/pipeline/stamps.py", "import rclpy"),
        ("lassokin_ros/node/qos.py", "from lassokin_ros.replay import bags"),
        ("lassokin_ros/replay/bags.py", "from lassokin_ros.node import qos"),
        ("lassokin_ros/replay/bags.py", "from lassokin_ros.demo import synthetic"),
        ("msg_adapters/detectors/people.py", "from lassokin_ros.core import tracker"),
    ],
)
def test_a_forbidden_import_is_found(checkout, module, line):
    file = checkout / module
    file.write_text(file.read_text(encoding="utf-8") + f"\n{line}\n", encoding="utf-8")
    assert lint(checkout).returncode != 0


def test_no_folder_is_crowded():
    for package in ("lassokin_ros", "msg_adapters", "benchmarks", "training", "test"):
        for folder in {file.parent for file in (ROOT / package).rglob("*.py")}:
            assert len(list(folder.glob("*.py"))) <= MOST_FILES, folder
