"""Check the files of a recording before it is opened, and complete what a killed recorder or a re-index left undone."""

from __future__ import annotations

import re
import shutil
import sqlite3
from pathlib import Path, PurePath
from typing import Any

import yaml

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import load_mapping, read_text

METADATA = "metadata.yaml"
INFORMATION = "rosbag2_bagfile_information"
STORAGE_OF_SUFFIX = {".mcap": "mcap", ".db3": "sqlite3"}
MCAP_MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of a complete mcap file."""
UNFINISHED = ("-wal", "-journal")
"""Suffixes that SQLite adds to the name of a database for changes that are not yet, or not wholly, in the database."""
PART = re.compile(r"(.+)_(\d+)\.(?:db3|mcap)(?:\.zstd)?")
"""Name of one file of a split recording."""


class BagError(LassokinError):
    """A recording cannot be read, lacks a required topic, or cannot be written."""


def complete(path: Path, work: Path) -> tuple[Path, list[str]]:
    """Return the path to open in place of the recording `path`, and notes for the user.

    The path is that of the recording, unless a database was not closed or the metadata names no storage. It is then a
    folder or file in the empty folder `work`, with links to the data files. Nothing is changed at `path`. Raises
    BagError for an mcap file without an end, and for a database that cannot be completed.
    """
    if path.is_file():
        files, metadata = [path], {}
    else:
        _check_has_metadata(path)
        metadata = _metadata(path)
        names = [PurePath(str(name)).name for name in metadata.get("relative_file_paths") or ()]
        files = [path / name for name in names if (path / name).is_file()]
    for file in files:
        _check_mcap_end(path, file)
    notes = _single_file_notes(path) if path.is_file() else _folder_notes(path, [file.name for file in files])
    unclosed = [file for file in files if file.suffix == ".db3" and _unfinished(file)]
    nameless = bool(files) and "storage_identifier" in metadata and not metadata["storage_identifier"]
    if not unclosed and not nameless:
        return path, notes
    for file in files:
        if file in unclosed:
            _complete_database(file, work / file.name)
            notes.append(f"{file.name} was not closed by its recorder; what {_unfinished(file)[0].name} holds is read")
        else:
            (work / file.name).symlink_to(file.resolve())
    if path.is_file():
        return work / path.name, notes
    if nameless:
        _name_storage(metadata, files[0])
        notes.append("metadata.yaml does not name the storage; it was taken from the files")
    (work / METADATA).write_text(yaml.safe_dump({INFORMATION: metadata}), encoding="utf-8")
    return work, notes


def _check_has_metadata(path: Path) -> None:
    if (path / METADATA).is_file():
        return
    refusal = f"'{path}' is not a rosbag2 recording: it has no metadata.yaml"
    if names := _data_files(path):
        refusal += f"; expected it beside {', '.join(names)}: make it with `ros2 bag reindex`, or give a single file"
    raise BagError(refusal)


def _data_files(path: Path) -> list[str]:
    return sorted(entry.name for entry in path.iterdir() if re.fullmatch(r".+\.(db3|mcap)(\.zstd)?", entry.name))


def _metadata(path: Path) -> dict[str, Any]:
    """Return the recording's metadata; empty if it cannot be used, which is reported when the recording is opened."""
    try:
        found = load_mapping(read_text(path / METADATA, BagError), str(path), BagError).get(INFORMATION)
    except BagError:
        return {}
    usable = isinstance(found, dict) and isinstance(found.get("relative_file_paths"), list)
    return found if usable else {}  # type: ignore[return-value]


def _name_storage(metadata: dict[str, Any], file: Path) -> None:
    """Fill in the storage and the formats that the metadata leaves empty."""
    metadata["storage_identifier"] = STORAGE_OF_SUFFIX.get(file.suffixes[0] if file.suffixes else "", "")
    for topic in metadata.get("topics_with_message_count") or ():
        described = topic.get("topic_metadata") if isinstance(topic, dict) else None
        if isinstance(described, dict) and not described.get("serialization_format"):
            described["serialization_format"] = "cdr"


def _check_mcap_end(path: Path, file: Path) -> None:
    if file.suffix != ".mcap":
        return
    try:
        with file.open("rb") as stream:
            start = stream.read(len(MCAP_MAGIC))
            stream.seek(-min(len(MCAP_MAGIC), file.stat().st_size), 2)
            end = stream.read()
    except OSError:
        return  # reported when the recording is opened
    if start == MCAP_MAGIC and (end != MCAP_MAGIC or file.stat().st_size == len(MCAP_MAGIC)):
        raise BagError(
            f"{path} cannot be read as a rosbag2 recording: {file.name} has no end, because its recorder was killed or "
            f"the file was cut; save what is there with: mcap recover {file.name} -o recovered.mcap"
        )


def _unfinished(file: Path) -> list[Path]:
    """Return the files beside a database that hold changes to it."""
    beside = [file.with_name(file.name + suffix) for suffix in UNFINISHED]
    return [other for other in beside if other.is_file() and other.stat().st_size]


def _complete_database(file: Path, copy: Path) -> None:
    """Copy a database and let SQLite finish the changes that its recorder left beside it."""
    beside = _unfinished(file)
    try:
        shutil.copyfile(file, copy)
        for other in beside:
            shutil.copyfile(other, copy.with_name(other.name))
        connection = sqlite3.connect(copy)
        try:
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
            connection.execute("PRAGMA journal_mode=DELETE").fetchone()
        finally:
            connection.close()
    except (OSError, sqlite3.Error) as error:
        raise BagError(
            f"{file} was not closed by its recorder, and {beside[0].name} cannot be added to it: {error}"
        ) from None


def _single_file_notes(path: Path) -> list[str]:
    part = PART.fullmatch(path.name)
    if part is None:
        return []
    others = [name for name in _data_files(path.parent) if name != path.name and _stem(name) == part[1]]
    return [f"{path.name} is one part of a split recording; not read: {', '.join(others)}"] if others else []


def _folder_notes(path: Path, files: list[str]) -> list[str]:
    notes = []
    unlisted = [name for name in _data_files(path) if name not in files]
    if files and unlisted:
        notes.append(f"metadata.yaml does not list {', '.join(unlisted)}; not read")
    numbers = sorted(int(part[2]) for part in map(PART.fullmatch, files) if part)
    absent = sorted(set(range(numbers[-1])) - set(numbers)) if numbers and numbers[-1] < 100_000 else []
    if absent and len({_stem(name) for name in files}) == 1:
        notes.append(f"parts of the split recording are missing: number {', '.join(map(str, absent[:10]))}")
    return notes


def _stem(name: str) -> str:
    part = PART.fullmatch(name)
    return part[1] if part else ""
