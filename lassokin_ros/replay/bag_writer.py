"""Write rosbag2 recordings without ROS, each of which appears under its name only when it is complete."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.replay.recording_files import METADATA, BagError, read_metadata

FILE_NAME = "recording"
"""Stem of the data file in a recording's folder. It is fixed, so that the bytes do not depend on the folder's name."""
WRITTEN_TOGETHER = 250
"""Messages that are passed to the storage at once. One at a time takes four times as long, because while a frame is
tracked, the code of the storage is displaced from the caches of the processor."""
PART_SUFFIX = ".part"
"""Suffix of the hidden folder beside a recording, in which the recording is written until it is complete."""


class BagWriter:
    """Write a recording that appears under its name only when it is complete. Use it in a `with` statement."""

    def __init__(
        self,
        path: Path,
        storage: str,
        types: Any,
        replace: bool = False,
        may_replace: Callable[[str], bool] = lambda name: False,
    ) -> None:
        """Check that the recording can be written at `path`.

        storage: one of STORAGES. types: from `typestore()`. replace: replace an existing recording at `path`.
        may_replace: returns True for the name of a file in the old recording's folder that may be removed with it,
        in addition to the files of the recording itself. Raises BagError if something at `path` must not be replaced,
        or if the parent folder does not exist.
        """
        self.path, self._types, self._replace, self._may_replace = path, types, replace, may_replace
        if path.exists() and not replace:
            raise BagError(f"'{path}' exists already; choose another output or add --force")
        if path.exists() and not (path.is_dir() and (path / METADATA).is_file()):
            raise BagError(f"'{path}' exists and is not a rosbag2 recording; it is not replaced")
        if path.exists():
            refuse_foreign_files(path, may_replace)
        if not path.parent.is_dir():
            raise BagError(f"there is no folder '{path.parent}' for the output '{path.name}'")
        self._storage = storage
        self._connections: dict[str, Any] = {}
        self._waiting: list[tuple[str, str, int, bytes, bool]] = []  # arguments of `write_raw`

    def __enter__(self) -> BagWriter:
        from rosbags.rosbag2 import StoragePlugin, Writer

        try:
            prefix = f".{self.path.name}."
            self._temporary = Path(tempfile.mkdtemp(prefix=prefix, suffix=PART_SUFFIX, dir=self.path.parent))
        except OSError as error:
            raise BagError(f"'{self.path}' cannot be written: {error.strerror}") from None
        try:
            plugin = StoragePlugin.MCAP if self._storage == "mcap" else StoragePlugin.SQLITE3
            self._writer = Writer(self.folder, version=9, storage_plugin=plugin)
            self._writer.open()
        except BaseException as error:  # OSError, an exception of the storage library, or Interrupted
            shutil.rmtree(self._temporary, ignore_errors=True)
            if isinstance(error, Exception):
                raise BagError(f"'{self.path}' cannot be written: {error}") from None
            raise
        return self

    def write(self, topic: str, message_type: str, time_ns: int, message: Any, latched: bool = False) -> None:
        """Append a message, or one that is serialised already.

        time_ns: recording time. latched: a playback delivers it to late subscribers too.
        """
        data = message if isinstance(message, bytes) else self._types.serialize_cdr(message, message_type)
        self.write_raw(topic, message_type, time_ns, data, latched)

    def write_raw(self, topic: str, message_type: str, time_ns: int, data: bytes, latched: bool = False) -> None:
        """Append a serialised message."""
        self._waiting.append((topic, message_type, time_ns, data, latched))
        if len(self._waiting) >= WRITTEN_TOGETHER:
            self._write_waiting()

    def _write_waiting(self) -> None:
        waiting, self._waiting = self._waiting, []
        try:
            for topic, message_type, time_ns, data, latched in waiting:
                if topic not in self._connections:
                    qos, add = [_latched_qos()] if latched else [], self._writer.add_connection
                    made = add(topic, message_type, typestore=self._types, offered_qos_profiles=qos)
                    self._connections[topic] = made
                self._writer.write(self._connections[topic], time_ns, data)
        except Exception as error:  # OSError, or an exception of the storage library; most likely the disk is full
            raise BagError(f"'{self.path}' cannot be written: {error}") from None

    @property
    def folder(self) -> Path:
        """The temporary folder of the recording. Other files written to it become part of the output."""
        return self._temporary / FILE_NAME

    def note(self, key: str, text: str) -> None:
        """Store a text in the recording's metadata, as rosbag2 custom data."""
        self._writer.set_custom_data(key, text)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            shutil.rmtree(self._temporary, ignore_errors=True)

    def _finish(self) -> None:
        self._write_waiting()
        try:
            self._writer.close()
            if self.path.exists():
                if not self._replace:
                    raise BagError(f"'{self.path}' was created during the replay; it is not replaced")
                refuse_foreign_files(self.path, self._may_replace)
                self.path.rename(self._temporary / "replaced")
            self.folder.rename(self.path)
        except LassokinError:
            raise
        except Exception as error:
            raise BagError(f"'{self.path}' cannot be written: {error}") from None


def refuse_foreign_files(path: Path, may_replace: Callable[[str], bool]) -> None:
    """Raise BagError if the folder holds anything but the recording's files and files that `may_replace` accepts."""
    try:
        entries = sorted(path.iterdir())
    except OSError as error:
        raise BagError(f"'{path}' cannot be replaced: {error.strerror}") from None
    metadata = read_metadata(path)
    own = {METADATA, *(() if metadata is None else metadata.files)}
    for entry in entries:
        if entry.is_dir() or not (entry.name in own or may_replace(entry.name)):
            raise BagError(
                f"'{path}' is not replaced: it contains '{entry.name}', which is not part of the recording; move that "
                "away or choose another output"
            )


def remove_leftovers(path: Path) -> None:
    """Remove the temporary folders that killed writers of `path` left behind. No writer of `path` may be active."""
    pattern = re.compile(rf"\.{re.escape(path.name)}\.[a-z0-9_]+{re.escape(PART_SUFFIX)}")
    for entry in path.parent.iterdir() if path.parent.is_dir() else ():
        if pattern.fullmatch(entry.name):
            shutil.rmtree(entry, ignore_errors=True)


def _latched_qos() -> Any:
    """Return the QoS of a latched topic: reliable, transient local, depth 1."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    forever = QosTime(9223372036, 854775807)  # the value that ROS 2 writes for an infinite duration
    kinds = QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL
    return Qos(*kinds, forever, forever, QosLiveliness.AUTOMATIC, forever, False)
