"""Launch file, parameter files, RViz and Foxglove configurations: held to what the code has."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from xml.etree import ElementTree

import pytest
import yaml

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.outputs.urdf import urdf
from lassokin_ros.pipeline.outputs.urdf_from_parameters import urdf_from_parameters
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.settings import NodeSettings

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "config"
FILES = sorted(file.stem for file in CONFIG.glob("*.yaml"))


@pytest.mark.parametrize("name", FILES)
def test_every_parameter_file_starts_a_tracker(name):
    tracker, node = offline_settings([CONFIG / f"{name}.yaml"], [])
    assert Tracker(tracker).layout.name == tracker.landmarks and node.checked() is node
    text = (CONFIG / f"{name}.yaml").read_text(encoding="utf-8")
    values = yaml.safe_load(text)["/**"]["ros__parameters"]
    settings = {**vars(TrackerConfig()), **vars(NodeSettings())}
    for key, value in values.items():  # rclpy takes no 4 for 4.0
        assert key == "use_sim_time" or type(value) is type(settings[key]), f"{name}.yaml: {key}"


def test_there_is_one_for_each_usual_set_up():
    assert set(FILES) == {"tracker", "webcam_yolo", "openpose", "mediapipe", "rosbag"}


def test_description_from_parameters(tmp_path):
    skeleton = Skeleton.load("anthropometric", TrackerConfig().height)
    file = CONFIG / "tracker.yaml"
    assert urdf_from_parameters(file) == urdf(skeleton, NodeSettings().base_frame)
    root = ElementTree.fromstring(urdf_from_parameters(file, "lens"))
    assert root.find("link").get("name") == "lens"
    with pytest.raises(ConfigurationError):
        urdf_from_parameters(tmp_path / "missing.yaml")


FOLLOWER = {"state_publisher": "robot_state_publisher"}


class Recorded(SimpleNamespace):
    """Stands for any class of launch: it keeps what it was made with."""

    def __init__(self, *args, **kwargs):
        super().__init__(args=args, **kwargs)

    def perform(self, context):
        return context[self.args[0]]


@pytest.fixture
def launch_file(monkeypatch):
    """The launch file as a module, over recording stand-ins where launch is not installed (it is not on PyPI)."""
    for name, members in {
        "launch": ("LaunchContext", "LaunchDescription"),
        "launch.actions": ("DeclareLaunchArgument", "ExecuteProcess", "OpaqueFunction"),
        "launch.conditions": ("IfCondition",),
        "launch.substitutions": ("LaunchConfiguration",),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
        "launch_ros.parameter_descriptions": ("ParameterValue",),
    }.items():
        module = ModuleType(name)
        for member in members:
            setattr(module, member, Recorded)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("tracker_launch", ROOT / "launch" / "tracker.launch.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def start(launch_file, **given):
    """What is started for these arguments, by package, and the bag's command."""
    *arguments, function = launch_file.generate_launch_description().args[0]
    defaults = {argument.args[0]: argument.default_value for argument in arguments}
    assert all(argument.description for argument in arguments) and set(given) <= set(defaults)
    actions = function.function({**defaults, **given})
    return {getattr(action, "package", "bag"): action for action in actions}


def test_launch_by_default(launch_file):
    started = start(launch_file)
    assert set(started) == {"lassokin_ros", "robot_state_publisher", "rviz2"}
    tracker, frames = started["lassokin_ros"], started["robot_state_publisher"]
    assert tracker.executable == "tracker"
    assert tracker.parameters == [str(CONFIG / "tracker.yaml"), {"use_sim_time": False}, FOLLOWER]
    assert frames.name == FOLLOWER["state_publisher"]
    assert tracker.remappings == [("keypoints", "keypoints"), ("camera_info", "camera_info")]
    assert frames.parameters[0]["publish_frequency"] >= 60
    assert frames.parameters[0]["robot_description"].args[0] == urdf_from_parameters(CONFIG / "tracker.yaml")
    assert started["rviz2"].condition.args[0].args == ("rviz",)
    assert Path(started["rviz2"].arguments[1]).is_file()
    assert len(started["rviz2"].arguments) == 2 and started["rviz2"].remappings == []


def test_launch_with_arguments(launch_file, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("/**:\n  ros__parameters:\n    height: 1.6\n")
    given = {"keypoints": "/d/k", "camera": "/cam/", "params": str(file), "frame": "lens", "bag": "walk"}
    started = start(launch_file, **given)
    tracker = started["lassokin_ros"]
    assert tracker.parameters == [str(file), {"use_sim_time": True}, {"base_frame": "lens"}, FOLLOWER]
    assert tracker.remappings == [("keypoints", "/d/k"), ("camera_info", "/cam/camera_info")]
    assert 'link name="lens"' in started["robot_state_publisher"].parameters[0]["robot_description"].args[0]
    rviz = started["rviz2"]
    assert rviz.arguments[2:] == ["-f", "lens"]
    assert rviz.remappings == [("image_raw", "/cam/image_raw"), ("camera_info", "/cam/camera_info")]
    assert started["bag"].cmd == ["ros2", "bag", "play", "walk", "--clock"]
    by_name = start(launch_file, params="webcam_yolo", bag="walk", use_sim_time="false", frames="false")["lassokin_ros"]
    assert by_name.parameters == [str(CONFIG / "webcam_yolo.yaml"), {"use_sim_time": False}]
