"""Requirements of a release through bloom: keys of package.xml, and tests that collect with rosdep's packages only.

CONTRIBUTING.md lists the checks against rosdistro and bloom, which need a network.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

from installation.pip_only import PIP_ONLY

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()
ON_REQUEST = {"hri_msgs", "yolo_msgs", "zed_msgs", "vision_msgs", "people_msgs"}
"""Packages of message types that a parameter must request. The node names a missing one."""
APT = {"numpy": "python3-numpy", "cv2": "python3-opencv", "scipy": "python3-scipy", "yaml": "python3-yaml"}
BLOCKER = """import importlib.abc, sys
class Blocker(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocker())
"""
FOLDERS = ("test/core/lasso", "test/replay/exports", "test/video", "test/node/test_beside_a_robot.py")


def keys(kind):
    return {element.text for element in MANIFEST.iter(kind)}


def sources():
    files = [*(ROOT / "lassokin_ros").rglob("*.py"), *(ROOT / "msg_adapters").rglob("*.py")]
    return [path.read_text(encoding="utf-8").replace("\\n", "\n") for path in (*files, *(ROOT / "launch").glob("*.py"))]


def test_every_used_ros_package_is_a_dependency():
    used = set()
    for text in sources():
        used |= set(re.findall(r"\b([a-z0-9_]+_(?:msgs|srvs|interfaces))(?:/msg/|/[A-Z]|\.(?:msg|srv)\b)", text))
        used |= set(re.findall(r"^\s*(?:from|import) (rclpy|launch|launch_ros)\b", text, re.MULTILINE))
        used |= set(re.findall(r'package="(\w+)"', text))
    used -= {"lassokin_ros", *ON_REQUEST}
    assert used <= keys("exec_depend"), used - keys("exec_depend")
    assert {"rclpy", "sensor_msgs", "tf2_msgs", "std_srvs", "launch_ros", "rviz2"} <= used


def test_every_used_apt_package_of_python_is_a_dependency():
    imported = set()
    for text in sources():
        imported |= set(re.findall(r"^\s*(?:from|import) (\w+)", text, re.MULTILINE))
    assert {key for module, key in APT.items() if module in imported} == set(APT.values()) <= keys("exec_depend")


def test_no_key_is_installed_by_pip():
    """On Ubuntu 24.04 rosdep installs such keys only with PIP_BREAK_SYSTEM_PACKAGES."""
    every = {element.text for element in MANIFEST if element.tag.endswith("depend")}
    assert not [key for key in every if key.endswith("-pip")] and "python3-pytest" in every
    assert not {f"python3-{name}" for name in ("qpsolvers", "proxsuite", "rosbags")} & every


def test_the_tests_collect_with_the_packages_of_rosdep_only(tmp_path):
    """Of files that need one of PIP_ONLY each, in a Python that refuses to import these."""
    (tmp_path / "blocker.py").write_text(BLOCKER.format(names=PIP_ONLY))
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-m", "pytest", "-p", "blocker", "-p", "no:cacheprovider", "--collect-only", "-rs"]
    done = subprocess.run([*command, *FOLDERS], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and "ERROR" not in done.stdout, done.stdout[-3000:] + done.stderr[-1000:]
    assert "needs proxsuite: pip install proxsuite" in done.stdout
