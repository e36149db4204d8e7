"""Databases whose writer was killed: a part of the data is in a journal file beside the database.

rosbags reads the database alone, without a write-ahead log (-wal) and without rolling back a half-written transaction
(-journal). SQLite merges both when it opens the database for writing, so this is done with a copy.
"""

from __future__ import annotations

import shutil
import sqlite3
import struct
import tempfile
from contextlib import ExitStack, closing
from pathlib import Path

from lassokin_ros.replay.recording_files import BagError

JOURNALS = ("-wal", "-journal")
"""Suffixes that SQLite adds to the name of the database."""
LITTLE_ENDIAN_LOG = 0x377F0682
"""First word of a log whose checksums are over little-endian words."""
WAL_HEADER, FRAME_HEADER = struct.Struct(">8I"), struct.Struct(">6I")


def journals_of(path: Path) -> list[Path]:
    """Return the journals beside the database `path` that are not empty."""
    beside = [path.with_name(path.name + suffix) for suffix in JOURNALS]
    return [file for file in beside if file.is_file() and file.stat().st_size > 0]


def merged(path: Path, stack: ExitStack) -> Path:
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
