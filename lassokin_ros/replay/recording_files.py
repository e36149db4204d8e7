"""The data files of a recording: their names, a check that none is missing, and their rosbags readers.

An incomplete recording is refused: a part is missing, a file was cut, or a file has fewer messages than metadata.yaml
states. In all other respects the files are used, not metadata.yaml. An mcap file may also have topics of other
encodings, such as JSON or protobuf.
"""

from __future__ import annotations

import re
import shutil
import sqlite3
import struct
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import load_mapping, read_text


class BagError(LassokinError):
    """A recording cannot be read, lacks a required topic, or cannot be written."""


CDR = "cdr"
"""Encoding of the messages of ROS 2."""


@contextmanager
def any_schema() -> Iterator[None]:
    """Within this context rosbags opens an mcap file whatever the encodings of its schemas are, and without a profile.

    A schema that is no message definition of ROS 2 counts as absent. The profile is a note of the file's writer; many
    programs leave it empty.
    """
    from rosbags.rosbag2 import storage_mcap

    module: Any = storage_mcap
    kept = module.get_msgdef, module.read_string
    first = iter([True])  # the first text that is read is the profile

    def get_msgdef(schema: Any) -> Any:
        try:
            return kept[0](schema)
        except KeyError:
            return kept[0](None)

    def read_string(stream: Any) -> str:
        text = str(module.read_bytes(stream).decode(errors="replace"))
        return text or "ros2" if next(first, False) else text

    module.get_msgdef, module.read_string = get_msgdef, read_string
    try:
        yield
    finally:
        module.get_msgdef, module.read_string = kept


def encoding_of(connection: Any) -> str:
    """Return the encoding of a topic's messages, in lower case; connection: of rosbags."""
    return str(getattr(connection.ext, "serialization_format", "") or CDR).lower()


METADATA = "metadata.yaml"
SUFFIXES = (".mcap", ".db3")
PART = re.compile(r"(?P<stem>.*)_(?P<number>\d{1,5})(?P<suffix>\.(mcap|db3)(\.zstd)?)")
"""Name of a file of a split recording. Longer numbers are dates or times."""
MCAP_MAGIC = b"\x89MCAP0\r\n"
_VIDEO = ("a video", "track it with: lassokin track {path}")
_IMAGE = ("an image", "track the folder of images with: lassokin track {path.parent}")
_ARRAYS = (
    "a file of keypoints, not a recording of messages",
    "write it as a recording with write_keypoint_recording (docs/README.md), or track it in Python",
)
_ARCHIVE = ("an archive", "unpack it, and give the recording that it contains")
OTHER_FILES = {
    ".bag": ("a recording of ROS 1", "convert it with: rosbags-convert --src {path} --dst {path.stem}"),
    **dict.fromkeys((".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv"), _VIDEO),
    **dict.fromkeys((".jpg", ".jpeg", ".png"), _IMAGE),
    **dict.fromkeys((".json", ".csv", ".npy", ".npz", ".h5", ".hdf5", ".pkl", ".trc", ".c3d"), _ARRAYS),
    **dict.fromkeys((".yaml", ".yml"), ("a text file", "give the folder of the recording: {path.parent}")),
    **dict.fromkeys((".zip", ".gz", ".tgz", ".tar", ".7z", ".xz"), _ARCHIVE),
}
"""Suffix -> what such a file is, and what to do with it."""


def recording_name(path: Path) -> str:
    """Return the name of a recording: that of its folder, which may have dots, or of its file without the suffix."""
    return path.stem if path.suffix in SUFFIXES and not path.is_dir() else path.name


@dataclass(frozen=True)
class DataFile:
    """An open data file of a recording, or a whole recording that rosbags opens from metadata.yaml (if compressed)."""

    path: Path
    reader: Any


@dataclass(frozen=True)
class Metadata:
    """Content of metadata.yaml. files: names. topics: messages of each topic. counts: messages of each file."""

    files: list[str]
    compressed: bool
    topics: Mapping[str, int] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)

    def check_topics(self, path: Path, files: Sequence[DataFile], names: Iterable[str]) -> None:
        """Raise BagError if the files of the recording `path` hold fewer messages of these topics."""
        found: Counter[str] = Counter()
        for file in files:
            for connection in file.reader.connections:
                found[connection.topic] += connection.msgcount
        read = {file.path.name: file.reader.message_count for file in files}
        for name in names:
            if found[name] < self.topics.get(name, 0):
                where = ", ".join([file for file, count in read.items() if count < self.counts.get(file, 0)] or read)
                raise BagError(
                    f"{path} is damaged: only {found[name]} of its {self.topics[name]} messages of {name} can be read "
                    f"from {where}; to track what is left, replay the file itself, or run: ros2 bag reindex {path}"
                )


