"""Package metadata: manifest, files, licence, one version."""

import ast
import configparser
import re
import runpy
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def given(monkeypatch):
    """A function: the arguments that setup.py gives to setuptools."""
    arguments = []
    monkeypatch.setattr("setuptools.setup", lambda **given: arguments.append(given))
    monkeypatch.chdir(ROOT)
    return lambda: runpy.run_path("setup.py") and arguments.pop()


def test_the_manifest_is_valid():
    catkin_pkg = pytest.importorskip("catkin_pkg.package")
    package = catkin_pkg.parse_package(str(ROOT / "package.xml"))
    package.validate()
    assert package.package_format == 3
    assert package.get_build_type() == "ament_python"
    assert package.licenses == ["Apache-2.0", "MIT"]
    for licence in package.licenses:
        assert licence.partition("-")[0] in (ROOT / licence.file).read_text(encoding="utf-8")
    assert re.fullmatch(r"[\w.+-]+@[\w.-]+\.[a-z]{2,}", package.maintainers[0].email)


def test_the_version_is_that_of_the_manifest():
    import lassokin_ros
    from lassokin_ros.common.command_line import version

    assert lassokin_ros.__version__ == version()
    if version() != "(not installed)":
        assert lassokin_ros.__version__ == ElementTree.parse(ROOT / "package.xml").findtext("version")


def test_marker_and_scripts_are_installed():
    assert (ROOT / "resource" / "lassokin_ros").is_file()
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    assert setup["install"]["install_scripts"] == setup["develop"]["script_dir"] == "$base/lib/lassokin_ros"
    assert "Apache License" in (ROOT / "LICENSE").read_text(encoding="utf-8")


def test_catkin_can_read_the_changelog():
    changelog = pytest.importorskip("catkin_pkg.changelog")
    text = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    assert "Changelog for package lassokin_ros" in text
    pytest.importorskip("docutils")
    assert changelog.get_changelog_from_path(str(ROOT), "lassokin_ros") is not None


def imports_of(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def test_tracking_imports_no_optional_modules():
    """Saves memory and start-up time: images need OpenCV."""
    code = """if True:
        import sys
        from lassokin_ros.core.config import TrackerConfig
        from lassokin_ros.pipeline.settings import NodeSettings
        from lassokin_ros.pipeline.session import Session
        Session(TrackerConfig(height=1.75), NodeSettings())
        Session(TrackerConfig(height=1.75), NodeSettings(max_people=3))
        print(*sys.modules)
    """
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert "proxsuite" in loaded.split()
    assert not {"scipy.optimize", "scipy.linalg", "cv2", "matplotlib", "rosbags", "pandas"} & set(loaded.split())


def test_make_installs_extras_that_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = dict(re.findall(r"^(\w+): \$\(VENV\)/\.installed-(\w+)$", makefile, re.MULTILINE))
    assert targets == {
        "demo": "demo",
        "check": "test",
        "test": "test",
        "live": "test",
        "fuzz": "fuzz",
        "mutants": "mutants",
        "lint": "test",
    }
    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    assert all(f'"{extra}": ' in setup for extra in targets.values())
    wanted = re.search(r"^DEMO = \[(.*?)\]$", setup, re.MULTILINE | re.DOTALL)[1]
    assert set(re.findall(r"\*(\w+)", wanted)) == {"ROS", "REPLAY"}  # nothing of the test tools


def test_the_demo_needs_neither_opencv_nor_matplotlib(given):
    """Both are large: 153 and 80 MB of 690."""
    setup = given()
    demo = " ".join(setup["install_requires"] + setup["extras_require"]["demo"])
    assert "rosbags" in demo and "opencv" not in demo and "matplotlib" not in demo
    for room in ("core", "pipeline", "node", "demo"):
        for path in (ROOT / "lassokin_ros" / room).rglob("*.py"):
            assert not {"cv2", "matplotlib"} & {module.partition(".")[0] for module in imports_of(path)}, path


def test_setup_py_and_package_xml_agree(given):
    setup = given()
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    expected = {name: manifest.findtext(name) for name in ("name", "version", "author", "maintainer", "url")}
    licences = list(manifest.iter("license"))
    expected |= {"license": "Apache-2.0 AND MIT", "license_files": [tag.get("file") for tag in licences]}
    expected["maintainer_email"] = manifest.find("maintainer").get("email")
    expected["description"] = " ".join(manifest.findtext("description").split())
    assert {name: setup[name] for name in expected} == expected
    assert all(value for name, value in expected.items() if name != "url")  # the first release adds it


@pytest.mark.parametrize(
    "command, others", [("bdist_wheel", 0), ("editable_wheel", 0), ("dist_info", 0), ("install", 6), ("develop", 6)]
)
def test_pip_installs_one_command_and_ros2_run_has_the_others(monkeypatch, given, command, others):
    """pip makes a wheel; colcon and bloom call install or develop."""
    monkeypatch.setattr(sys, "argv", ["setup.py", command])
    names = [line.partition(" = ")[0] for line in given()["entry_points"]["console_scripts"]]
    assert names[0] == "lassokin" and len(names) == 1 + others
    assert set(names) <= {"lassokin", "tracker", "detector", "camera", "viewer", "imitate", "replay"}


def test_the_slow_tests_exist():
    """Those that `make check` leaves out."""
    lines = (ROOT / "test" / "slow_tests.txt").read_text(encoding="utf-8").splitlines()
    assert lines == sorted(set(lines))
    gone = []
    for line in lines:
        file, name = line.split("::")
        path = ROOT / "test" / file
        if not path.is_file() or f"def {name}(" not in path.read_text(encoding="utf-8"):
            gone.append(line)
    assert gone == [], "not there any more; take them out of test/slow_tests.txt"
