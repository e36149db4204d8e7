"""Launch file, parameter files, RViz and Foxglove configurations agree with the code."""

import re
from pathlib import Path

import pytest
import yaml
from launch_files import ROOT, actions_of, load, replace_launch

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TYPICAL_HEIGHT, TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.robot_description import urdf_from_settings
from lassokin_ros.pipeline.outputs.topics import STATE_PUBLISHER
from lassokin_ros.pipeline.outputs.urdf import urdf
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.settings import OPTICAL_FRAME, NodeSettings

CONFIG = ROOT / "config"
FILES = sorted(file.stem for file in CONFIG.glob("*.yaml"))


@pytest.mark.parametrize("name", FILES)
def test_every_parameter_file_starts_a_tracker(name):
    tracker, node = offline_settings([CONFIG / f"{name}.yaml"], [])
    assert Tracker(tracker).layout.name == tracker.landmarks and node.checked() is node
    text = (CONFIG / f"{name}.yaml").read_text(encoding="utf-8")
    values = yaml.safe_load(text)["/**"]["ros__parameters"]
    settings = {**vars(TrackerConfig(height=1.75)), **vars(NodeSettings())}
    for key, value in values.items():  # rclpy does not accept 4 for 4.0
        value = tuple(value) if isinstance(value, list) else value
        assert key == "use_sim_time" or type(value) is type(settings[key]), f"{name}.yaml: {key}"


def test_each_usual_set_up_has_a_parameter_file():
    detectors = {"webcam_yolo", "openpose", "mediapipe", "mediapipe_hands"}
    assert set(FILES) == {"tracker", *detectors, "rosbag", "realsense", "oak", "zed"}


def test_the_urdf_follows_from_settings():
    skeleton = Skeleton.load("anthropometric", 1.75)
    assert urdf_from_settings(TrackerConfig(height=1.75), NodeSettings()) == urdf(skeleton, OPTICAL_FRAME, "tracker/")
    bare = urdf_from_settings(
        TrackerConfig(height=1.75), NodeSettings(fixed_frame="map", frame_prefix=""), "cam/tracker"
    )
    assert bare == urdf(skeleton, "map")


CLOCK = {"use_sim_time": True}


@pytest.fixture
def installed(monkeypatch):
    return replace_launch(monkeypatch)


@pytest.fixture
def launch_file(installed):
    return load("tracker")


def start(launch_file, **given):
    """The nodes that are started for these arguments, by package, and the bag's command."""
    return {getattr(action, "package", "bag"): action for action in actions_of(launch_file, **given)[0]}


def own_urdf(height=TYPICAL_HEIGHT, node="tracker", base=OPTICAL_FRAME):
    return urdf(Skeleton.load("anthropometric", height), base, f"{node}/")


def test_launch_starts_the_default_nodes(launch_file):
    started = start(launch_file)
    assert set(started) == {"lassokin_ros", "robot_state_publisher"}
    tracker, frames = started["lassokin_ros"], started["robot_state_publisher"]
    assert (tracker.executable, tracker.name) == ("tracker", "tracker")
    assert tracker.parameters == [str(CONFIG / "tracker.yaml")]
    assert tracker.remappings == [("keypoints", "keypoints"), ("camera_info", "camera_info")]
    assert frames.name == STATE_PUBLISHER
    assert frames.parameters[0]["publish_frequency"] >= 60
    assert frames.parameters[0]["robot_description"].args[0] == own_urdf()
    assert ("joint_states", "tracker/joint_states") in frames.remappings
    assert not hasattr(tracker, "namespace")


def test_the_tracker_publishes_all_frames_if_robot_state_publisher_is_not_installed(launch_file, installed):
    installed.clear()
    started = start(launch_file)
    assert started["lassokin_ros"].parameters[1] == {"publish_tf": "all"}
    assert set(started) == {"lassokin_ros", "bag"} and "not installed" in started["bag"].msg


