"""Permitted imports between packages: the contracts of pyproject.toml, checked by import-linter."""

import re
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


FORBIDDEN = {
    "core/tracker.py": "from lassokin_ros.pipeline import lens",
    "core/lasso/dual.py": "import rclpy",
    "core/image/gating.py": "from lassokin_ros.core import tracker",
    "pipeline/input_checks/stamps.py": "import rclpy",
    "node/qos.py": "from lassokin_ros.replay import bags",
    "replay/bags.py": "from lassokin_ros.node import qos",
    "replay/replay.py": "from lassokin_ros.demo import synthetic",
}


def test_imports_run_down_only_and_others_are_found(tmp_path):
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout
    for name in ("lassokin_ros", "msg_adapters"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    files = {f"lassokin_ros/{name}": line for name, line in FORBIDDEN.items()}
    files["msg_adapters/detectors/people.py"] = "from lassokin_ros.core import tracker"
    for name, line in files.items():
        with (tmp_path / name).open("a", encoding="utf-8") as file:
            file.write(f"\n{line}\n")
    found = lint(tmp_path)
    assert found.returncode != 0
    for name in files:
        module = name.removesuffix(".py").replace("/", ".")
        assert re.search(rf"{module} -> \S+ \(l\.\d+\)", found.stdout), (module, found.stdout)


def test_no_folder_is_crowded():
    for package in ("lassokin_ros", "msg_adapters", "benchmarks", "training", "test"):
        for folder in {file.parent for file in (ROOT / package).rglob("*.py")}:
            assert len(list(folder.glob("*.py"))) <= MOST_FILES, folder
