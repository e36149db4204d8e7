"""Read and write rosbag2 recordings without ROS: clear errors, topic selection, atomic output."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import load_mapping, read_text
from lassokin_ros.replay.recording_files import (
    CDR,
    METADATA,
    DataFile,
    advice_on_folder,
    clear_errors,
    encoding_of,
    open_files,
    refuse_other_files,
)
from lassokin_ros.replay.recording_files import BagError as BagError
from msg_adapters.detectors.definitions import DEFINITIONS, OLDER

STORAGES = ("sqlite3", "mcap")
FILE_NAME = "recording"
"""Stem of the data file in a recording's folder. It is fixed, so that the bytes do not depend on the folder's name."""
WRITTEN_TOGETHER = 250
"""Messages that are passed to the storage at once. One at a time takes four times as long, because while a frame is
tracked, the code of the storage is displaced from the caches of the processor."""
READ_TOGETHER, READ_BYTES = 64, 100_000
"""Largest number of messages that are read and deserialised at once, for the same reason, and bytes after which a group
ends earlier."""

PART_SUFFIX = ".part"
"""Suffix of the hidden folder beside a recording, in which the recording is written until it is complete."""


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a recording: name, message type, number of messages, and their encoding."""

    name: str
    message_type: str
    count: int
    encoding: str = CDR

    def __str__(self) -> str:
        encoding = "" if self.encoding == CDR else f" in {self.encoding}"
        return f"{self.name} ({self.message_type}, {self.count} messages{encoding})"


