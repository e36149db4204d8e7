"""diagnostic_msgs/DiagnosticArray as bytes. The texts change their lengths, so there are no fixed positions."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import DiagnosticArrayBuilder, StatusLine

CDR_HEADER = b"\0\1\0\0"  # little endian


class SerialisedStatus:
    """Writes a message with one status in CDR: numbers of four bytes, and texts with their length before and a 0 after.

    The first message is compared with the middleware's serialisation of the same message. If they differ, message
    objects are returned.
    """

    def __init__(self, backend: Backend, wanted: bool = True) -> None:
        """wanted: False to return message objects in all cases."""
        self._backend, self._builder = backend, DiagnosticArrayBuilder(backend)
        self._good: bool | None = None if wanted else False

    def fill(self, stamp_ns: int, frame_id: str, line: StatusLine) -> Any:
        """Return the serialised message, or the message object."""
        if self._good is None:
            message = self._builder.fill(stamp_ns, frame_id, [line])
            self._good = self._backend.alike(_serialised(stamp_ns, frame_id, line), message)
        if self._good:
            return _serialised(stamp_ns, frame_id, line)
        return self._builder.fill(stamp_ns, frame_id, [line])


def _serialised(stamp_ns: int, frame_id: str, line: StatusLine) -> bytes:
    head = _head(frame_id, line.level, line.name, line.message, line.hardware_id, len(line.values))
    parts = [CDR_HEADER, struct.pack("<iI", *divmod(stamp_ns, 1_000_000_000)), head]
    for key, value in line.values.items():
        content = value.encode()
        count, end = _around(len(content))
        parts += (_known_text(key), count, content, end)
    if line.values:
        parts[-1] = b"\0"  # there is no padding at the end
    return b"".join(parts)


@lru_cache(maxsize=64)
def _head(frame_id: str, level: int, name: str, message: str, hardware_id: str, count: int) -> bytes:
    """Return the part that is the same in each frame: up to the number of values."""
    parts = [_text(frame_id), struct.pack("<I", 1), struct.pack("<Bxxx", level)]
    return b"".join([*parts, *map(_text, (name, message, hardware_id)), struct.pack("<I", count)])


@lru_cache(maxsize=256)
def _around(length: int) -> tuple[bytes, bytes]:
    """Return what precedes a text of `length` bytes, its length with the 0, and what follows: the 0 and the padding."""
    return struct.pack("<I", length + 1), bytes(1 + -(length + 1) % 4)


def _text(text: str) -> bytes:
    content = text.encode()
    count, end = _around(len(content))
    return count + content + end


_known_text = lru_cache(maxsize=256)(_text)
"""Cache for texts that occur in every frame."""
