"""Bad input to `replay`: one line with the fault and the expected form, exit code 2, nothing written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from recordings import START_NS, webcam_info, write_messages, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
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
    (folder / "broken.yaml").write_text("tracker: [")
    (folder / "list.yaml").write_text("- 1")
    (folder / "other.yaml").write_text("detector:\n  ros__parameters:\n    height: 1.8\n")
    (folder / "flat.yaml").write_text("tracker:\n  height: 1.8\n")
    (folder / "unknown.yaml").write_text("tracker:\n  ros__parameters:\n    hight: 1.8\n")
    (folder / "range.yaml").write_text("/**:\n  ros__parameters:\n    height: 180\n")
    (folder / "type.yaml").write_text("/**:\n  ros__parameters:\n    height: tall\n")
    (folder / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    (folder / "body.yaml").write_text("joints:\n  - {name: a, parent: b, position: [0, 0, 0]}\n")
    (folder / "marks.yaml").write_text("landmarks:\n  - {name: nose, joint: nose, offset: [0, 0, 0]}\n")
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
    "unknown carrier": (["good", "-p", "keypoints_type:=std_msgs/String"], "keypoints_type is 'std_msgs/String'"),
    "no such file": (["good", "--params-file", "nix.yaml"], "nix.yaml cannot be read: No such file or directory"),
    "broken YAML": (["good", "--params-file", "broken.yaml"], "broken.yaml is no valid YAML: "),
    "a list": (["good", "--params-file", "list.yaml"], "list.yaml holds list; expected a mapping at the top level"),
    "binary": (["good", "--params-file", "binary.yaml"], "binary.yaml is no UTF-8 text: "),
    "another node": (
        ["good", "--params-file", "other.yaml"],
        "other.yaml has parameters for detector; expected 'tracker' or '/**' at the top level",
    ),
    "flat": (["good", "--params-file", "flat.yaml"], "flat.yaml has no mapping 'ros__parameters' under 'tracker'"),
    "misspelt": (
        ["good", "--params-file", "unknown.yaml"],
        "unknown.yaml: there is no parameter 'hight'; did you mean 'height'?",
    ),
    "out of range": (["good", "--params-file", "range.yaml"], "height is 180.0; expected 0 to 2.6 m"),
    "wrong kind": (["good", "--params-file", "type.yaml"], "height is 'tall'; expected a value of type float"),
    "unknown option": (["good", "-p", "colour:=red"], "-p: there is no parameter 'colour'; expected one of: height, "),
    "no value": (["good", "-p", "height=1.8"], "-p 'height=1.8'; expected name:=value, such as height:=1.80"),
    "no YAML value": (["good", "-p", "height:=["], "-p height:=[ is no valid YAML: "),
    "wrong tree": (
        ["good", "-p", "skeleton:=body.yaml"],
        "body.yaml: joint 'a' has parent 'b'; the first joint, and no other, is the root (null)",
    ),
    "no skeleton": (["good", "-p", "skeleton:=alien"], "skeleton 'alien' is neither built in (anthropometric, "),
    "unknown landmark joint": (
        ["good", "-p", "landmarks:=marks.yaml"],
        "marks.yaml: landmark 'nose' has joint 'nose', which is not in skeleton 'anthropometric'; its joints",
    ),
    "no layout": (["good", "-p", "landmarks:=coco"], "landmark layout 'coco' is neither built in (body25, body25b"),
    "no solver": (["good", "-p", "solver:=magic"], "solver 'magic' is not available; expected one of: proxqp"),
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


def replay_into(stdout, folder, *arguments):
    """(exit code, stderr) of a replay whose summary cannot be written or has no reader."""
    command = [sys.executable, "-m", "lassokin_ros.cli.replay", *arguments, "--report", "page"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, cwd=folder, env=environment)
    assert {"out", "page"} <= set(os.listdir(folder))  # the recording is still processed
    return done.returncode, done.stderr


@pytest.fixture
def arguments(request, tmp_path):
    """Of one recording, or with the mark of an archive."""
    for name in ("walk", "wave"):
        write_recording(tmp_path / name, 3)
    return [*request.param, "--output", "out"]


one = pytest.mark.parametrize("arguments", [["walk"]], indirect=True, ids=["one"])
archive = pytest.mark.parametrize("arguments", [["walk", "wave", "--jobs", "1"]], indirect=True, ids=["archive"])


@one
def test_a_closed_pipe_for_the_summary_is_no_error(arguments, tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    assert replay_into(writer, tmp_path, *arguments) == (0, "")
    os.close(writer)


@one
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_summary_that_cannot_be_printed_is_one_line(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as full:
        full.setattr(sys, "stdout", open("/dev/full", "w"))
        assert main([*arguments, "--report", "page"]) == 2
    said = "lassokin replay: the work is done, but its summary cannot be printed: No space left on device\n"
    assert capsys.readouterr().err == said and {"out", "page"} <= set(os.listdir())


@archive
@pytest.mark.skipif(sys.platform != "linux", reason="file systems elsewhere have no such names")
def test_names_that_are_no_utf8_are_printed(arguments, tmp_path, monkeypatch):
    (tmp_path / "walk").rename(tmp_path / NO_UTF8)
    monkeypatch.setenv("PYTHONIOENCODING", "utf-8:strict")
    with open(tmp_path / "said", "w+", encoding="utf-8") as file:
        assert replay_into(file, tmp_path, NO_UTF8, *arguments[1:]) == (0, "")
        assert "walk\\udcff" in (tmp_path / "said").read_text(encoding="utf-8")
    pages = [tmp_path / "page"] if (tmp_path / "page").is_file() else sorted((tmp_path / "page").iterdir())
    assert "<h1>walk\\udcff" in pages[0].read_text(encoding="utf-8")


@pytest.mark.parametrize("number", ["x", "1.5", "0", "-1", ""])
def test_an_invalid_number_of_processes_is_reported(number, capsys):
    with pytest.raises(SystemExit):
        main(["a", f"--jobs={number}"])
    said = capsys.readouterr().err.splitlines()[-1]
    assert said == f"lassokin replay: error: argument --jobs: '{number}'; expected a whole number, 1 or more"


@pytest.mark.parametrize("arguments", [[], ["a", "--jobs", "0"], ["a", "--storage", "zip"], ["a", "--nonsense"]])
def test_usage_errors_end_with_code_2(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2 and "usage: lassokin replay" in capsys.readouterr().err
