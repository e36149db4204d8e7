"""The README's code runs as written and does what the text states; the tests that docs/faults.md names exist."""

import re
from pathlib import Path

import numpy as np
import pytest

from lassokin_ros import joints
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import Camera, exact_pixels, motion
from msg_adapters.detectors.registry import keypoint_adapter

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def code_with(text):
    """The only Python block of the README that contains `text`."""
    (block,) = [code for code in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if text in code]
    return block


def test_tracking_without_ros_runs_as_written(tmp_path, monkeypatch, capsys):
    """The code runs on keypoints with a known true motion."""
    monkeypatch.chdir(tmp_path)
    code = code_with("Tracker(TrackerConfig")
    assert len([line for line in code.splitlines() if line]) == 8
    body = Tracker(TrackerConfig(height=1.80))
    truth = motion(body.skeleton, np.arange(20) / 30)
    camera = Camera(np.array([[920.0, 0, 640], [0, 920, 360], [0, 0, 1]]), np.zeros(5), (1280, 720))
    pixels = exact_pixels(body.kinematics, truth, camera)
    pixels[5] = np.nan  # one frame in which nobody is seen
    np.save("keypoints.npy", np.concatenate([pixels, np.ones((20, 17, 1))], axis=-1))
    names: dict = {}
    exec(compile(code, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert printed.count("[[") == 19 and printed.count("TOO_FEW_LANDMARKS") == 1
    found, expected = names["estimate"].pose.positions, body.kinematics.pose(truth).positions[-1]
    assert np.linalg.norm((found - found[0]) - (expected - expected[0]), axis=1).mean() < 0.08


def test_the_detectors_message_is_read_back():
    header = pytest.importorskip("std_msgs.msg", reason="the ROS message packages are not installed").Header
    names: dict = {}
    exec(compile(code_with("def keypoints_message"), "README.md", "exec"), names)
    xy, confidence = np.arange(34.0).reshape(17, 2) + 1, np.linspace(0.5, 1, 17)
    message = names["keypoints_message"](header(frame_id="camera"), xy, confidence)
    keypoints = keypoint_adapter("sensor_msgs/msg/PointCloud2").decode(message, None)
    points, found = keypoints.as_landmarks(17)
    assert np.array_equal(points, xy) and np.allclose(found, confidence)


def test_the_tests_named_in_the_faults_page_exist():
    """Every row of docs/faults.md names an existing test file, and an existing test if it names one."""
    page = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("|") and not line.startswith(("| fault |", "|---"))]
    assert len(rows) >= 15
    for row in rows:
        named = re.findall(r"`((?:\w+/)*test_\w+\.py)(?:::(test_\w+))?`", row.split("|")[3])
        assert named, row
        for file, test in named:
            path = Path(__file__).parents[1] / file
            assert path.is_file(), f"{file} does not exist"
            assert not test or f"def {test}(" in path.read_text(encoding="utf-8"), f"{file} has no {test}"


def test_the_readme_is_short():
    assert len(README.encode()) <= 9000


@pytest.mark.parametrize("name", ["follow_person", "raised_hand", "wrist_in_base"])
def test_the_examples_of_the_readme_are_those_of_the_folder(name):
    """Each method in the README is part of the example with the same statements; the README may use index constants."""
    code = (Path(__file__).parents[2] / "examples" / f"{name}.py").read_text(encoding="utf-8")
    code += re.sub(r"joints\.([A-Z]\w+)", lambda found: str(joints.INDEX[found[1].lower()]), code)
    there = {line.strip() for line in code.splitlines()}
    (block,) = re.findall(rf"examples/{name}\.py\):\n\n```python\n(.*?)```", README, re.DOTALL)
    statements = [re.sub(r" {2,}#.*", "", line).strip() for line in block.splitlines()]
    assert all(statement in there for statement in statements if statement)


def test_the_architecture_page_names_every_package():
    root = Path(__file__).parents[2]
    page = (root / "docs" / "architecture.md").read_text(encoding="utf-8")
    (picture,) = re.findall(r"```text\n(.*?)```", page, re.DOTALL)
    named = set(re.findall(r"\w+", " ".join(line[:35] for line in picture.splitlines())))
    packages = {path.parent for path in (root / "lassokin_ros").rglob("__init__.py")}
    tops = {path.name for path in packages if path.parent.name in ("lassokin_ros", "core")}
    assert tops - {"core", "lassokin_ros", "skeletons", "layouts"} <= named


ELSEWHERE = ("python.yaml", "debian/", "rpm/")
"""Of rosdistro, and what bloom makes."""


@pytest.mark.parametrize("page", ["docs/architecture.md", "CONTRIBUTING.md"])
def test_the_paths_of_a_page_for_developers_exist(page):
    """Modules by their path below lassokin_ros or the repository, or by their name alone in the folder named before."""
    root = Path(__file__).parents[2]
    named = re.findall(
        r"`((?:[\w.-]+/)*[\w.-]+\.(?:py|yaml|txt|xml|toml|cfg|rst|md|c|js|sh)|(?:[\w.-]+/)+)`",
        (root / page).read_text(encoding="utf-8"),
    )
    folders = [root, root / "lassokin_ros", root / "lassokin_ros" / "pipeline"]
    missing = []
    for path in named:
        found = [folder / path for folder in folders if (folder / path).exists()]
        if found:
            folders = [*folders[:3], found[0], found[0].parent, found[0].parent.parent]
        elif path not in ELSEWHERE:
            missing.append(path)
    assert len(named) > 10 and not missing
