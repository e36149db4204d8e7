"""`replay`: the content of its outputs, reproducibility, and cases in which nothing is written."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from cases import copied_body  # noqa: E402
from forked import Forked  # noqa: E402
from recordings import (  # noqa: E402
    CLOUD,
    FRAME_TOPICS,
    INFO,
    RATE,
    START_NS,
    clouds,
    contents,
    read,
    synthetic_pixels,
    webcam_info,
    write_messages,
    write_recording,
)

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.config import TYPICAL_HEIGHT  # noqa: E402
from lassokin_ros.replay.bag_writer import BagWriter  # noqa: E402
from lassokin_ros.replay.bags import BagError, BagReader, typestore  # noqa: E402
from lassokin_ros.replay.exports.exports import is_inside_name  # noqa: E402
from msg_adapters.backends import RosbagsBackend  # noqa: E402

FRAMES, FEW = 60, 6


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("in") / "walk", FRAMES)


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Few frames, where the outputs' content does not matter."""
    return write_recording(tmp_path_factory.mktemp("in") / "walk", FEW)


@pytest.fixture(scope="module")
def replayed(recording, tmp_path_factory):
    output = tmp_path_factory.mktemp("out") / "tracked"
    assert main([str(recording), "--output", str(output), "-p", "calibrate:=false"]) == 0
    return output


