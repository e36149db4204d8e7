"""rosbag2 recordings without ROS: reading with clear errors, choosing topics, writing all or nothing."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import load_mapping, read_text

STORAGES = ("sqlite3", "mcap")
FILE_NAME = "recording"
"""Of the file inside a recording's folder: not the folder's, so that its bytes don't depend on what that is called."""


WORKSHOP_SUFFIX = ".part"
"""Of the hidden folder beside a recording in which it is written until it is complete."""


class BagError(LassokinError):
    """A recording cannot be read, has not the topic that is needed, or cannot be written."""


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a recording: its name, its messages' type and number."""

    name: str
    message_type: str
    count: int

    def __str__(self) -> str:
        return f"{self.name} ({self.message_type}, {self.count} messages)"


def typestore() -> Any:
    """The message types of ROS 2 Jazzy, of rosbags. Raises BagError when rosbags is not installed."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise BagError("recordings are read and written with rosbags; install it with: pip install rosbags") from None
    return get_typestore(Stores.ROS2_JAZZY)


class BagReader:
    """An open recording: a rosbag2 folder, or a single .mcap or .db3 file. Use it in a `with` statement."""

    def __init__(self, path: Path) -> None:
        """Raises BagError when there is no recording at `path`, or it cannot be read."""
        self.path = path
        self.types = typestore()
        from rosbags.rosbag2 import Reader

        if not path.exists():
            raise BagError(f"there is no recording '{path}'; expected a rosbag2 folder, or a .mcap or .db3 file")
        if path.is_dir() and not (path / "metadata.yaml").is_file():
            raise BagError(f"'{path}' is no rosbag2 recording: it has no metadata.yaml")
        with self._clear_errors():
            self._reader = Reader(path)
            self._reader.open()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.close()

    @property
    def storage(self) -> str:
        """Its storage plugin, "sqlite3" or "mcap"."""
        files = [self.path] if self.path.is_file() else list(self.path.iterdir())
        return "mcap" if any(".mcap" in file.suffixes for file in files) else "sqlite3"

    @property
    def topics(self) -> list[RecordedTopic]:
        """Its topics, by name."""
        counts: dict[tuple[str, str], int] = {}
        for connection in self._reader.connections:
            key = connection.topic, connection.msgtype
            counts[key] = counts.get(key, 0) + connection.msgcount
        return [RecordedTopic(*key, count) for key, count in sorted(counts.items())]

    def find(self, message_type: str, name: str | None, usual_name: str, option: str) -> RecordedTopic:
        """The topic of this name; without a name the only one of this type, or among several the usual one.

        option: of the command line, with which the user may name the topic. Raises BagError with the topics there are.
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
            raise BagError(f"{self.path} has no topic of type {message_type} for {usual_name}; {self._listing()}")
        if len(candidates) > 1:
            listed = ", ".join(t.name for t in candidates)
            raise BagError(f"{self.path} has several topics for {usual_name}: {listed}; choose one with {option}")
        return candidates[0]

    def _listing(self) -> str:
        return f"its topics are: {', '.join(map(str, self.topics)) or 'none'}"

    def messages(self, topics: Sequence[RecordedTopic]) -> Iterator[tuple[str, int, Any]]:
        """(topic, time of recording in ns, message) in the order of recording; None for a message of wrong content.

        Raises BagError where the recording ends in the middle, or at the end when messages are missing.
        """
        for connection in self._chosen(topics):
            self._register(connection)
        for connection, time_ns, data in self._items(topics):
            try:
                message = self.types.deserialize_cdr(data, connection.msgtype)
            except Exception:  # rosbags raises whatever the wrong bytes lead to
                message = None
            yield connection.topic, time_ns, message

    def raw(self, topics: Sequence[RecordedTopic]) -> Iterator[tuple[str, int, bytes]]:
        """The same with the messages as they are serialised."""
        for connection, time_ns, data in self._items(topics):
            yield connection.topic, time_ns, bytes(data)

    def _chosen(self, topics: Sequence[RecordedTopic]) -> list[Any]:
        names = {topic.name for topic in topics}
        return [connection for connection in self._reader.connections if connection.topic in names]

    def _items(self, topics: Sequence[RecordedTopic]) -> Iterator[Any]:
        source, read = iter(self._reader.messages(self._chosen(topics))), 0
        while True:
            with self._clear_errors():
                item = next(source, None)
            if item is None:
                break
            read += 1
            yield item
        expected = sum(topic.count for topic in topics)
        if read < expected:
            raise BagError(f"{self.path} is damaged: {read} of the {expected} messages that it should have can be read")

    def _register(self, connection: Any) -> None:
        """Learn a message type that Jazzy does not have from the definition in the recording."""
        if connection.msgtype in self.types.types:
            return
        from rosbags.typesys import get_types_from_msg

        if not connection.msgdef.data:
            raise BagError(f"{self.path} does not say what a {connection.msgtype} is; record it as mcap")
        with self._clear_errors():
            self.types.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))

    @contextmanager
    def _clear_errors(self) -> Iterator[None]:
        """Whatever the reading library raises becomes one BagError: its reaction to broken files has many forms."""
        try:
            yield
        except LassokinError:
            raise
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise BagError(f"{self.path} cannot be read as a rosbag2 recording: {reason}") from None


