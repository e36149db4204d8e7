"""Cut or corrupted recordings, and outputs that cannot be written: one line, exit code 2, no incomplete files."""

import os
import resource
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from recordings import contents, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.common.atomic_files import AtomicFiles, refuse_existing  # noqa: E402
from lassokin_ros.core.errors import LassokinError  # noqa: E402
from lassokin_ros.replay.bag_writer import BagWriter  # noqa: E402
from lassokin_ros.replay.bags import typestore  # noqa: E402

STORAGES = {"mcap": "*.mcap", "sqlite3": "*.db3"}
FRAMES = 8
CASES = int(os.environ.get("LASSOKIN_FILE_CASES", 5))


@pytest.fixture(scope="module", params=STORAGES)
def damaged(request, tmp_path_factory):
    """(folder of a recording, its data file's bytes, the file's name)."""
    folder = write_recording(tmp_path_factory.mktemp(request.param) / "walk", FRAMES, request.param)
    (file,) = folder.glob(STORAGES[request.param])
    return folder, file.read_bytes(), file.name


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("in") / "walk", FRAMES)


def replay_of(tmp_path, capsys, damaged, data):
    """Exit code of a replay of the recording with other bytes. Properties that hold for all bytes are checked here."""
    folder, _, name = damaged
    shutil.copytree(folder, tmp_path / "bag")
    (tmp_path / "bag" / name).write_bytes(data)
    code = main([str(tmp_path / "bag"), "--output", str(tmp_path / "out")])
    said = capsys.readouterr()
    if code == 0:
        assert said.err == "" and (tmp_path / "out" / "metadata.yaml").is_file()
        assert f"{FRAMES} in, " in said.out  # no message is lost without being counted
    else:
        assert code == 2 and said.out == "" and said.err.count("\n") == 1 and len(said.err) < 2000
        assert said.err.startswith("lassokin replay: ") and "Traceback" not in said.err
    assert set(os.listdir(tmp_path)) <= {"bag"} | ({"out"} if code == 0 else set())
    shutil.rmtree(tmp_path / "bag")
    shutil.rmtree(tmp_path / "out", ignore_errors=True)
    return code


def test_a_recording_cut_anywhere_is_refused(damaged, tmp_path, capsys):
    """Unless every message is still there: the last page of a database may be empty."""
    whole = damaged[1]
    for keep in np.linspace(0, len(whole) - 1, CASES).astype(int).tolist():
        assert replay_of(tmp_path, capsys, damaged, whole[:keep]) == 2 or keep == len(whole) - 1, keep


def test_a_recording_with_wrong_bytes_is_refused_or_read_without_them(damaged, tmp_path, capsys):
    """A message with wrong content is counted, and a file with a broken structure is refused; nothing else happens."""
    whole, random = damaged[1], np.random.default_rng(4)
    codes = set()
    for case in range(2 * CASES):
        data = np.frombuffer(whole, np.uint8).copy()
        places = random.integers(0, len(data), [1, 10, 1000][case % 3])
        if case % 2:
            places = places % 4096  # the structure of the file
        data[places] = random.integers(0, 256, len(places))
        codes.add(replay_of(tmp_path, capsys, damaged, data.tobytes()))
    assert 2 in codes


