"""Recordings of killed recorders, of re-indexing and in parts: read in full, refused, or the difference is stated."""

import shutil
import sqlite3

import pytest
import yaml

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from detector_messages import HRI, YOLO, ZED, detector_types, hri_skeleton, yolo_detections, zed_objects  # noqa: E402
from recordings import contents, read, synthetic_pixels, webcam_info, write_messages, write_recording  # noqa: E402
from rosbags.typesys import get_types_from_msg  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.demo.synthetic import WEBCAM  # noqa: E402
from lassokin_ros.replay.bags import BagError, BagReader, typestore  # noqa: E402
from msg_adapters.backends import RosbagsBackend  # noqa: E402
from msg_adapters.detectors.definitions import OLDER, versions  # noqa: E402

FRAMES = 12


@pytest.fixture(scope="module")
def database(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("sqlite3") / "walk", FRAMES, "sqlite3")


@pytest.fixture(scope="module")
def mcap(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("mcap") / "walk", FRAMES, "mcap")


def replayed(bag, tmp_path, capsys, *more):
    """(exit code, stdout, stderr)."""
    code = main([str(bag), "--output", str(tmp_path / "out"), *more])
    return code, *capsys.readouterr()


def kill_recorder(folder, target, kept):
    """Copy the recording as a killed recorder leaves it: only `kept` rows are in the database, the others in -wal."""
    shutil.copytree(folder, target)
    file = target / "recording.db3"
    writer = sqlite3.connect(file)
    rows = writer.execute("SELECT * FROM messages ORDER BY timestamp, id").fetchall()
    writer.execute("DELETE FROM messages")
    writer.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows[:kept])
    writer.commit()
    assert writer.execute("PRAGMA journal_mode=WAL").fetchone() == ("wal",)
    writer.execute("PRAGMA wal_autocheckpoint=0")
    writer.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows[kept:])
    writer.commit()
    left = {name: (target / name).read_bytes() for name in ("recording.db3", "recording.db3-wal")}
    writer.close()  # this adds the -wal to the database, which a killed recorder does not
    for name, data in left.items():
        (target / name).write_bytes(data)
    return file


@pytest.mark.parametrize("what", ["folder", "file"])
def test_messages_in_the_wal_of_a_killed_recorder_are_read(database, tmp_path, capsys, what):
    file = kill_recorder(database, tmp_path / "killed", kept=FRAMES)
    before = contents(tmp_path / "killed")
    code, out, _ = replayed(file if what == "file" else file.parent, tmp_path, capsys)
    assert code == 0 and f"{FRAMES} in, {FRAMES} out" in out
    assert "recording.db3 was not closed by its recorder; what recording.db3-wal holds is read" in out
    assert contents(tmp_path / "killed") == before  # nothing is changed there


def test_a_wal_of_no_use_is_refused_by_the_count_or_named(database, tmp_path, capsys):
    file = kill_recorder(database, tmp_path / "killed", kept=FRAMES)
    wal = file.with_name("recording.db3-wal")
    wal.write_bytes(bytes(len(wal.read_bytes())))
    code, out, err = replayed(file.parent, tmp_path, capsys)
    assert code == 2 and out == "" and "messages can be read" in err
    file.write_bytes(b"SQLite format 3\0" + bytes(5000))
    code, _, err = replayed(file, tmp_path, capsys)
    assert code == 2 and "recording.db3" in err and err.count("\n") == 1


def test_a_folder_without_metadata_names_its_files(database, tmp_path):
    shutil.copytree(database, tmp_path / "killed")
    (tmp_path / "killed" / "metadata.yaml").unlink()
    with pytest.raises(BagError, match="no metadata.yaml; expected it beside recording.db3: .*ros2 bag reindex"):
        BagReader(tmp_path / "killed")


