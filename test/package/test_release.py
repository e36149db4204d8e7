"""Requirements of a release through bloom: keys of package.xml, and tests that collect with rosdep's packages only.

CONTRIBUTING.md lists the checks against rosdistro and bloom, which need a network.
"""

import ast
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from installation.pip_only import PIP_ONLY

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()
ON_REQUEST = {"hri_msgs", "yolo_msgs", "zed_msgs", "vision_msgs", "people_msgs", "rviz2"}
"""Packages of message types that a parameter must request. The node names a missing one."""
APT = {
    **{"numpy": "python3-numpy", "cv2": "python3-opencv", "scipy": "python3-scipy", "yaml": "python3-yaml"},
    "tf2_ros": "tf2_ros_py",
}
PIP = {"av", "distributed", "ezc3d", "mediapipe", "onnxruntime", "proxsuite", "qpsolvers", "rerun", "rosbags"}
PIP |= {"pink", "pinocchio"}
"""Modules without a rosdep key. All but proxsuite are imported where they are used."""
TYPING = {"typing_extensions"}
"""Read by type checkers only."""
BLOCKER = """import importlib.abc, sys
class Blocker(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocker())
"""
FILES = ("core/lasso/test_dual.py", "replay/exports/test_gltf.py", "video/test_track.py", "node/test_beside_a_robot.py")


def keys(kind):
    return {element.text for element in MANIFEST.iter(kind)}


def sources():
    files = [*(ROOT / "lassokin_ros").rglob("*.py"), *(ROOT / "msg_adapters").rglob("*.py")]
    return [path.read_text(encoding="utf-8").replace("\\n", "\n") for path in (*files, *(ROOT / "launch").glob("*.py"))]


def test_every_used_ros_package_is_a_dependency():
    used = set()
    for text in sources():
        used |= set(re.findall(r"\b([a-z0-9_]+_(?:msgs|srvs|interfaces))(?:/msg/|/[A-Z]|\.(?:msg|srv)\b)", text))
        used |= set(re.findall(r'package="(\w+)"', text))
    used -= {"lassokin_ros", *ON_REQUEST}
    assert used <= keys("exec_depend"), used - keys("exec_depend")
    assert {"sensor_msgs", "tf2_msgs", "std_srvs", "robot_state_publisher"} <= used


def imports_of(path):
    """(docstring, names of the imported packages, without those of Python and of this repository)."""
    tree, names = ast.parse(path.read_text(encoding="utf-8")), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add(node.module)
    packages = {name.partition(".")[0] for name in names}
    return ast.get_docstring(tree) or "", packages - {"lassokin_ros", "msg_adapters", *sys.stdlib_module_names}


@pytest.mark.parametrize("folder", ["lassokin_ros", "msg_adapters", "launch", "examples"])
def test_every_imported_package_is_a_dependency(folder):
    """Of package.xml: as itself or as a key of APT; or it is one of PIP, or an example's docstring names it."""
    required, found = keys("exec_depend"), set()
    known = required | PIP | TYPING | {module for module, key in APT.items() if key in required}
    for path in (ROOT / folder).rglob("*.py"):
        docstring, packages = imports_of(path)
        assert all(name in docstring and folder == "examples" for name in packages - known), (path, packages - known)
        found |= packages
    assert found


def test_what_pip_must_install_is_the_same_everywhere(monkeypatch):
    """Without a rosdep key: the comment in package.xml, the README, and setup.py."""
    setup = []
    monkeypatch.setattr("setuptools.setup", lambda **arguments: setup.append(arguments))
    monkeypatch.chdir(ROOT)
    runpy.run_path("setup.py")
    required = setup[0]["install_requires"] + setup[0]["extras_require"]["replay"]
    expected = {re.match(r"\w+", line)[0] for line in required} - {"setuptools", "numpy", "scipy", "PyYAML"}
    manifest = re.search(r"pip install ([\w ]+) -->", (ROOT / "package.xml").read_text(encoding="utf-8"))[1]
    readme = re.search(r"--break-system-packages ([\w ]+?) +#", (ROOT / "README.md").read_text(encoding="utf-8"))[1]
    assert set(manifest.split()) == set(readme.split()) == expected <= PIP


def test_bags_can_be_played_with_the_dependencies_alone():
    """ros2bag requires no storage plugin."""
    assert {"ros2bag", "rosbag2_storage_default_plugins"} <= keys("exec_depend")


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
    done = subprocess.run(
        [*command, *(f"test/{file}" for file in FILES)],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0 and "ERROR" not in done.stdout, done.stdout[-3000:] + done.stderr[-1000:]
    assert "needs proxsuite: pip install proxsuite" in done.stdout
