"""Bad input to `replay`: one line with the fault and the expected form, exit code 2, nothing written."""

import os
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from recordings import START_NS, webcam_info, write_messages, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402

NO_UTF8 = os.fsdecode(b"walk\xff")
"""A folder's name with unusual characters, as Linux allows it."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    write_recording(folder / "good", 5)
    info = ("/camera_info", "sensor_msgs/msg/CameraInfo", START_NS, webcam_info())
    write_messages(folder / "no_keypoints", [info])
    write_messages(folder / "two_cameras", [info, ("/right/info", *info[1:]), ("/left/info", *info[1:])])
    (folder / "empty").mkdir()
    (folder / "notes.txt").write_text("hello")
    (folder / "unknown.yaml").write_text("tracker:\n  ros__parameters:\n    hight: 1.8\n")
    return folder


BAD = {
    "no such recording": (["nix"], "there is no recording 'nix'; expected a rosbag2 folder, or a .mcap or .db3 file"),
    "no recording": (["notes.txt"], "notes.txt cannot be read as a rosbag2 recording: Unrecognized storage format"),
    "an empty folder": (["empty"], "'empty' is not a rosbag2 recording: it has no metadata.yaml"),
    "no keypoints": (
        ["no_keypoints"],
        "no_keypoints has no topic of type sensor_msgs/msg/PointCloud2 for keypoints; its topics are: "
        "/camera_info (sensor_msgs/msg/CameraInfo, 1 messages)",
    ),
    "wrong topic": (
        ["good", "--keypoints-topic", "/people"],
        "good has no topic '/people'; its topics are: /camera_info (sensor_msgs/msg/CameraInfo, 5 messages), /",
    ),
    "wrong type": (
        ["good", "--keypoints-topic", "/camera_info"],
        "topic '/camera_info' of good holds sensor_msgs/msg/CameraInfo; expected sensor_msgs/msg/PointCloud2",
    ),
    "wrong camera": (["good", "--camera-info-topic", "left"], "good has no topic 'left'; its topics are: "),
    "another carrier": (
        ["good", "-p", "keypoints_type:=geometry_msgs/PolygonStamped"],
        "good has no topic of type geometry_msgs/msg/PolygonStamped for keypoints; its topics are: ",
    ),
    "misspelt": (
        ["good", "--params-file", "unknown.yaml"],
        "unknown.yaml: there is no parameter 'hight'; did you mean 'height'?",
    ),
    "no value": (["good", "-p", "height=1.8"], "-p 'height=1.8'; expected name:=value, such as height:=1.80"),
    "no skeleton": (["good", "-p", "skeleton:=alien"], "skeleton 'alien' is neither built in (anthropometric, "),
    "no layout": (["good", "-p", "landmarks:=coco"], "landmark layout 'coco' is neither built in (body25, body25b"),
    "no folder": (["good", "--output", "nowhere/out"], "there is no folder 'nowhere' for the output 'out'"),
    "output is a file": (["good", "--output", "notes.txt"], "'notes.txt' exists already"),
}


@pytest.mark.parametrize("case", sorted(BAD))
def test_bad_input_is_one_line(folder, monkeypatch, capsys, case):
    arguments, expected = BAD[case]
    monkeypatch.chdir(folder)
    before = sorted(os.listdir())
    if "--output" not in arguments:
        arguments = [*arguments, "--output", "out"]
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert said.err.startswith(f"lassokin replay: {expected}"), said.err
    assert sorted(os.listdir()) == before


def test_one_of_two_unknown_cameras_must_be_selected(folder, monkeypatch, capsys):
    """Without a usual name among them the user must choose; a usual name is used."""
    from lassokin_ros.replay.bags import BagError, BagReader

    with BagReader(folder / "two_cameras") as bag:
        assert bag.find("sensor_msgs/msg/CameraInfo", None, "camera_info", "--x").name == "/camera_info"
        with pytest.raises(BagError, match="topics for keypoints: /camera_info, /left/info, /right/info; .*--x"):
            bag.find("sensor_msgs/msg/CameraInfo", None, "keypoints", "--x")


def printed(stdout, folder, monkeypatch):
    """Exit code of a replay with a page in a folder, whose summary goes to `stdout`."""
    write_recording(folder / NO_UTF8, 3)
    monkeypatch.chdir(folder)
    with monkeypatch.context() as other:
        other.setattr(sys, "stdout", stdout)
        code = main([NO_UTF8, "--output", "out", "--report", "page"])
    assert {"out", "page"} <= set(os.listdir(folder))  # the recording is still processed
    return code


def test_a_closed_pipe_for_the_summary_is_no_error(tmp_path, monkeypatch, capsys):
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as stdout:
        assert printed(stdout, tmp_path, monkeypatch) == 0 and capsys.readouterr().err == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_summary_that_cannot_be_printed_is_one_line(tmp_path, monkeypatch, capsys):
    with open("/dev/full", "w") as stdout:
        assert printed(stdout, tmp_path, monkeypatch) == 2
    said = "lassokin replay: the work is done, but its summary cannot be printed: No space left on device\n"
    assert capsys.readouterr().err == said


@pytest.mark.skipif(sys.platform != "linux", reason="file systems elsewhere have no such names")
def test_names_that_are_no_utf8_are_printed(tmp_path, monkeypatch):
    with open(tmp_path / "said", "w", encoding="utf-8") as stdout:
        assert printed(stdout, tmp_path, monkeypatch) == 0
    assert "walk\\udcff" in (tmp_path / "said").read_text(encoding="utf-8")
    assert "<h1>walk\\udcff" in (tmp_path / "page").read_text(encoding="utf-8")


@pytest.mark.parametrize("number", ["x", "1.5", "0", "-1", ""])
def test_an_invalid_number_of_processes_is_reported(number, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["a", f"--jobs={number}"])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.startswith("usage: lassokin replay")
    assert said.endswith(f"error: argument --jobs: '{number}'; expected a whole number, 1 or more\n")
