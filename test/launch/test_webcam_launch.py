"""webcam.launch.py and imitate.launch.py: the nodes that they start, and their parameters."""

import re
from pathlib import Path

import pytest
from launch_files import ROOT, actions_of, load, replace_launch
from toy_robot import urdf

from lassokin_ros.pipeline.parameter_files import offline_settings


@pytest.fixture
def webcam(monkeypatch, tmp_path):
    """(module of the launch file, set of the installed packages)."""
    installed = replace_launch(monkeypatch)
    module = load("webcam")
    monkeypatch.setattr(module, "CALIBRATIONS", tmp_path)
    monkeypatch.setattr(module, "DEVICES", tmp_path / "devices")
    return module, installed


def start(module, **given):
    """(camera, detector, arguments of tracker.launch.py) of the started nodes."""
    (camera, detector, tracker), values = actions_of(module, **given)
    assert Path(tracker.args[0].args[0]).samefile(ROOT / "launch" / "tracker.launch.py")
    return camera, detector, {**values, **dict(tracker.launch_arguments)}


def test_without_a_driver_opencv_reads_the_camera(webcam):
    camera, detector, _ = start(webcam[0])
    assert (camera.package, camera.executable) == ("lassokin_ros", "camera")
    assert camera.parameters == [{"source": "0", "frame_id": "camera_optical_frame"}]
    assert (detector.executable, detector.parameters) == ("detector", [{"detector": "mediapipe"}])


def test_parameters_of_the_own_camera_exist(webcam):
    node = pytest.importorskip("lassokin_ros.camera.node", reason="the node needs rclpy")
    camera, _, _ = start(webcam[0], fov="70", calibration="ost.yaml", source="walk.mp4")
    assert set(camera.parameters[0]) < set(node.PARAMETERS) and camera.parameters[0]["fov"] == 70.0


def test_a_driver_is_used_if_there_is_a_calibration(webcam, tmp_path):
    module, installed = webcam
    installed.add("usb_cam")
    assert start(module)[0].package == "lassokin_ros"
    (tmp_path / "default_cam.yaml").touch()
    camera = start(module, source="2")[0]
    assert camera.package == "usb_cam" and camera.parameters[0]["video_device"] == "/dev/video2"
    installed.add("v4l2_camera")
    camera = start(module, calibration="/c/ost.yaml")[0]
    assert (camera.package, camera.parameters[0]["camera_info_url"]) == ("v4l2_camera", "file:///c/ost.yaml")
    assert start(module, source="2")[0].package == "usb_cam"
    assert start(module, source="walk.mp4")[0].package == start(module, driver="opencv")[0].package == "lassokin_ros"


def test_the_home_folder_of_a_calibration_may_be_written_as_a_tilde(webcam, monkeypatch):
    """The shell does not expand it in `calibration:=~/ost.yaml`."""
    monkeypatch.setenv("HOME", "/home/robot")
    camera = start(webcam[0], driver="usb_cam", calibration="~/ost.yaml")[0]
    assert camera.parameters[0]["camera_info_url"] == "file:///home/robot/ost.yaml"


def test_a_calibration_of_another_camera_is_none(webcam, tmp_path):
    module, installed = webcam
    installed.update(module.DRIVERS)
    device = tmp_path / "devices" / "video2"
    device.mkdir(parents=True)
    (device / "name").write_text("HD Webcam: HD 16.1\n")
    (tmp_path / "other_webcam.yaml").touch()
    assert start(module, source="2")[0].package == "lassokin_ros"
    (tmp_path / "hd_webcam:_hd_16.1.yaml").touch()
    assert start(module, source="2")[0].package == "v4l2_camera"
    assert start(module, source="0")[0].package == "lassokin_ros"


def test_the_given_frame_is_that_of_camera_and_tracker(webcam):
    for driver, name in (("opencv", "frame_id"), ("v4l2_camera", "camera_frame_id"), ("usb_cam", "frame_id")):
        camera, _, arguments = start(webcam[0], driver=driver, frame="my_cam")
        assert camera.parameters[0][name] == arguments["frame"] == "my_cam"