def test_launch_passes_its_arguments(launch_file, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("/**:\n  ros__parameters:\n    height: 1.6\n")
    given = {"keypoints": "/d/k", "camera": "/cam/", "params": str(file), "frame": "lens", "bag": "walk", "rviz": "1"}
    started = start(launch_file, **given)
    tracker = started["lassokin_ros"]
    assert tracker.parameters == [str(file), {"use_sim_time": True}]
    assert tracker.remappings == [("keypoints", "/d/k"), ("camera_info", "/cam/camera_info")]
    assert started["robot_state_publisher"].parameters[0]["robot_description"].args[0] == own_urdf(1.6)
    rviz = started["rviz2"]
    assert Path(rviz.arguments[1]).is_file() and rviz.arguments[2:] == ["-f", "lens"]
    assert rviz.remappings == [("image_raw", "/cam/image_raw"), ("camera_info", "/cam/camera_info")]
    assert started["bag"].cmd == ["ros2", "bag", "play", "walk", "--clock"]
    by_name = start(launch_file, params="webcam_yolo", bag="walk", use_sim_time="false", frames="false")["lassokin_ros"]
    assert by_name.parameters == [str(CONFIG / "webcam_yolo.yaml"), {"use_sim_time": False}]


def test_the_home_folder_may_be_written_as_a_tilde(launch_file, monkeypatch, tmp_path):
    """The shell does not expand it in `params:=~/mine.yaml`."""
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "mine.yaml").write_text("/**:\n  ros__parameters:\n    height: 1.6\n")
    started = start(launch_file, params="~/mine.yaml", bag="~/walk")
    assert started["lassokin_ros"].parameters[0] == str(tmp_path / "mine.yaml")
    assert started["bag"].cmd[3] == str(tmp_path / "walk")


def test_launch_sets_parameters_and_the_namespace(launch_file):
    given = {"height": "1.9", "camera_pitch": "0.3", "landmarks": "body25", "namespace": "/left", "log_level": "WARN"}
    started = start(launch_file, **given)
    tracker, frames = started["lassokin_ros"], started["robot_state_publisher"]
    assert tracker.parameters[1] == {"height": 1.9, "camera_pitch": 0.3, "landmarks": "body25"}
    assert tracker.namespace == frames.namespace == "/left"
    assert tracker.arguments == ["--ros-args", "--log-level", "warn"]
    assert frames.parameters[0]["robot_description"].args[0] == own_urdf(height=1.9, node="left/tracker")


@pytest.mark.parametrize(
    "given, chosen", [({}, []), ({"use_sim_time": "no"}, [{"use_sim_time": False}]), ({"bag": "walk"}, [CLOCK])]
)
def test_the_clock_of_the_parameter_file_is_that_of_all_nodes(launch_file, given, chosen):
    started = start(launch_file, params="rosbag", rviz="1", **given)
    assert started["lassokin_ros"].parameters == [str(CONFIG / "rosbag.yaml"), *chosen]
    for package in ("robot_state_publisher", "rviz2"):
        assert started[package].parameters[-1] == (chosen or [CLOCK])[0]
    assert start(launch_file, rviz="1")["rviz2"].parameters == [{"use_sim_time": False}]


def test_a_file_for_two_trackers_is_read_for_the_one_in_the_namespace(launch_file, tmp_path):
    file = tmp_path / "two.yaml"
    file.write_text("/a/tracker:\n  ros__parameters: {height: 1.6}\n/b/tracker:\n  ros__parameters: {height: 1.9}\n")
    frames = start(launch_file, params=str(file), namespace="/a")["robot_state_publisher"]
    assert frames.parameters[0]["robot_description"].args[0] == own_urdf(height=1.6, node="a/tracker")
    with pytest.raises(ConfigurationError, match="several trackers"):
        start(launch_file, params=str(file))


def test_launch_sets_the_depth_images(launch_file):
    expected = {"depth": "/depth_to_rgb/image_raw"}
    tracker = start(launch_file, params="realsense", **expected)["lassokin_ros"]
    assert tracker.parameters == [str(CONFIG / "realsense.yaml"), expected]


def test_launch_of_several_people_starts_no_state_publisher(launch_file, tmp_path):
    """The tracker publishes TF of the limbs itself, unless a parameter file chooses otherwise."""
    started = start(launch_file, max_people="3")
    assert set(started) == {"lassokin_ros"}
    assert started["lassokin_ros"].parameters[1] == {"max_people": 3, "publish_tf": "all"}
    assert start(launch_file, max_people="3", frames="no")["lassokin_ros"].parameters[1] == {"max_people": 3}
    file = tmp_path / "mine.yaml"
    for people, chosen, with_it in ((3, "root", False), (1, "all", False), (1, "root", True), (1, "off", True)):
        file.write_text(f"/**:\n  ros__parameters:\n    max_people: {people}\n    publish_tf: {chosen}\n")
        started = start(launch_file, params=str(file))
        assert not started["lassokin_ros"].parameters[1:] and ("robot_state_publisher" in started) == with_it


@pytest.mark.parametrize("text, value", [("true", True), ("1", True), ("ON", True), ("false", False), ("No", False)])
def test_launch_reads_every_boolean_in_the_same_way(launch_file, text, value):
    started = start(launch_file, rviz=text, frames=text, use_sim_time=text)
    assert ("rviz2" in started) is value and ("robot_state_publisher" in started) is value
    assert started["lassokin_ros"].parameters[1] == {"use_sim_time": value}


