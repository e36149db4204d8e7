"""Read and write rosbag2 recordings without ROS: clear errors, topic selection, atomic output."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import load_mapping, read_text
from lassokin_ros.replay.bag_files import BagError, complete
from msg_adapters.detectors.definitions import versions

STORAGES = ("sqlite3", "mcap")
FILE_NAME = "recording"
"""Stem of the data file in a recording's folder. It is fixed, so that the bytes do not depend on the folder's name."""


PART_SUFFIX = ".part"
"""Suffix of the hidden folder beside a recording, in which the recording is written until it is complete."""


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a recording: name, message type and number of messages."""

    name: str
    message_type: str
    count: int

    def __str__(self) -> str:
        return f"{self.name} ({self.message_type}, {self.count} messages)"


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
        self._versions: dict[str, list[Any]] = {}
        from rosbags.rosbag2 import Reader

        if not path.exists():
            raise BagError(f"there is no recording '{path}'; expected a rosbag2 folder, or a .mcap or .db3 file")
        with ExitStack() as stack:
            work = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="lassokin_bag_")))
            with self._clear_errors(work):
                opened, self._notes = complete(path, work)
                self._reader = Reader(opened)
                self._reader.open()
            stack.callback(self._reader.close)
            self._closing = stack.pop_all()
        self._files = _file_readers(self._reader)
        self._listed, self._found = _counts(self._reader.connections), _counts(self._connections)

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.close()

    @property
    def _connections(self) -> list[Any]:
        return [connection for file in self._files for connection in file.connections]

    @property
    def storage(self) -> str:
        """The storage plugin of the recording, "sqlite3" or "mcap"."""
        files = [self.path] if self.path.is_file() else list(self.path.iterdir())
        return "mcap" if any(".mcap" in file.suffixes for file in files) else "sqlite3"

    @property
    def topics(self) -> list[RecordedTopic]:
        """The topics of the recording, sorted by name."""
        keys = sorted(self._listed.keys() | self._found.keys())
        return [RecordedTopic(*key, max(self._listed.get(key, 0), self._found.get(key, 0))) for key in keys]

    def notes(self, topics: Sequence[RecordedTopic]) -> list[str]:
        """Return what a user must know about the recording as a whole, and about these topics of it."""
        notes = list(self._notes)
        for topic in topics:
            listed = self._listed.get((topic.name, topic.message_type), 0)
            if listed < topic.count:
                notes.append(
                    f"metadata.yaml counts {listed} messages of {topic.name}, the files {topic.count}; all are read"
                )
        return notes

    def find(
        self, message_type: str, name: str | None, usual_name: str, option: str, instead: str = ""
    ) -> RecordedTopic:
        """Return the topic called `name`, or the best candidate of `message_type` if `name` is None.

        With several candidates, the one whose last name part is `usual_name` wins. option: the command line option
        that selects the topic; instead: what can replace a missing topic. Both are for the error text. Raises BagError,
        which lists the topics of the recording.
        """
        if name is not None:
            topic = next((t for t in self.topics if t.name.strip("/") == name.strip("/")), None)
            if topic is None:
                raise BagError(f"{self.path} has no topic '{name}'; {self._listing()}")
            if topic.message_type != message_type:
                raise BagError(f"topic '{name}' of {self.path} holds {topic.message_type}; expected {message_type}")
            return topic
        candidates = [t for t in self.topics if t.message_type == message_type]
        if len(candidates) > 1:
            candidates = [t for t in candidates if t.name.split("/")[-1] == usual_name] or candidates
        if not candidates:
            advice = f"; {instead}" if instead else ""
            raise BagError(
                f"{self.path} has no topic of type {message_type} for {usual_name}; {self._listing()}{advice}"
            )
        if len(candidates) > 1:
            listed = ", ".join(t.name for t in candidates)
            raise BagError(f"{self.path} has several topics for {usual_name}: {listed}; choose one with {option}")
        return candidates[0]

    def _listing(self) -> str:
        return f"its topics are: {', '.join(map(str, self.topics)) or 'none'}"

    def messages(self, topics: Sequence[RecordedTopic]) -> Iterator[tuple[str, int, Any]]:
        """Yield (topic, recording time in ns, message) in recording order; None replaces a message that is malformed.

        Raises BagError where the recording breaks off, and at the end if messages are missing.
        """
        for message_type in {topic.message_type for topic in topics}:
            self._register(message_type)
        for connection, time_ns, data in self._items(topics):
            yield connection.topic, time_ns, self._deserialise(data, connection.msgtype)

    def _deserialise(self, data: bytes, message_type: str) -> Any:
        for types in self._versions.get(message_type, [self.types]):
            try:
                return types.deserialize_cdr(data, message_type)
            except Exception:  # rosbags raises whatever the wrong bytes lead to
                continue
        return None

    def raw(self, topics: Sequence[RecordedTopic]) -> Iterator[tuple[str, int, bytes]]:
        """Yield the same as `messages`, with the serialised messages."""
        for connection, time_ns, data in self._items(topics):
            yield connection.topic, time_ns, bytes(data)

    def _stored(self, topics: Sequence[RecordedTopic]) -> Iterator[Any]:
        names = {topic.name for topic in topics}
        for file in self._files:
            if chosen := [connection for connection in file.connections if connection.topic in names]:
                yield from file.messages(chosen)

    def _items(self, topics: Sequence[RecordedTopic]) -> Iterator[Any]:
        source, read = self._stored(topics), 0
        while True:
            with self._clear_errors():
                item = next(source, None)
            if item is None:
                break
            read += 1
            yield item
        expected = sum(topic.count for topic in topics)
        if read < expected:
            raise BagError(
                f"{self.path} is damaged: only {read} of its {expected} messages can be read; if only metadata.yaml is "
                "wrong, make that anew with `ros2 bag reindex`"
            )

    def _register(self, message_type: str) -> None:
        """Register a message type that Jazzy lacks, from the definition in the recording or in this package."""
        if message_type in self.types.types:
            return
        from rosbags.typesys import get_types_from_msg

        texts = [c.msgdef.data for c in (*self._connections, *self._reader.connections) if c.msgtype == message_type]
        if text := next(filter(None, texts), ""):
            with self._clear_errors():
                self.types.register(get_types_from_msg(text, message_type))
            return
        for definitions in versions(message_type):
            types = typestore()
            for name, definition in definitions.items():
                types.register(get_types_from_msg(definition, name))
            self._versions.setdefault(message_type, []).append(types)
        if message_type not in self._versions:
            advice = "record it where its package is installed" if self.storage == "mcap" else "record it as mcap"
            raise BagError(f"{self.path} does not contain the definition of {message_type}; {advice}")

    @contextmanager
    def _clear_errors(self, work: Path | None = None) -> Iterator[None]:
        """Convert every exception of the reading library to BagError. Broken files raise exceptions of many types.

        work: a folder in which the recording was completed; the text names the recording instead.
        """
        try:
            yield
        except LassokinError:
            raise
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            if work is not None:
                reason = reason.replace(str(work), str(self.path if self.path.is_dir() else self.path.parent))
            raise BagError(f"{self.path} cannot be read as a rosbag2 recording: {reason}") from None


def _file_readers(reader: Any) -> list[Any]:
    """Return the readers of the data files, in order; the whole reader if it must decompress messages.

    The metadata's topics and counts are not needed to read the files.
    """
    whole = reader.compression_mode == "message"
    return [reader] if whole else list(getattr(reader.storage, "storages", [reader]))


def _counts(connections: Sequence[Any]) -> dict[tuple[str, str], int]:
    """Return (topic, message type) -> number of messages."""
    counts: dict[tuple[str, str], int] = {}
    for connection in connections:
        key = connection.topic, connection.msgtype
        counts[key] = counts.get(key, 0) + connection.msgcount
    return counts


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
        """Append a message. time_ns: recording time. latched: a playback delivers it to late subscribers too."""
        self.write_raw(topic, message_type, time_ns, self._types.serialize_cdr(message, message_type), latched)

    def write_raw(self, topic: str, message_type: str, time_ns: int, data: bytes, latched: bool = False) -> None:
        """Append a serialised message."""
        try:
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