@pytest.mark.parametrize(
    "metadata", [b"", b"a: [", b"a: 1", b"\xff\xfe", b"rosbag2_bagfile_information: 7", b"x: " * 99]
)
def test_wrong_metadata_is_refused(damaged, metadata, tmp_path, capsys):
    folder = shutil.copytree(damaged[0], tmp_path / "bag")
    (folder / "metadata.yaml").write_bytes(metadata)
    assert main([str(folder), "--output", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("lassokin replay: ") and said.count("\n") == 1 and os.listdir(tmp_path) == ["bag"]


def assert_refused(code, capfd, left, expected):
    said = capfd.readouterr()
    assert code == 2 and said.out == "", said.err
    assert said.err.count("\n") == 1 and said.err.startswith("lassokin replay: "), said.err
    assert "cannot be written" in said.err
    assert sorted(os.listdir(left)) == expected


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("kilobytes", [1, 40])
def test_a_limit_on_the_size_of_files_is_reported_and_leaves_no_files(recording, tmp_path, storage, kilobytes, capfd):
    """RLIMIT_FSIZE fails like a full disk: in the middle of a write, at the end, or when the file is closed."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (kilobytes * 1024, before[1]))
    try:
        code = main([str(recording), "--output", str(tmp_path / "out"), "--storage", storage])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert_refused(code, capfd, tmp_path, [])


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 64 kB, if mounting is permitted."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = shutil.which("mount")
    options = ["-t", "tmpfs", "-o", "size=64k", "tmpfs", str(place)]
    if mount is None or subprocess.run([mount, *options], capture_output=True).returncode != 0:
        pytest.skip("no file system may be mounted here")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)  # an error may hold a file open


@pytest.mark.parametrize("storage", STORAGES)
def test_a_really_full_disk_is_reported_and_leaves_no_files(recording, small_disk, storage, capfd):
    """The old recording is kept if the new one does not fit."""
    with BagWriter(small_disk / "out", "mcap", typestore()) as writer:
        writer.write_raw("/a", "std_msgs/msg/String", 0, b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00")
    before = contents(small_disk / "out")
    code = main([str(recording), "--output", str(small_disk / "out"), "--storage", storage, "--force"])
    assert_refused(code, capfd, small_disk, ["out"])
    assert contents(small_disk / "out") == before


def wants_files(recording, folder, disk):
    """Arguments for an output and an export in `folder`, and a report on `disk`."""
    files = ["--export", str(folder / "walk.csv"), "--report", str(disk / "page.html")]
    return [str(recording), "--output", str(folder / "out"), *files]


def test_no_output_is_left_if_the_disk_is_too_small_for_the_report(recording, small_disk, tmp_path, capsys):
    assert main(wants_files(recording, tmp_path, small_disk)) == 2
    assert "page.html' cannot be written: No space left on device\n" in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["disk"] and os.listdir(small_disk) == []


def test_an_output_that_cannot_be_completed_leaves_no_files(recording, tmp_path, monkeypatch, capsys):
    from rosbags.rosbag2 import Writer

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Writer, "close", full)
    assert main(wants_files(recording, tmp_path, tmp_path)) == 2
    assert "No space left on device" in capsys.readouterr().err and os.listdir(tmp_path) == []


def test_a_name_used_by_something_else_is_reported(recording, tmp_path, monkeypatch, capsys):
    """For example another user's file in a folder like /tmp, in which one may write but not replace it."""
    real = Path.replace

    def not_mine(part, path):
        if path.name == "page.html":
            raise OSError(1, "Operation not permitted")
        return real(part, path)

    monkeypatch.setattr(Path, "replace", not_mine)
    assert main(wants_files(recording, tmp_path, tmp_path)) == 2
    out, table, page = (tmp_path / name for name in ("out", "walk.csv", "page.html"))
    reason = f"'{page}' cannot be written: Operation not permitted; written before: {out}, {table}"
    assert capsys.readouterr().err == f"lassokin replay: {reason}\n"
    assert sorted(os.listdir(tmp_path)) == ["out", "walk.csv"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_write_permission_is_reported(recording, tmp_path, capsys):
    tmp_path.chmod(0o555)
    assert main([str(recording), "--output", str(tmp_path / "out")]) == 2
    assert "cannot be written: Permission denied" in capsys.readouterr().err


def test_a_folder_without_search_permission_is_reported(tmp_path, monkeypatch):
    """With a replacement of the check, because tests may run as root."""

    def is_dir(path, **options):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "is_dir", is_dir)
    with pytest.raises(LassokinError, match="page.html' cannot be written: Permission denied$"):
        refuse_existing(tmp_path / "page.html", False, LassokinError)


def test_a_failing_clean_up_does_not_hide_the_error(tmp_path, monkeypatch):
    """On a disk that is mounted read-only, nothing can be removed either."""

    def read_only(*_, **__):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "open", read_only)
    monkeypatch.setattr(Path, "unlink", read_only)
    with pytest.raises(LassokinError, match="walk.csv' cannot be written: Read-only file system$"):
        with AtomicFiles(False, LassokinError) as files:
            files.write_text(tmp_path / "walk.csv", "stamp")


def test_a_home_that_cannot_be_written_does_not_matter(recording, tmp_path, monkeypatch, capsys):
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, "/proc/nowhere")
    assert main(wants_files(recording, tmp_path, tmp_path)) == 0 and capsys.readouterr().err == ""
    assert sorted(os.listdir(tmp_path)) == ["out", "page.html", "walk.csv"]


def test_a_full_folder_for_temporary_files_is_reported(recording, small_disk, tmp_path, monkeypatch, capsys):
    (small_disk / "other").write_bytes(bytes(64 * 1024))
    monkeypatch.setattr(tempfile, "tempdir", str(small_disk))
    assert main(wants_files(recording, tmp_path, tmp_path)) == 2
    said = capsys.readouterr()
    assert f"a temporary file in {small_disk} cannot be written: No space" in said.err and said.err.count("\n") == 1
    assert said.out == "" and os.listdir(tmp_path) == ["disk"] and os.listdir(small_disk) == ["other"]