def read_metadata(folder: Path) -> Metadata | None:
    """Return the content of metadata.yaml of a recording; None if it cannot be used here."""
    try:
        data = load_mapping(read_text(folder / METADATA, BagError), str(folder), BagError)
        data = data["rosbag2_bagfile_information"]
        files = [PurePath(name).name for name in data["relative_file_paths"] or []]
        mode = str(data.get("compression_mode") or "none").lower()
        topics = {
            entry["topic_metadata"]["name"]: int(entry["message_count"])
            for entry in data.get("topics_with_message_count") or []
        }
        counts = {PurePath(entry["path"]).name: int(entry["message_count"]) for entry in data.get("files") or []}
    except (BagError, KeyError, TypeError, ValueError, AttributeError):
        return None
    return Metadata(files, mode != "none", topics, counts)


def refuse_other_files(path: Path) -> None:
    """Raise BagError for a file that is no recording of ROS 2, with what it is and what to do."""
    if path.is_file() and path.suffix.lower() in OTHER_FILES:
        what, remedy = OTHER_FILES[path.suffix.lower()]
        raise BagError(
            f"'{path}' is {what}; expected a rosbag2 folder, or a .mcap or .db3 file: {remedy.format(path=path)}"
        )


def advice_on_folder(folder: Path) -> str:
    """Return what to do with a folder of images, or of other files that are not read; empty if it has none."""
    suffixes = Counter(file.suffix.lower() for file in folder.iterdir())
    found = [suffix for suffix, _ in suffixes.most_common() if suffix in OTHER_FILES]
    if not found:
        return ""
    if OTHER_FILES[found[0]] is _IMAGE:
        return f"; it has images: track them with: lassokin track {folder}"
    return f"; it has {found[0]} files, and each is {OTHER_FILES[found[0]][0]}"


def open_files(path: Path, stack: ExitStack) -> tuple[list[DataFile], Metadata | None]:
    """Open the recording `path`, a folder or a single file; `stack` closes it.

    Returns its files in the order of their times, and metadata where it can be compared with them. Raises BagError.
    """
    if path.is_file():
        return [_open(path, stack)], None
    metadata = read_metadata(path)
    if metadata is None:
        return [_open(path, stack)], None
    names = metadata.files or sorted(file.name for file in path.iterdir() if file.suffix in SUFFIXES)
    _check_parts(path, names)
    if metadata.compressed or not names or any(Path(name).suffix not in SUFFIXES for name in names):
        return [_open(path, stack)], None
    files = [_open(path / name, stack) for name in names]
    return sorted(files, key=lambda file: int(file.reader.start_time)), metadata


def _check_parts(folder: Path, names: Sequence[str]) -> None:
    """Raise BagError if a listed file is missing, a part number is left out, or a part is not listed."""
    for name in names:
        if not (folder / name).is_file():
            raise BagError(f"{folder} is incomplete: its file '{name}' is missing, which {METADATA} lists")
    listed = _numbers(names)
    there = _numbers(file.name for file in folder.iterdir())
    for (stem, suffix), numbers in listed.items():
        missing = sorted(set(range(min(numbers), max(numbers))) - numbers)
        if missing:
            lost = f"{stem}_{missing[0]}{suffix}"
            raise BagError(f"{folder} is incomplete: its part '{lost}' is missing; to track the others, replay each")
        if more := sorted(there[stem, suffix] - numbers):
            lost = f"{stem}_{more[0]}{suffix}"
            raise BagError(
                f"{folder} has the part '{lost}', which {METADATA} does not list; move it away, or run: "
                f"ros2 bag reindex {folder}"
            )


def _numbers(names: Iterable[str]) -> dict[tuple[str, str], set[int]]:
    """Return the numbers of the parts, by (prefix, suffix)."""
    found: dict[tuple[str, str], set[int]] = {}
    for part in filter(None, map(PART.fullmatch, names)):
        found.setdefault((part["stem"], part["suffix"]), set()).add(int(part["number"]))
    return found


def _open(path: Path, stack: ExitStack) -> DataFile:
    from rosbags.rosbag2 import Reader

    if _has_no_end(path):
        raise BagError(
            f"{path} cannot be read as a rosbag2 recording: it has no end, because its recorder was killed or the file "
            f"was cut; write what it holds to another file with: mcap recover {path} -o recovered.mcap"
        )
    source = _merged(path, stack) if path.suffix == ".db3" and path.is_file() else path
    with clear_errors(path), any_schema():
        reader = Reader(source)
        reader.open()
    stack.callback(reader.close)
    return DataFile(path, reader)