def test_an_mcap_without_an_end_names_the_tool(mcap, tmp_path, capsys):
    for number, keep in enumerate((0.5, 0.99)):
        broken = shutil.copytree(mcap, tmp_path / f"cut{number}")
        file = broken / "recording.mcap"
        file.write_bytes(file.read_bytes()[: int(keep * file.stat().st_size)])
        for bag in (broken, file):
            code, out, err = replayed(bag, tmp_path, capsys)
            assert code == 2 and out == "" and "mcap recover recording.mcap" in err and err.count("\n") == 1


def change_metadata(folder, target, change):
    shutil.copytree(folder, target)
    file = target / "metadata.yaml"
    data = yaml.safe_load(file.read_text())
    change(data["rosbag2_bagfile_information"])
    file.write_text(yaml.safe_dump(data))
    return target


@pytest.mark.parametrize("storage", ["database", "mcap"])
def test_a_reindexed_recording_with_an_empty_storage_identifier_is_read(storage, request, tmp_path, capsys):
    def reindex(metadata):
        metadata["storage_identifier"] = ""
        for topic in metadata["topics_with_message_count"]:
            topic["topic_metadata"].update(serialization_format="", offered_qos_profiles="", type_description_hash="")

    folder = request.getfixturevalue(storage)
    bag = change_metadata(folder, tmp_path / "reindexed", reindex)
    code, out, _ = replayed(bag, tmp_path, capsys)
    assert code == 0 and f"{FRAMES} in, {FRAMES} out" in out and "does not name the storage" in out
    assert main([str(folder), "--output", str(tmp_path / "plain")]) == 0
    data = [read(tmp_path / name, "/tracker/translation") for name in ("out", "plain")]
    assert data[0] == data[1] and len(data[0]) == FRAMES


def test_quality_of_service_in_the_metadata_does_not_hide_messages(mcap, tmp_path, capsys):
    qos = {"history": 1, "depth": 5, "reliability": 2, "durability": 2, "liveliness": 1}
    qos.update(dict.fromkeys(("deadline", "lifespan", "liveliness_lease_duration"), {"sec": 0, "nsec": 0}))
    qos["avoid_ros_namespace_conventions"] = False

    def other(metadata):
        for topic in metadata["topics_with_message_count"]:
            topic["topic_metadata"]["offered_qos_profiles"] = yaml.safe_dump([qos])

    code, out, _ = replayed(change_metadata(mcap, tmp_path / "bag", other), tmp_path, capsys)
    assert code == 0 and f"{FRAMES} in, {FRAMES} out" in out


@pytest.mark.parametrize("listed", [0, FRAMES - 3, FRAMES + 3])
def test_counts_in_the_metadata_that_do_not_fit_are_stated(mcap, tmp_path, capsys, listed):
    def miscount(metadata):
        for topic in metadata["topics_with_message_count"]:
            if topic["topic_metadata"]["name"] == "/keypoints":
                topic["message_count"] = listed

    code, out, err = replayed(change_metadata(mcap, tmp_path / "bag", miscount), tmp_path, capsys)
    if listed > FRAMES:
        assert code == 2 and "is damaged: only" in err and "ros2 bag reindex" in err
    else:
        assert code == 0 and f"{FRAMES} in, {FRAMES} out" in out
        assert f"metadata.yaml counts {listed} messages of /keypoints, the files {FRAMES}; all are read" in out


def test_missing_and_unlisted_parts_are_stated(mcap, tmp_path, capsys):
    def split(names):
        def change(metadata):
            metadata["relative_file_paths"] = names

        return change

    bag = change_metadata(mcap, tmp_path / "bag", split(["walk_0.mcap", "walk_1.mcap"]))
    (bag / "recording.mcap").rename(bag / "walk_0.mcap")
    code, _, err = replayed(bag, tmp_path, capsys)
    assert code == 2 and "walk_1.mcap" in err
    bag = change_metadata(mcap, tmp_path / "gap", split(["walk_1.mcap"]))
    (bag / "recording.mcap").rename(bag / "walk_1.mcap")
    shutil.copy(bag / "walk_1.mcap", bag / "walk_2.mcap")
    code, out, _ = replayed(bag, tmp_path, capsys)
    assert code == 0 and "parts of the split recording are missing: number 0" in out
    assert "metadata.yaml does not list walk_2.mcap; not read" in out
    code, out, _ = replayed(bag / "walk_1.mcap", tmp_path, capsys, "--force")
    assert code == 0 and "walk_1.mcap is one part of a split recording; not read: walk_2.mcap" in out


