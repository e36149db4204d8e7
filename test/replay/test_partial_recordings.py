"""Recordings of killed recorders, with missing parts or with wrong metadata: all frames, or a refusal."""

import os
import shutil
import sqlite3

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from detector_messages import HRI, YOLO, ZED  # noqa: E402
from faults.courses import LAYOUTS, TYPES, message_of, people, stamp_of  # noqa: E402
from recordings import webcam_info, write_messages, write_recording  # noqa: E402
from ruamel.yaml import YAML  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.replay.bags import BagReader, register_types, typestore  # noqa: E402
from lassokin_ros.replay.recording_files import BagError  # noqa: E402
from msg_adapters.definitions import DEFINITIONS, OLDER  # noqa: E402
from msg_adapters.detectors.registry import keypoint_adapter  # noqa: E402

FRAMES, LATE = 18, 6
STORAGES = {"mcap": ".mcap", "sqlite3": ".db3"}


@pytest.fixture(scope="module", params=STORAGES)
def recording(request, tmp_path_factory):
    """A recording with one data file, walk_0."""
    folder = write_recording(tmp_path_factory.mktemp(request.param) / "walk", FRAMES, request.param)
    suffix = STORAGES[request.param]
    (folder / f"recording{suffix}").rename(folder / f"walk_0{suffix}")
    edit(folder, lambda info: info.update(relative_file_paths=[f"walk_0{suffix}"]))
    return folder


@pytest.fixture(scope="module")
def parts(recording, tmp_path_factory):
    """The same in three parts of FRAMES / 3 frames."""
    suffix = suffix_of(recording)
    folder = tmp_path_factory.mktemp("split") / "walk"
    with BagReader(recording) as bag:
        types = {topic.name: topic.message_type for topic in bag.topics}
        items = [(name, types[name], time_ns, data) for name, time_ns, data in bag.raw(bag.topics)]
    shutil.copytree(recording, folder)
    (folder / f"walk_0{suffix}").unlink()
    share = len(items) // 3
    for number in range(3):
        part = write_messages(
            folder.parent / f"part{number}", items[number * share : (number + 1) * share], storage_of(suffix)
        )
        next(part.glob(f"*{suffix}")).rename(folder / f"walk_{number}{suffix}")
    edit(folder, lambda info: info.update(relative_file_paths=[f"walk_{number}{suffix}" for number in range(3)]))
    return folder


def suffix_of(folder):
    return next(file.suffix for file in folder.iterdir() if file.suffix in STORAGES.values())


def storage_of(suffix):
    return next(name for name, other in STORAGES.items() if other == suffix)


def edit(folder, change):
    """Change rosbag2_bagfile_information of metadata.yaml."""
    yaml, path = YAML(typ="safe"), folder / "metadata.yaml"
    data = yaml.load(path.read_text())
    change(data["rosbag2_bagfile_information"])
    with path.open("w") as file:
        yaml.dump(data, file)


def copy_of(folder, tmp_path):
    return shutil.copytree(folder, tmp_path / "walk")


def frames_read(path):
    with BagReader(path) as bag:
        topic = bag.find("sensor_msgs/msg/PointCloud2", None, "keypoints", "--keypoints-topic")
        return sum(message is not None for _, _, message in bag.messages([topic]))


def refusal(path):
    """The one line of the error; test_damaged_files.py has the command."""
    with pytest.raises(BagError) as error:
        frames_read(path)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """Database and write-ahead log of a killed recorder: only the log contains the last LATE frames."""
    whole = write_recording(tmp_path_factory.mktemp("killed") / "whole", FRAMES, "sqlite3") / "recording.db3"
    folder = tmp_path_factory.mktemp("killed_files")
    connection = sqlite3.connect(whole, isolation_level=None)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA wal_autocheckpoint=0")
    connection.execute("CREATE TEMP TABLE late AS SELECT * FROM messages ORDER BY timestamp DESC LIMIT ?", [2 * LATE])
    connection.execute("DELETE FROM messages WHERE id IN (SELECT id FROM late)")
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    for (row,) in connection.execute("SELECT id FROM late ORDER BY id").fetchall():
        connection.execute("INSERT INTO messages SELECT * FROM late WHERE id = ?", [row])
    for suffix in ("", "-wal"):
        shutil.copyfile(f"{whole}{suffix}", folder / f"walk_0.db3{suffix}")
    connection.close()
    shutil.copyfile(whole.with_name("metadata.yaml"), folder / "metadata.yaml")
    edit(folder, lambda info: info.update(relative_file_paths=["walk_0.db3"]))
    return folder


def test_messages_in_a_killed_recorders_log_are_read(killed, tmp_path):
    folder = copy_of(killed, tmp_path)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert frames_read(folder / "walk_0.db3") == FRAMES
    assert frames_read(folder) == FRAMES
    assert before == {file.name: file.read_bytes() for file in folder.iterdir()}  # the input is not changed