def _has_no_end(path: Path) -> bool:
    """Return True for an mcap file that does not end as one."""
    if path.suffix != ".mcap" or not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            begins = file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
            file.seek(max(0, path.stat().st_size - len(MCAP_MAGIC)))
            return begins and file.read() != MCAP_MAGIC
    except OSError:
        return False  # the reader's error is better


@contextmanager
def clear_errors(path: Path) -> Iterator[None]:
    """Convert every exception of the reading library to BagError. Broken files raise exceptions of many types."""
    try:
        yield
    except LassokinError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BagError(f"{path} cannot be read as a rosbag2 recording: {reason}") from None


# A database whose writer was killed: a part of the data is in a journal file beside it. rosbags reads the database
# alone, without a write-ahead log (-wal) and without rolling back a half-written transaction (-journal). SQLite merges
# both when it opens the database for writing, so this is done with a copy.

JOURNALS = ("-wal", "-journal")
"""Suffixes that SQLite adds to the name of the database."""
LITTLE_ENDIAN_LOG = 0x377F0682
"""First word of a log whose checksums are over little-endian words."""
WAL_HEADER, FRAME_HEADER = struct.Struct(">8I"), struct.Struct(">6I")


def journals_of(path: Path) -> list[Path]:
    """Return the journals beside the database `path` that are not empty."""
    beside = [path.with_name(path.name + suffix) for suffix in JOURNALS]
    return [file for file in beside if file.is_file() and file.stat().st_size > 0]


def _merged(path: Path, stack: ExitStack) -> Path:
    """Return a database with the content of the journals of `path`: a copy, or `path` itself if it has none.

    stack: removes the copy. Raises BagError if a journal cannot be read completely, or if there is no room for a copy.
    """
    journals = journals_of(path)
    if not journals:
        return path
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="lassokin_", ignore_cleanup_errors=True)))
    try:
        for file in (path, *journals):
            shutil.copyfile(file, folder / file.name)
        _merge(folder / path.name)
    except (OSError, sqlite3.Error, struct.error) as error:
        reason = getattr(error, "strerror", None) or error
        raise BagError(
            f"{path} cannot be read as a rosbag2 recording: its recorder was killed, and '{journals[0].name}' cannot "
            f"be merged into a copy of it in {folder.parent}: {reason}"
        ) from None
    return folder / path.name


def _merge(copy: Path) -> None:
    """Merge the journals of a database. Raises sqlite3.Error, struct.error if they are damaged, and OSError."""
    with closing(sqlite3.connect(copy, isolation_level=None)) as database:
        database.execute("SELECT count(*) FROM sqlite_master").fetchone()
        busy, frames, done = database.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
        wal = copy.with_name(copy.name + "-wal")
        if busy or frames != done or (wal.is_file() and _is_damaged(wal, max(frames, 0))):
            raise sqlite3.DatabaseError("the log is damaged")
        database.execute("PRAGMA journal_mode=DELETE").fetchone()


def _checksum(header: bytes) -> bytes:
    """Return the checksum of the header of a log, see the section on checksums of sqlite.org/fileformat2.html."""
    order = "<" if struct.unpack_from(">I", header)[0] == LITTLE_ENDIAN_LOG else ">"
    words = struct.unpack_from(f"{order}6I", header)
    first = second = 0
    for one, two in zip(words[::2], words[1::2]):
        first = (first + one + second) % 2**32
        second = (second + two + first) % 2**32
    return struct.pack(">2I", first, second)


def _is_damaged(wal: Path, frames: int) -> bool:
    """Return True if a write-ahead log is damaged: it has a committed transaction after the frames that SQLite reads.

    Frames with other salts than the header's are left over from before the log was last started anew.
    """
    with wal.open("rb") as file:
        if not (header := file.read(WAL_HEADER.size)):
            return False
        kind, _, page_size, _, *salts, _, _ = WAL_HEADER.unpack(header)
        if kind & ~1 != LITTLE_ENDIAN_LOG or _checksum(header) != header[24:]:  # zeros have a valid checksum
            return True
        frame = FRAME_HEADER.size + page_size
        place = WAL_HEADER.size + frames * frame
        file.seek(place)
        while len(header := file.read(FRAME_HEADER.size)) == FRAME_HEADER.size:
            _, committed, *found, _, _ = FRAME_HEADER.unpack(header)
            if committed and found == salts:
                return True
            place += frame
            file.seek(place)
    return False