class BagWriter:
    """Writes a recording that appears under its name only when it is complete. Use it in a `with` statement."""

    def __init__(
        self,
        path: Path,
        storage: str,
        types: Any,
        replace: bool = False,
        ours: Callable[[str], bool] = lambda name: False,
    ) -> None:
        """storage: one of STORAGES; types: of `typestore()`; replace: an existing recording at `path` gives way.

        ours: whether a file of this name in that recording's folder may go with it, besides those that are its own.
        Raises BagError when something is at `path` already that may not be replaced, or its folder does not exist.
        """
        self.path, self._types, self._replace, self._ours = path, types, replace, ours
        if path.exists() and not replace:
            raise BagError(f"'{path}' exists already; choose another output or say --force")
        if path.exists() and not (path.is_dir() and (path / "metadata.yaml").is_file()):
            raise BagError(f"'{path}' exists and is no rosbag2 recording; it will not be replaced")
        if path.exists():
            refuse_foreign(path, ours)
        if not path.parent.is_dir():
            raise BagError(f"there is no folder '{path.parent}' for the output '{path.name}'")
        self._storage = storage
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> BagWriter:
        try:
            prefix = f".{self.path.name}."
            self._workshop = Path(tempfile.mkdtemp(prefix=prefix, suffix=WORKSHOP_SUFFIX, dir=self.path.parent))
        except OSError as error:
            raise BagError(f"'{self.path}' cannot be written: {error.strerror}") from None
        try:
            self._open()
        except BaseException:  # a signal's too
            shutil.rmtree(self._workshop, ignore_errors=True)
            raise
        return self

    def _open(self) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        plugin = StoragePlugin.MCAP if self._storage == "mcap" else StoragePlugin.SQLITE3
        self._writer = Writer(self._workshop / FILE_NAME, version=9, storage_plugin=plugin)
        try:
            self._writer.open()
        except Exception as error:  # OSError or the storage's own
            raise BagError(f"'{self.path}' cannot be written: {error}") from None

    def write(self, topic: str, message_type: str, time_ns: int, message: Any, latched: bool = False) -> None:
        """Append a message; time_ns: time of recording. latched: late subscribers of a playback get it too."""
        self.write_raw(topic, message_type, time_ns, self._types.serialize_cdr(message, message_type), latched)

    def write_raw(self, topic: str, message_type: str, time_ns: int, data: bytes, latched: bool = False) -> None:
        """Append a message that is serialised already."""
        try:
            if topic not in self._connections:
                self._connections[topic] = self._connect(topic, message_type, latched)
            self._writer.write(self._connections[topic], time_ns, data)
        except Exception as error:  # OSError or the storage's own, for a full disk most likely
            raise BagError(f"'{self.path}' cannot be written: {error}") from None

    def _connect(self, topic: str, message_type: str, latched: bool) -> Any:
        qos = [_latched_qos()] if latched else []
        return self._writer.add_connection(topic, message_type, typestore=self._types, offered_qos_profiles=qos)

    @property
    def folder(self) -> Path:
        """The recording's folder while it is made: what is put there besides will be there under its name."""
        return self._workshop / FILE_NAME

    def note(self, key: str, text: str) -> None:
        """Put a text into the recording's metadata, as rosbag2's custom data."""
        self._writer.set_custom_data(key, text)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            shutil.rmtree(self._workshop, ignore_errors=True)

    def _finish(self) -> None:
        try:
            self._writer.close()
            if self.path.exists():
                if not self._replace:
                    raise BagError(f"'{self.path}' has come into being meanwhile; it will not be replaced")
                refuse_foreign(self.path, self._ours)
                self.path.rename(self._workshop / "replaced")
            (self._workshop / FILE_NAME).rename(self.path)
        except LassokinError:
            raise
        except Exception as error:
            raise BagError(f"'{self.path}' cannot be written: {error}") from None


def refuse_foreign(path: Path, ours: Callable[[str], bool]) -> None:
    """Raise BagError when in a recording's folder something is neither the recording's nor `ours` by its name."""
    try:
        entries = sorted(path.iterdir())
    except OSError as error:
        raise BagError(f"'{path}' cannot be replaced: {error.strerror}") from None
    own = {"metadata.yaml", *_data_files(path)}
    for entry in entries:
        if entry.is_dir() or not (entry.name in own or ours(entry.name)):
            raise BagError(
                f"'{path}' will not be replaced: '{entry.name}' in it is no part of the recording; move that away or "
                "choose another output"
            )


def _data_files(path: Path) -> list[str]:
    """The files that a recording's metadata names; none when it cannot be read."""
    try:
        data = load_mapping(read_text(path / "metadata.yaml", BagError), str(path), BagError)
        return [str(name) for name in data["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (BagError, KeyError, TypeError):
        return []


def remove_leftovers(path: Path) -> None:
    """Remove what a writer of the recording `path` left behind when its process was killed; none may be at work."""
    pattern = re.compile(rf"\.{re.escape(path.name)}\.[a-z0-9_]+{re.escape(WORKSHOP_SUFFIX)}")
    for entry in path.parent.iterdir() if path.parent.is_dir() else ():
        if pattern.fullmatch(entry.name):
            shutil.rmtree(entry, ignore_errors=True)


def _latched_qos() -> Any:
    """Reliable, transient local, depth 1: a playback offers the message to late subscribers."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    forever = QosTime(9223372036, 854775807)  # as ROS 2 writes it
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