def typestore() -> Any:
    """Return the message types of ROS 2 Jazzy, from rosbags. Raises BagError if rosbags is not installed."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise BagError("recordings are read and written with rosbags; install it with: pip install rosbags") from None
    return get_typestore(Stores.ROS2_JAZZY)


class BagReader:
    """An open recording: a rosbag2 folder, or a single .mcap or .db3 file. Use it in a `with` statement."""

    def __init__(self, path: Path) -> None:
        """Open the recording at `path`. Raises BagError if there is none, or if it cannot be read."""
        self.path = path
        self.types = typestore()
        self._older: Any = None  # types of older releases of detectors' packages
        self._undefined: set[str] = set()  # message types that the recording does not define
        refuse_other_files(path)
        if not path.exists():
            raise BagError(f"there is no recording '{path}'; expected a rosbag2 folder, or a .mcap or .db3 file")
        if path.is_dir() and not (path / METADATA).is_file():
            raise BagError(f"'{path}' is not a rosbag2 recording: it has no {METADATA}{advice_on_folder(path)}")
        with ExitStack() as stack:
            self._files, self._metadata = open_files(path, stack)
            self._stack = stack.pop_all()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def storage(self) -> str:
        """The storage plugin of the recording, "sqlite3" or "mcap"."""
        files = [self.path] if self.path.is_file() else list(self.path.iterdir())
        return "mcap" if any(".mcap" in file.suffixes for file in files) else "sqlite3"

    @property
    def topics(self) -> list[RecordedTopic]:
        """The topics of the recording, sorted by name."""
        counts: dict[tuple[str, str, str], int] = {}
        for connection in self._connections():
            key = connection.topic, connection.msgtype, encoding_of(connection)
            counts[key] = counts.get(key, 0) + connection.msgcount
        return [RecordedTopic(name, kind, count, form) for (name, kind, form), count in sorted(counts.items())]

    def find(
        self, message_type: str, name: str | None, usual_name: str, option: str, instead: str = ""
    ) -> RecordedTopic:
        """Return the topic called `name`, or the best candidate of `message_type` if `name` is None.

        With several candidates, the one whose last name part is `usual_name` wins. For the error text: option is the
        command line option that selects the topic, instead is what to do if there is no such topic. Raises BagError,
        which lists the topics of the recording.
        """
        if name is not None:
            topic = next((t for t in self.topics if t.name.strip("/") == name.strip("/")), None)
            if topic is None:
                raise BagError(f"{self.path} has no topic '{name}'; {self._listing()}")
            if topic.message_type != message_type:
                raise BagError(f"topic '{name}' of {self.path} holds {topic.message_type}; expected {message_type}")
            self._check_encoding(topic)
            return topic
        candidates = [t for t in self.topics if t.message_type == message_type]
        candidates = [t for t in candidates if t.encoding == CDR] or candidates
        if len(candidates) > 1:
            candidates = [t for t in candidates if t.name.split("/")[-1] == usual_name] or candidates
        if not candidates:
            advice = f"{instead}; " if instead else ""
            raise BagError(
                f"{self.path} has no topic of type {message_type} for {usual_name}; {advice}{self._listing()}"
            )
        if len(candidates) > 1:
            listed = ", ".join(t.name for t in candidates)
            raise BagError(f"{self.path} has several topics for {usual_name}: {listed}; choose one with {option}")
        self._check_encoding(candidates[0])
        return candidates[0]

    def _check_encoding(self, topic: RecordedTopic) -> None:
        if topic.encoding != CDR:
            raise BagError(
                f"topic '{topic.name}' of {self.path} has messages in {topic.encoding}; expected {CDR}, the encoding "
                "of ROS 2: record it from ROS 2, or convert it"
            )

    def _listing(self) -> str:
        return f"its topics are: {', '.join(map(str, self.topics)) or 'none'}"

    def messages(self, topics: Sequence[RecordedTopic]) -> Iterator[tuple[str, int, Any]]:
        """Yield (topic, recording time in ns, message) in recording order; None replaces a message that is malformed.

        Raises BagError where the recording breaks off, and at the end if messages are missing.
        """
        for connection in self._connections():
            if any((topic.name, topic.encoding) == (connection.topic, encoding_of(connection)) for topic in topics):
                self._register(connection)
        for group in _grouped(self._items(topics)):
            read = [(item.topic, time_ns, self._message(data, item.msgtype)) for item, time_ns, data in group]
            yield from read

    def _message(self, data: bytes, message_type: str) -> Any:
        """Return a message, None if it fits no definition."""
        older = [self._older] if message_type in self._undefined and self._older is not None else []
        for types in (self.types, *older):
            try:
                return types.deserialize_cdr(data, message_type)
            except Exception:  # wrong bytes can cause any exception in rosbags
                continue
        return None

    def raw(self, topics: Sequence[RecordedTopic]) -> Iterator[tuple[str, int, bytes]]:
        """Yield the same as `messages`, with the serialised messages."""
        for connection, time_ns, data in self._items(topics):
            yield connection.topic, time_ns, bytes(data)

    def _connections(self) -> Iterator[Any]:
        return (connection for file in self._files for connection in file.reader.connections)

    def _items(self, topics: Sequence[RecordedTopic]) -> Iterator[Any]:
        names = {(topic.name, topic.encoding) for topic in topics}
        if self._metadata is not None:
            self._metadata.check_topics(self.path, self._files, sorted({topic.name for topic in topics}))
        for file in self._files:
            chosen = [item for item in file.reader.connections if (item.topic, encoding_of(item)) in names]
            yield from _items_of(file, chosen)

    def _register(self, connection: Any) -> None:
        """Register a message type that Jazzy lacks: by the definition in the recording, or in msg_adapters."""
        if connection.msgtype in self.types.types:
            return
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

        text, is_idl, reason = connection.msgdef.data, connection.msgdef.format.name == "IDL", "there is none"
        if text:
            try:
                types = get_types_from_idl(text) if is_idl else get_types_from_msg(text, connection.msgtype)
                self.types.register(types)
            except Exception as error:  # rosbags raises errors of many types
                reason = " ".join(str(error).split())[:200]
        if connection.msgtype not in self.types.types:
            self._use_own_definitions(connection.msgtype)
        if connection.msgtype not in self.types.types:
            packages = ", ".join(sorted({name.partition("/")[0] for name in DEFINITIONS}))
            as_mcap = "" if self.storage == "mcap" else "as mcap "
            raise BagError(
                f"{self.path} has no usable definition of {connection.msgtype} ({reason}); expected one in the "
                f"recording, or a message of {packages}; record {as_mcap}where the message's package is installed"
            )

    def _use_own_definitions(self, message_type: str) -> None:
        """Register the definitions of msg_adapters; for types with older definitions, prepare those too."""
        register_detector_types(self.types)
        package = message_type.partition("/")[0]
        if any(name.startswith(f"{package}/") for name in OLDER):
            self._undefined.add(message_type)
            if self._older is None:
                self._older = typestore()
                register_detector_types(self._older, {**DEFINITIONS, **OLDER})


def _grouped(items: Iterator[Any]) -> Iterator[list[Any]]:
    """Yield items in groups, see READ_TOGETHER. The items before one that raises BagError are yielded first."""
    group: list[Any] = []
    size = 0
    try:
        for item in items:
            group.append(item)
            size += len(item[2])
            if len(group) >= READ_TOGETHER or size >= READ_BYTES:
                yield group
                group, size = [], 0
    except BagError:
        yield group
        raise
    yield group


def _items_of(file: DataFile, connections: list[Any]) -> Iterator[Any]:
    """Yield the items of some connections of a file. Raises BagError where it breaks off, or if items are missing."""
    if not connections:  # rosbags would read them all
        return
    source, read = iter(file.reader.messages(connections)), 0
    while True:
        with clear_errors(file.path):
            item = next(source, None)
        if item is None:
            break
        read += 1
        yield item
    expected = sum(connection.msgcount for connection in connections)
    if read < expected:
        raise BagError(f"{file.path} is damaged: only {read} of its {expected} messages can be read")


def register_detector_types(types: Any, definitions: Mapping[str, str] = DEFINITIONS) -> None:
    """Register the messages of detectors that Jazzy lacks. types: the typestore of rosbags, changed in place."""
    from rosbags.typesys import get_types_from_msg

    for name, text in definitions.items():
        if name not in types.types:
            types.register(get_types_from_msg(text, name))


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
        if path.exists() and not (path.is_dir() and (path / "metadata.yaml").is_file()):
            raise BagError(f"'{path}' exists and is not a rosbag2 recording; it is not replaced")
        if path.exists():
            refuse_foreign_files(path, may_replace)
        if not path.parent.is_dir():
            raise BagError(f"there is no folder '{path.parent}' for the output '{path.name}'")
        self._storage = storage
        self._connections: dict[str, Any] = {}
        self._waiting: list[tuple[str, str, int, bytes, bool]] = []  # arguments of `write_raw`

    def __enter__(self) -> BagWriter:
        try:
            prefix = f".{self.path.name}."
            self._temporary = Path(tempfile.mkdtemp(prefix=prefix, suffix=PART_SUFFIX, dir=self.path.parent))
        except OSError as error:
            raise BagError(f"'{self.path}' cannot be written: {error.strerror}") from None
        try:
            self._open()
        except BaseException:  # includes Interrupted
            shutil.rmtree(self._temporary, ignore_errors=True)
            raise
        return self

    def _open(self) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        plugin = StoragePlugin.MCAP if self._storage == "mcap" else StoragePlugin.SQLITE3
        self._writer = Writer(self._temporary / FILE_NAME, version=9, storage_plugin=plugin)
        try:
            self._writer.open()
        except Exception as error:  # OSError, or an exception of the storage library
            raise BagError(f"'{self.path}' cannot be written: {error}") from None

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
                    self._connections[topic] = self._connect(topic, message_type, latched)
                self._writer.write(self._connections[topic], time_ns, data)
        except Exception as error:  # OSError, or an exception of the storage library; most likely the disk is full
            raise BagError(f"'{self.path}' cannot be written: {error}") from None

    def _connect(self, topic: str, message_type: str, latched: bool) -> Any:
        qos = [_latched_qos()] if latched else []
        return self._writer.add_connection(topic, message_type, typestore=self._types, offered_qos_profiles=qos)

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
            (self._temporary / FILE_NAME).rename(self.path)
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
    own = {"metadata.yaml", *_data_files(path)}
    for entry in entries:
        if entry.is_dir() or not (entry.name in own or may_replace(entry.name)):
            raise BagError(
                f"'{path}' is not replaced: it contains '{entry.name}', which is not part of the recording; move that "
                "away or choose another output"
            )


def _data_files(path: Path) -> list[str]:
    """Return the data files named in a recording's metadata; empty if the metadata cannot be read."""
    try:
        data = load_mapping(read_text(path / "metadata.yaml", BagError), str(path), BagError)
        return [str(name) for name in data["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (BagError, KeyError, TypeError):
        return []


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
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        forever,
        forever,
        QosLiveliness.AUTOMATIC,
        forever,
        False,
    )