@pytest.mark.parametrize(
    "given, words",
    [
        ({"rviz": "maybe"}, "rviz:=maybe; expected one of: true"),
        ({"frames": "never"}, "frames:=never"),
        ({"use_sim_time": "2"}, "use_sim_time:=2"),
        ({"log_level": "loud"}, "log_level:=loud; expected one of: debug"),
        ({"height": "9"}, "0 to 2.6 m"),
        ({"params": "nothing"}, "nothing.yaml"),
    ],
)
def test_launch_refuses_bad_arguments_before_anything_starts(launch_file, given, words):
    with pytest.raises((RuntimeError, ConfigurationError), match=re.escape(words)):
        start(launch_file, **given)


@pytest.mark.parametrize(("name", "close"), [("heigth", "height"), ("keypoint", "keypoints"), ("camera1", "camera")])
def test_an_argument_that_resembles_another_one_is_a_warning(launch_file, name, close):
    """It may be misspelt, or declared by an including launch file for another one."""
    started = start(launch_file, **{name: "1.8"})
    assert f"no argument '{name}'" in started["bag"].msg and f"did you mean '{close}'" in started["bag"].msg
    assert "lassokin_ros" in started


def test_launch_ignores_arguments_of_an_including_launch_file(launch_file):
    assert set(start(launch_file, robot_name="arm", world="office")) == {"lassokin_ros", "robot_state_publisher"}


def test_rviz_of_several_people_has_the_topics_of_everybody(launch_file):
    """A topic of one person would have no publisher."""
    shown = start(launch_file, rviz="1", max_people="3")["rviz2"].arguments[1]
    displays = yaml.safe_load(Path(shown).read_text(encoding="utf-8"))["Visualization Manager"]["Displays"]
    found = {display["Topic"]["Value"] for display in displays if "Topic" in display}
    assert found == {"image_raw", "tracker/markers", "tracker/people", "tracker/skeletons"}
    layout = (CONFIG / "foxglove_people.json").read_text(encoding="utf-8")
    one = {topic.name for topic in topics.PERSON_OUTPUTS} - {topics.MARKERS}
    assert not [name for name in one if re.search(f'"/tracker/{name.removeprefix("~/")}[".]', layout)]
    assert '"/tracker/people"' in layout and '"/tracker/skeletons"' in layout


def test_launch_sets_several_cameras_and_their_fixed_frame(launch_file):
    started = start(launch_file, cameras="[left, right]", fixed_frame="odom", rviz="1")
    expected = {"cameras": ["left", "right"], "fixed_frame": "odom"}
    assert started["lassokin_ros"].parameters[1] == expected
    assert started["robot_state_publisher"].parameters[0]["robot_description"].args[0] == own_urdf(base="odom")
    _, shown, *frame = started["rviz2"].arguments
    assert frame == ["-f", "odom"]
    displays = yaml.safe_load(Path(shown).read_text(encoding="utf-8"))["Visualization Manager"]["Displays"]
    assert {display["Topic"]["Value"] for display in displays if "Topic" in display} == {"tracker/markers"}
    (grid,) = [display for display in displays if display["Class"] == "rviz_default_plugins/Grid"]
    assert grid["Plane"] == "XY"  # z is up


def test_rviz_shows_the_fixed_frame_although_the_cameras_frame_is_given(launch_file):
    """The view of the world has z up; the optical frame would lay it on its side."""
    rviz = start(launch_file, fixed_frame="odom", frame="camera_optical_frame", rviz="1")["rviz2"]
    assert rviz.arguments[1].endswith("lassokin_world.rviz") and rviz.arguments[2:] == ["-f", "odom"]


@pytest.mark.parametrize("given", [{"camera": "/cam"}, {"keypoints": "/det/kp"}])
def test_topics_of_one_camera_beside_several_ones_are_a_warning(launch_file, given):
    """With names of cameras, these topics have no effect; a launch file that includes this one may set them."""
    (name,) = given
    started = start(launch_file, cameras="[left, right]", fixed_frame="map", **given)
    for word in (f"'{name}'", "left/keypoints", "right/camera_info"):
        assert word in started["bag"].msg
    assert "lassokin_ros" in started
    assert set(start(launch_file, cameras="[left, right]", fixed_frame="map")) == {
        "lassokin_ros",
        "robot_state_publisher",
    }
    assert "bag" not in start(launch_file, **given)