def test_a_killed_recorders_folder_without_metadata_is_read_as_an_archive(killed, tmp_path):
    from lassokin_ros.archive.archive import tasks_of
    from lassokin_ros.cli.replay import parser

    folder = copy_of(killed, tmp_path)
    (folder / "metadata.yaml").unlink()
    (task,) = tasks_of(parser().parse_args([str(folder), "-o", str(tmp_path / "out")]))
    assert task.options.bag == folder / "walk_0.db3" and frames_read(task.options.bag) == FRAMES


def test_a_damaged_or_missing_log_is_refused(killed, tmp_path):
    folder = copy_of(killed, tmp_path)
    log = folder / "walk_0.db3-wal"
    whole = log.read_bytes()
    for place in (8, 20, 40, len(whole) // 2):  # header, its salts, first frame, a frame in the middle
        log.write_bytes(whole[:place] + bytes(byte ^ 255 for byte in whole[place : place + 8]) + whole[place + 8 :])
        said = refusal(folder / "walk_0.db3")
        assert "walk_0.db3-wal' cannot be merged" in said and "damaged" in said
    log.write_bytes(bytes(len(whole)))  # as after a power failure
    assert "walk_0.db3-wal' cannot be merged" in refusal(folder / "walk_0.db3")
    log.unlink()
    said = refusal(folder)  # without metadata.yaml the loss is not visible
    assert f"only {FRAMES - LATE} of its {FRAMES} messages of /keypoints can be read from walk_0.db3" in said


def test_a_half_written_transaction_is_rolled_back(tmp_path):
    """A rollback journal: the database contains pages of a transaction that was not completed."""
    folder = write_recording(tmp_path / "walk", FRAMES, "sqlite3")
    database = folder / "recording.db3"
    connection = sqlite3.connect(database, isolation_level=None)
    connection.execute("PRAGMA cache_size=1")  # writes pages before the commit
    connection.execute("BEGIN IMMEDIATE")
    connection.execute("DELETE FROM messages WHERE id % 2")
    journal = database.with_name("recording.db3-journal")
    saved = database.read_bytes(), journal.read_bytes()
    connection.execute("ROLLBACK")
    connection.close()
    assert saved[0] != database.read_bytes()
    database.write_bytes(saved[0])
    journal.write_bytes(saved[1])
    assert frames_read(folder) == FRAMES


def test_an_mcap_file_without_end_names_the_tool(tmp_path):
    folder = write_recording(tmp_path / "walk", FRAMES)
    file = folder / "recording.mcap"
    file.write_bytes(file.read_bytes()[:-4000])
    for path in (folder, file):
        assert f"{file} -o recovered.mcap" in refusal(path)


def test_a_split_recording_is_read_completely_in_order_of_time(parts, tmp_path):
    folder = copy_of(parts, tmp_path)
    assert frames_read(folder) == FRAMES
    with BagReader(folder) as bag:
        messages = list(bag.raw(bag.topics))
    edit(folder, lambda info: info["relative_file_paths"].reverse())  # sorted as by `ros2 bag reindex`
    with BagReader(folder) as bag:
        assert list(bag.raw(bag.topics)) == messages


def test_a_missing_part_is_named(parts, tmp_path):
    folder, suffix = copy_of(parts, tmp_path), suffix_of(parts)
    (folder / f"walk_1{suffix}").rename(tmp_path / "away")
    assert f"its file 'walk_1{suffix}' is missing" in refusal(folder)
    edit(folder, lambda info: info["relative_file_paths"].pop(1))
    assert f"its part 'walk_1{suffix}' is missing" in refusal(folder)
    (tmp_path / "away").rename(folder / f"walk_1{suffix}")
    edit(folder, lambda info: info.update(relative_file_paths=[f"walk_0{suffix}", f"walk_1{suffix}"]))
    assert f"has the part 'walk_2{suffix}', which metadata.yaml does not list" in refusal(folder)


def test_a_part_that_was_cut_is_named(parts, tmp_path):
    folder, suffix = copy_of(parts, tmp_path), suffix_of(parts)
    part = folder / f"walk_1{suffix}"
    part.write_bytes(part.read_bytes()[:4096])
    assert f"walk_1{suffix} cannot be read" in refusal(folder)


def test_a_part_that_was_reindexed_alone_is_a_recording(parts, tmp_path):
    folder, suffix = copy_of(parts, tmp_path), suffix_of(parts)
    for number in (0, 1):
        (folder / f"walk_{number}{suffix}").unlink()

    def reindexed(info):
        info["relative_file_paths"] = [f"walk_2{suffix}"]
        for topic in info["topics_with_message_count"]:
            topic["message_count"] = FRAMES // 3

    edit(folder, reindexed)
    assert frames_read(folder) == FRAMES // 3


def test_fewer_messages_than_metadata_counts_are_refused(recording, tmp_path):
    folder, suffix = copy_of(recording, tmp_path), suffix_of(recording)

    def more(info):
        for topic in info["topics_with_message_count"]:
            topic["message_count"] += 30
        info["files"] = [{"path": f"walk_0{suffix}", "message_count": 2 * FRAMES + 60}]

    edit(folder, more)
    said = refusal(folder)
    assert f"only {FRAMES} of its {FRAMES + 30} messages of /keypoints can be read from walk_0{suffix}" in said


def less(info):
    for topic in info["topics_with_message_count"]:
        topic["message_count"] = 1
    info["message_count"] = 2


def other_qos(info):
    for topic in info["topics_with_message_count"]:
        topic["topic_metadata"]["offered_qos_profiles"] = ""
        topic["topic_metadata"]["type_description_hash"] = "RIHS01_0"


WRONG = {
    "no storage identifier": lambda info: info.update(storage_identifier=""),
    "another storage": lambda info: info.update(storage_identifier="my_plugin"),
    "fewer messages": less,
    "other profiles": other_qos,
    "no topics": lambda info: info.update(topics_with_message_count=[]),
    "no files": lambda info: info.update(relative_file_paths=[]),
}


@pytest.mark.parametrize("case", WRONG)
def test_good_data_is_read_despite_wrong_metadata(recording, tmp_path, case):
    folder = copy_of(recording, tmp_path)
    edit(folder, WRONG[case])
    assert frames_read(folder) == FRAMES


def without_definitions(folder):
    with sqlite3.connect(folder / "recording.db3") as connection:
        connection.execute("DELETE FROM message_definitions")
    connection.close()


def without_schemas(monkeypatch):
    """The recordings in mcap are written as by a recorder that does not find the definitions."""
    from rosbags.rosbag2 import storage_mcap

    real = storage_mcap.write_schema
    monkeypatch.setattr(storage_mcap, "write_schema", lambda bio, schema: real(bio, schema._replace(data="")))


@pytest.mark.parametrize("storage", STORAGES)
def test_messages_of_an_older_zed_msgs_need_no_definition(storage, tmp_path, monkeypatch):
    """Its bodies lack the confidence of each keypoint that the present definition has."""
    older = typestore()
    register_types(older, {**DEFINITIONS, **OLDER})
    _, (pixels, _) = people(LAYOUTS[ZED])
    sent = [message_of(ZED, [pixels[1][n]] * (1 + n % 2), stamp_of(n), [3, 4][: 1 + n % 2]) for n in range(4)]
    messages = [("/keypoints", ZED, stamp_of(n), bytes(older.serialize_cdr(m, ZED))) for n, m in enumerate(sent)]
    without_schemas(monkeypatch)
    folder = write_messages(tmp_path / "walk", messages, storage, TYPES)
    if storage == "sqlite3":
        without_definitions(folder)
    with BagReader(folder) as bag:
        got = [message for *_, message in bag.messages(bag.topics)]
    assert [older.serialize_cdr(m, ZED) for m in got] == [older.serialize_cdr(m, ZED) for m in sent]
    decode = keypoint_adapter(ZED).decode
    assert [decode(m, None).xy.tolist() for m in got] == [decode(m, None).xy.tolist() for m in sent]


@pytest.mark.parametrize("storage, advice", [("mcap", "record where"), ("sqlite3", "record as mcap where")])
def test_an_unknown_type_without_definition_is_refused_with_advice(storage, advice, tmp_path, monkeypatch):
    from rosbags.typesys import get_types_from_msg

    types = typestore()
    types.register(get_types_from_msg("int32 a", "some_msgs/msg/A"))
    without_schemas(monkeypatch)
    folder = write_messages(
        tmp_path / "walk", [("/a", "some_msgs/msg/A", 1, types.types["some_msgs/msg/A"](1))], storage, types
    )
    if storage == "sqlite3":
        without_definitions(folder)
    with pytest.raises(BagError, match=f"no usable definition of some_msgs/msg/A .*; {advice} the message's"):
        with BagReader(folder) as bag:
            list(bag.messages(bag.topics))


@pytest.mark.parametrize("message_type, storage", [(HRI, "sqlite3"), (YOLO, "mcap"), (ZED, "sqlite3")])
def test_detectors_messages_need_no_definition_in_the_recording(message_type, storage, tmp_path, capsys, monkeypatch):
    info = ("/camera_info", "sensor_msgs/msg/CameraInfo", stamp_of(0), webcam_info(stamp_of(0)))
    _, (pixels, _) = people(LAYOUTS[message_type])
    frames = [message_of(message_type, [pixels[1][n]], stamp_of(n), [3]) for n in range(6)]
    messages = [("/keypoints", message_type, stamp_of(n), message) for n, message in enumerate(frames)]
    without_schemas(monkeypatch)
    folder = write_messages(tmp_path / "walk", [info, *messages], storage, TYPES)
    if storage == "sqlite3":
        without_definitions(folder)
    more = ["-p", f"keypoints_type:={message_type}", "-p", f"landmarks:={LAYOUTS[message_type]}"]
    assert main([str(folder), "-o", str(tmp_path / "out"), *more]) == 0
    assert "6 in, 6 out" in capsys.readouterr().out
    assert sorted(os.listdir(tmp_path)) == ["out", "walk"]
