"""Recordings with topics of other encodings, and files that are no recordings of ROS 2."""

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from recordings import write_messages, write_recording  # noqa: E402
from rosbags.rosbag2 import StoragePlugin, Writer, storage_mcap  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.replay.bags import BagReader, typestore  # noqa: E402

OTHER = {
    "jsonschema": ("json", b'{"type": "object"}'),
    "protobuf": ("protobuf", b"\n\xc3\x01\xff\xfe foxglove.Pose"),
    "ros1msg": ("ros1", b"string data"),
    "flatbuffer": ("flatbuffer", b"\x00\x00\xff\x80"),
}
"""Encoding of a schema in mcap -> encoding of its messages, and a schema."""


def with_topic(path, schema_encoding, monkeypatch, topic="/other", message_type="std_msgs/msg/String"):
    """A recording of 5 frames with one more topic of this encoding, in mcap."""
    encoding, schema = OTHER[schema_encoding]
    write = storage_mcap.write_schema

    def write_schema(bio, given):
        if given.name != message_type:
            return write(bio, given)
        record = storage_mcap.BytesIO()
        storage_mcap.write_uint16(record, given.id)
        storage_mcap.write_string(record, given.name)
        storage_mcap.write_string(record, schema_encoding)
        storage_mcap.write_uint32(record, len(schema))
        record.write(schema)
        storage_mcap.write_record(bio, 0x03, record)

    good = path.with_name("good")
    if not good.exists():
        write_recording(good, 5)
    with BagReader(good) as bag:
        kinds = {item.name: item.message_type for item in bag.topics}
        items = list(bag.raw(bag.topics))
    types = typestore()
    with monkeypatch.context() as patched, Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        patched.setattr(storage_mcap, "write_schema", write_schema)
        made = {
            name: writer.add_connection(name, kind, typestore=types) for name, kind in kinds.items() if name != topic
        }
        other = writer.add_connection(topic, message_type, typestore=types, serialization_format=encoding)
        for name, time_ns, data in items:
            writer.write(made.get(name, other), time_ns, data if name in made else b"{}")
        writer.write(other, items[-1][1], b"{}")
    return path


@pytest.mark.parametrize("schema_encoding", OTHER)
def test_a_topic_of_another_encoding_is_not_looked_at_or_named_if_it_is_needed(
    schema_encoding, tmp_path, monkeypatch, capsys
):
    path, form = with_topic(tmp_path / "walk", schema_encoding, monkeypatch), OTHER[schema_encoding][0]
    assert main([str(path), "-o", str(tmp_path / "out")]) == 0
    assert "5 in, 5 out" in capsys.readouterr().out
    assert main([str(path), "-o", str(tmp_path / "nix"), "--keypoints-topic", "/nix"]) == 2
    assert f"/other (std_msgs/msg/String, 1 messages in {form})" in capsys.readouterr().err
    path = with_topic(tmp_path / "other", schema_encoding, monkeypatch, "/keypoints", "sensor_msgs/msg/PointCloud2")
    for arguments in ([], ["--keypoints-topic", "/keypoints"]):
        assert main([str(path), "-o", str(tmp_path / "nix"), *arguments]) == 2
        text = capsys.readouterr().err
        assert f"topic '/keypoints' of {path} has messages in {form}; expected cdr" in text


def test_a_topic_in_cdr_is_preferred_to_one_of_another_encoding(tmp_path, monkeypatch, capsys):
    path = with_topic(tmp_path / "walk", "ros1msg", monkeypatch, "/a/keypoints", "sensor_msgs/msg/PointCloud2")
    assert main([str(path), "-o", str(tmp_path / "out")]) == 0
    assert "5 in, 5 out" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("walk.bag", "is a recording of ROS 1; expected a rosbag2 folder, or a .mcap or .db3 file: convert it with: "),
        ("walk.MP4", "is a video; expected a rosbag2 folder, or a .mcap or .db3 file: track it with: lassokin track "),
        ("keypoints.json", "is a file of keypoints, not a recording of messages; expected a rosbag2 folder"),
        ("metadata.yaml", "give the folder of the recording: "),
        ("walk.tar.gz", "unpack it"),
        ("0001.png", "track the folder of images with: lassokin track "),
    ],
)
def test_files_of_other_kinds_are_named_with_what_to_do(name, words, tmp_path, capsys):
    (tmp_path / name).write_bytes(b"#ROSBAG V2.0\n")
    assert main([str(tmp_path / name), "-o", str(tmp_path / "out")]) == 2
    text = capsys.readouterr().err
    assert words in text and name in text and len(text.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_of_other_files_is_named_with_what_to_do(tmp_path, capsys):
    for name, words in (
        ("0001.png", "it has images: track them with: lassokin track "),
        ("a.bag", "a recording of ROS 1"),
    ):
        folder = tmp_path / name.partition(".")[2]
        folder.mkdir()
        (folder / name).touch()
        assert main([str(folder), "-o", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert "it has no metadata.yaml; it has " in said and words in said


@pytest.mark.parametrize(("profile", "code"), [("", 0), ("ros1", 2)])
def test_a_file_without_a_profile_is_read(tmp_path, monkeypatch, capsys, profile, code):
    """As other programs write it; the profile is a note."""
    write = storage_mcap.write_string
    with monkeypatch.context() as patched:
        patched.setattr(storage_mcap, "write_string", lambda io, text: write(io, profile if text == "ros2" else text))
        path = write_recording(tmp_path / "walk", 5)
    assert main([str(path), "-o", str(tmp_path / "out")]) == code
    said = capsys.readouterr()
    assert "5 in, 5 out" in said.out if code == 0 else "Profile is not ros2" in said.err


def test_a_readers_context_changes_rosbags_only_while_a_file_is_opened(tmp_path):
    kept = storage_mcap.get_msgdef, storage_mcap.read_string
    with BagReader(write_messages(tmp_path / "none", [])):
        assert (storage_mcap.get_msgdef, storage_mcap.read_string) == kept