def test_a_complete_recording_has_no_warning(mcap, tmp_path, capsys):
    code, out, err = replayed(mcap, tmp_path, capsys)
    assert code == 0 and "warning" not in out and err == ""


def old_zed_types():
    types = typestore()
    for name, text in versions(ZED)[1].items():
        types.register(get_types_from_msg(text, name))
    return types


def detector_message(kind, backend, stamp_ns, pixels, confidence):
    if kind == HRI:
        points = pixels[[0] * 18]
        return hri_skeleton(backend, stamp_ns, "camera", points, confidence[[0] * 18], WEBCAM.size)
    if kind == YOLO:
        return yolo_detections(backend, stamp_ns, "camera", [(pixels, confidence)], ["1"])
    return zed_objects(backend, stamp_ns, [pixels] if stamp_ns % 2 else [pixels, pixels], [1, 2])


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("kind, types", [(HRI, detector_types), (YOLO, detector_types), (ZED, detector_types),
                                         (ZED, old_zed_types)])  # fmt: skip
def test_detectors_messages_without_definitions_are_decoded(tmp_path, monkeypatch, kind, types, storage):
    types = types()
    backend = RosbagsBackend(types)
    stamps, pixels, confidence = synthetic_pixels(4)
    messages = [("/camera_info", "sensor_msgs/msg/CameraInfo", int(stamps[0]) - 1, webcam_info())]
    sent = [detector_message(kind, backend, int(stamp), *rest) for stamp, *rest in zip(stamps, pixels, confidence)]
    messages += [("/keypoints", kind, int(stamp), message) for stamp, message in zip(stamps, sent)]
    forget_definitions(monkeypatch)
    write_messages(tmp_path / "bag", messages, storage, types)
    got = [message for _, message in read(tmp_path / "bag", "/keypoints")]
    backends = [RosbagsBackend(types)] * len(sent)
    assert [b.serialise(m) for b, m in zip(backends, got)] == [b.serialise(m) for b, m in zip(backends, sent)]


def forget_definitions(monkeypatch):
    """Recordings are then written as by a recorder that does not find the definitions."""
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
    from rosbags.rosbag2 import storage_mcap, storage_sqlite3

    nothing = MessageDefinition(MessageDefinitionFormat.MSG, "")
    for writer in (storage_mcap.McapWriter, storage_sqlite3.Sqlite3Writer):
        add = writer.add_msgtype
        monkeypatch.setattr(writer, "add_msgtype", lambda s, c, add=add: add(s, c._replace(msgdef=nothing)))


@pytest.mark.parametrize("storage, advice", [("mcap", "where its package is installed"), ("sqlite3", "as mcap")])
def test_an_unknown_type_without_a_definition_is_refused(tmp_path, monkeypatch, storage, advice):
    types = typestore()
    types.register(get_types_from_msg("int32 a", "some_msgs/msg/A"))
    forget_definitions(monkeypatch)
    message = types.types["some_msgs/msg/A"](1)
    write_messages(tmp_path / "bag", [("/a", "some_msgs/msg/A", 1, message)], storage, types)
    with pytest.raises(BagError, match=f"does not contain the definition of some_msgs/msg/A; record it {advice}"):
        read(tmp_path / "bag", "/a")


def test_the_older_definitions_differ_on_the_wire_only_where_they_say():
    assert set(OLDER) <= set(versions(ZED)[0]) and len(versions(ZED)) == 2 and versions("a_msgs/msg/B") == []