def stamp(header):
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def test_each_frame_has_one_message_of_every_output_with_its_stamp(recording, replayed):
    with BagReader(replayed) as bag:
        counts = {topic.name: (topic.message_type, topic.count) for topic in bag.topics}
    assert counts.pop("/tracker/robot_description") == ("std_msgs/msg/String", 1)
    assert counts.pop("/diagnostics") == ("diagnostic_msgs/msg/DiagnosticArray", FRAMES // int(RATE) - 1)
    assert counts.pop("/tracker/state") == ("std_msgs/msg/String", 2)
    assert [message.data for _, message in read(replayed, "/tracker/state")] == ["lost", "tracking"]
    topics = {**FRAME_TOPICS, "/tracker/people": CLOUD, "/tracker/skeletons": CLOUD}
    assert counts == {name: (kind, FRAMES) for name, kind in topics.items()}
    inputs = [(time_ns, stamp(message.header)) for time_ns, message in read(recording, "/keypoints")]
    for topic in topics:
        outputs = read(replayed, topic)
        headers = [m.markers[0].header if topic == "/tracker/markers" else m.header for _, m in outputs]
        assert [(time_ns, stamp(h)) for (time_ns, _), h in zip(outputs, headers)] == inputs
        assert {h.frame_id for h in headers} == {"camera_optical_frame"}


def test_the_same_recording_gives_the_same_bytes(few, tmp_path):
    """In another process, too; and both storages have the same messages."""
    command = [
        sys.executable,
        "-m",
        "lassokin_ros.cli.replay",
        str(few),
        "--storage",
        "mcap",
        "-o",
        str(tmp_path / "there"),
    ]
    assert Forked(command).wait(timeout=120) == 0
    for storage, file in (("mcap", "recording.mcap"), ("sqlite3", "recording.db3")):
        assert main([str(few), "--output", str(tmp_path / storage), "--storage", storage]) == 0
        assert set(contents(tmp_path / storage)) == {"metadata.yaml", file}
    assert contents(tmp_path / "there") == contents(tmp_path / "mcap")
    types = typestore()
    for topic, kind in FRAME_TOPICS.items():
        a, b = ([types.serialize_cdr(m, kind) for _, m in read(tmp_path / name, topic)] for name in ("mcap", "sqlite3"))
        assert a == b and len(a) == FEW


def test_metadata_has_the_format_of_rosbag2(replayed):
    metadata = yaml.safe_load((replayed / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert metadata["version"] == 9 and metadata["storage_identifier"] == "mcap"
    assert metadata["relative_file_paths"] == ["recording.mcap"]
    topics = {t["topic_metadata"]["name"]: t["topic_metadata"] for t in metadata["topics_with_message_count"]}
    assert topics["/tracker/robot_description"]["offered_qos_profiles"][0]["durability"] == "transient_local"
    assert all(t["type_description_hash"].startswith("RIHS01_") for t in topics.values())


def test_rejected_frames_have_no_output_and_are_counted(tmp_path, capsys):
    def spoil(stamps, pixels, confidence):
        confidence[10:13] = 0
        stamps[30] = stamps[29]

    recording = write_recording(tmp_path / "spoilt", 40, spoil=spoil)
    assert main([str(recording), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert "40 in, 36 out" in said.out and "old_stamp 1, too_few_landmarks 3" in said.out and said.err == ""
    assert "\nrejected first  too_few_landmarks: " in said.out and "stamp has not changed" not in said.out
    assert len(read(tmp_path / "out", "/tracker/joint_states")) == 36


def test_a_recording_without_an_accepted_frame_is_reported_on_stderr(recording, tmp_path, capsys):
    layout = tmp_path / "seven.yaml"
    names = ["nose", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"]
    joints = ["head", *(f"{side}_{joint}" for joint in ("hip", "knee", "ankle") for side in ("left", "right"))]
    marks = [{"name": name, "joint": joint, "offset": [0, 0, 0]} for name, joint in zip(names, joints)]
    layout.write_text(yaml.safe_dump({"landmarks": marks}))
    assert main([str(recording), "-o", str(tmp_path / "out"), "-p", f"landmarks:={layout}"]) == 0
    said = capsys.readouterr()
    sentence = "unknown_id: keypoint id 7; expected 0 to 6 of the landmark layout"
    assert f"\nrejected        unknown_id {FRAMES}\nrejected first  {sentence}\n" in said.out
    assert (
        said.err
        == f"lassokin replay: none of {FRAMES} keypoint messages gave a skeleton; first rejection: {sentence}\n"
    )


def test_the_summary_states_why_camera_info_was_rejected(tmp_path, capsys):
    info = webcam_info()
    info.k = np.zeros(9)
    recording = write_messages(tmp_path / "uncalibrated", [("/camera_info", INFO, START_NS - 1, info), *clouds(3)])
    assert main([str(recording), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert "\nrejected first  camera_uncalibrated: " in said.out
    assert "none of 3 keypoint messages gave a skeleton; first rejection: camera_uncalibrated: " in said.err


def test_unreadable_messages_are_counted(tmp_path, capsys):
    types, messages = typestore(), [("/camera_info", INFO, START_NS - 1, webcam_info())]
    messages += [("/camera_info", INFO, START_NS - 1, b"\x00\x01\x00\x00\x07")]
    for i, (topic, kind, stamp_ns, cloud) in enumerate(clouds(10)):
        data = bytes(types.serialize_cdr(cloud, kind))
        messages.append((topic, kind, stamp_ns, data[: len(data) // 2] if i % 3 == 2 else data))
    recording = write_messages(tmp_path / "torn", messages)
    assert main([str(recording), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "10 in, 7 out" in said and "not_deserialised 4" in said


def test_unstamped_keypoints_get_the_time_of_recording(tmp_path):
    stamps, pixels, confidence = synthetic_pixels(10)
    backend, kind = RosbagsBackend(typestore()), "std_msgs/msg/Float32MultiArray"
    messages = [("/camera_info", INFO, START_NS - 1, webcam_info(frame_id="lens"))]
    for i, stamp_ns in enumerate(stamps.tolist()):
        message = backend.make(kind)
        message.data = np.column_stack([pixels[i], confidence[i]]).astype(np.float32).ravel()
        messages.append(("/keypoints", kind, stamp_ns, message))
    recording = write_messages(tmp_path / "plain", messages)
    assert main([str(recording), "-o", str(tmp_path / "out"), "-p", f"keypoints_type:={kind}"]) == 0
    headers = [message.header for _, message in read(tmp_path / "out", "/tracker/joint_states")]
    assert [stamp(h) for h in headers] == stamps.tolist() and {h.frame_id for h in headers} == {"lens"}


def test_parameters_reach_the_tracker_and_a_single_file_is_a_recording(few, tmp_path):
    tall, (data,) = tmp_path / "tall.yaml", few.glob("*.mcap")
    every = "/**:\n  ros__parameters:\n    height: 1.60\n    noise_px: 4\n"
    tall.write_text(every + "tracker:\n  ros__parameters:\n    height: 2\n")
    for name, bag, options in (
        ("default", data, ["-p", "calibrate:=false"]),
        ("file", few, ["--params-file", str(tall)]),
        ("both", few, ["--params-file", str(tall), *("-p height:=2.0 -p noise_px:=8.0 -p noise_px:=4.0".split())]),
    ):
        assert main([str(bag), "-o", str(tmp_path / name), *options]) == 0
    assert contents(tmp_path / "file") == contents(tmp_path / "both")
    default, tall = (read(tmp_path / name, "/tracker/translation")[-1][1].point.z for name in ("default", "file"))
    assert tall / default == pytest.approx(2.0 / TYPICAL_HEIGHT, rel=0.03)


def test_topics_of_other_names_are_found_or_named(tmp_path):
    info = ("/cam/info", INFO, START_NS - 1, webcam_info())
    other, usual = list(clouds(8, topic="/detector/poses")), list(clouds(8, topic="/detector/keypoints"))
    lidar = ("/lidar", *other[-1][1:])
    named = ["--keypoints-topic", "detector/poses"]
    for name, messages, options in (("a", other, []), ("b", [*other, lidar], named), ("c", [*usual, lidar], [])):
        recording = write_messages(tmp_path / f"in_{name}", [info, *messages])
        assert main([str(recording), "-o", str(tmp_path / name), *options]) == 0
        assert len(read(tmp_path / name, "/tracker/joints")) == 8


def test_an_output_is_kept_without_force_and_replaced_with_it(few, tmp_path, monkeypatch, capsys):
    """By default it is in the current folder. The summary states a height that is to be measured."""
    monkeypatch.chdir(tmp_path)
    assert main([str(few)]) == 0
    said, before = capsys.readouterr().out, contents(tmp_path)
    assert os.listdir() == ["walk_tracked"] and "-> walk_tracked (mcap)" in said
    assert "1.70 m, a mean of people: no depth was measured" in said
    assert main([str(few)]) == 2
    assert "exists already; choose another output or add --force" in capsys.readouterr().err
    with pytest.raises(RuntimeError), BagWriter(Path("walk_tracked"), "mcap", typestore(), replace=True) as writer:
        writer.write_raw("/a", "std_msgs/msg/String", 0, b"")
        raise RuntimeError
    assert contents(tmp_path) == before  # also after a replacement that failed
    every = [word for suffix in (".csv", ".npz", ".bvh", ".amass.npz") for word in ("--export", suffix)]
    assert main([str(few), "--force", "-p", "height:=1.75", "-p", "max_people:=2", *every]) == 0
    assert "a mean of people" not in capsys.readouterr().out and Path("walk_tracked/motion_p1.amass.npz").is_file()
    assert main([str(few), "--force", "-p", "max_people:=2", "--storage", "sqlite3"]) == 0
    assert sorted(os.listdir("walk_tracked")) == ["metadata.yaml", "recording.db3"] and len(os.listdir()) == 1


def test_force_does_not_replace_a_folder_with_other_files(few, tmp_path):
    """Also if they are added while the recording is written."""
    output, kept = tmp_path / "out", "out' is not replaced: it contains '{}', which is not part of the recording; move"
    assert main([str(few), "-o", str(output), "--export", ".csv"]) == 0
    for name in ("notes.txt", "motion_of_mine.csv", ".hidden", "old.mcap", "labels"):
        (output / name).write_text("mine") if name != "labels" else (output / name).mkdir()
        with pytest.raises(BagError, match=kept.format(name)):
            BagWriter(output, "mcap", typestore(), True, is_inside_name)
        (output / name).unlink() if name != "labels" else (output / name).rmdir()
    own = contents(output)
    with pytest.raises(BagError, match=kept.format("notes.txt")):
        with BagWriter(output, "mcap", typestore(), True, is_inside_name):
            (output / "notes.txt").write_text("mine")
    assert contents(output) == own | {"notes.txt": b"mine"} and os.listdir(tmp_path) == ["out"]
    (output / "metadata.yaml").unlink()
    with pytest.raises(BagError, match="is not a rosbag2 recording; it is not replaced"):
        BagWriter(output, "mcap", typestore(), True)


def test_a_signal_leaves_no_files(tmp_path):
    recording = write_recording(tmp_path / "long", 900)
    command = [sys.executable, "-m", "lassokin_ros.cli.replay", str(recording), "--output", str(tmp_path / "out")]
    process = Forked(command)
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob(".out.*.part/recording")):
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    said = process.communicate(timeout=120)[1]
    assert process.returncode == 130 and said == "lassokin replay: interrupted; nothing was written\n"
    assert os.listdir(tmp_path) == ["long"]


def test_progress_is_shown_on_a_terminal(few, tmp_path, monkeypatch):
    import pty

    leader, follower = pty.openpty()
    with os.fdopen(follower, "w") as terminal, monkeypatch.context() as shown:
        shown.setattr(sys, "stderr", terminal)
        assert main([str(few), "--output", str(tmp_path / "a")]) == 0
        terminal.flush()
        said = os.read(leader, 4000).decode()
    os.close(leader)
    assert "messages" in said and f"{2 * FEW}/{2 * FEW}" in said and said.endswith("\r\x1b[K")


def test_the_summary_says_what_a_skeleton_lacks(few, tmp_path, capsys):
    skeleton = Path(copied_body(tmp_path)["skeleton"])
    skeleton.write_text(skeleton.read_text(encoding="utf-8").replace("left_foot", "left_toes"), encoding="utf-8")
    for number, (name, lacks) in enumerate({"anthropometric": False, str(skeleton): True}.items()):
        assert main([str(few), "-o", str(tmp_path / str(number)), "-p", f"skeleton:={name}"]) == 0
        lines = [line.partition("limitations")[2].strip() for line in capsys.readouterr().out.splitlines()]
        said = [line for line in lines if line]
        assert bool(said) == lacks
    assert said[0].startswith("the skeleton has no joint left_foot; off: balance")
