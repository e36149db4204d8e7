"""Read rosbag2 recordings without ROS: clear errors, topic selection, message types."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
from msg_adapters.definitions import DEFINITIONS, OLDER

STORAGES = ("sqlite3", "mcap")
READ_TOGETHER, READ_BYTES = 64, 100_000
"""Largest number of messages that are read and deserialised at once, for the same reason, and bytes after which a group
ends earlier."""


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
        register_types(self.types)
        package = message_type.partition("/")[0]
        if any(name.startswith(f"{package}/") for name in OLDER):
            self._undefined.add(message_type)
            if self._older is None:
                self._older = typestore()
                register_types(self._older, {**DEFINITIONS, **OLDER})


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


def register_types(types: Any, definitions: Mapping[str, str] = DEFINITIONS) -> None:
    """Register message types that Jazzy lacks. types: the typestore of rosbags, changed in place."""
    from rosbags.typesys import get_types_from_msg

    for name, text in definitions.items():
        if name not in types.types:
            types.register(get_types_from_msg(text, name))