def test_the_tracker_gets_the_detectors_layout(webcam, tmp_path):
    """It replaces that of a parameter file, such as a copy of config/tracker.yaml."""
    tracker_launch, onnx, file = load("tracker"), {"detector": "rtmpose.onnx"}, tmp_path / "mine.yaml"
    file.write_text("/**:\n  ros__parameters: {camera_pitch: 0.1}\n")
    cases = [({"landmarks": "h36m17"}, "h36m17"), ({"detector": "mediapipe_hands"}, "mediapipe75")]
    for params in ({}, {"params": str(file)}, {"params": "tracker"}, {"params": "mediapipe"}):
        cases += [(params, "mediapipe33"), ({**params, **onnx}, "coco17")]
    for given, layout in cases:
        _, _, arguments = start(webcam[0], height="1.6", **given)
        # tracker.launch.py warns of misspelt names and starts the tracker.
        actions, _ = actions_of(tracker_launch, **arguments)
        node = next(action for action in actions if getattr(action, "package", "") == "lassokin_ros")
        assignments = [f"{name}:={value}" for name, value in node.parameters[-1].items()]
        settings, node_settings = offline_settings([Path(node.parameters[0])], assignments)
        assert (settings.landmarks, settings.height) == (layout, 1.6)
        assert node_settings.root_frame == "camera_optical_frame"


@pytest.mark.parametrize(
    "given, words",
    [
        ({"driver": "gige"}, "driver:=gige; expected one of: v4l2_camera, usb_cam, opencv"),
        ({"driver": "usb_cam", "source": "walk.mp4"}, "takes the number of a webcam"),
        ({"driver": "usb_cam", "fov": "70"}, "and no fov; use driver:=opencv"),
    ],
)
def test_bad_arguments_are_refused(webcam, given, words):
    with pytest.raises(RuntimeError, match=re.escape(words)):
        start(webcam[0], **given)


def test_all_nodes_have_the_namespace_and_the_clock(webcam, tmp_path):
    """Else the tracker would read topics that nobody publishes."""
    module, installed = webcam
    assert not any(hasattr(node, "namespace") for node in start(module)[:2])
    installed.add("usb_cam")
    (tmp_path / "default_cam.yaml").touch()
    for driver in ("opencv", "usb_cam"):
        camera, detector, passed = start(module, driver=driver, namespace="robot1", use_sim_time="Yes")
        for node in (camera, detector):
            assert node.namespace == passed["namespace"] == "robot1"
            assert node.parameters[-1]["use_sim_time"] is True
        assert start(module, driver=driver, use_sim_time="0")[0].parameters[-1]["use_sim_time"] is False


def test_the_words_for_true_are_those_of_the_tracker(webcam):
    assert set(webcam[0].TRUE) == {word for word, value in load("tracker").BOOLEANS.items() if value}


def test_a_humanoid_starts_with_the_tracker_and_its_model(webcam, tmp_path):
    module, path = load("imitate"), tmp_path / "toy.urdf"
    path.write_text(urdf())
    given = {"required": ("robot", "urdf"), "robot": "g1", "urdf": str(path)}
    (tracker, imitate, shown), _ = actions_of(module, **given, free_base="true")
    assert Path(tracker.args[0].args[0]).samefile(ROOT / "launch" / "tracker.launch.py")
    (parameters,) = imitate.parameters
    assert imitate.executable == "imitate" and parameters["robot"] == "g1" and parameters["free_base"] is True
    assert ("joint_states", "joint_commands") in shown.remappings
    assert len(actions_of(module, **given, robot_model="false")[0]) == 2
    with pytest.raises(RuntimeError, match="expected the path of the robot's URDF"):
        actions_of(module, **{**given, "urdf": str(tmp_path / "none.urdf")})
