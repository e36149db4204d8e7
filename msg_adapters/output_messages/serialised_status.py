"""diagnostic_msgs/DiagnosticArray as bytes: text is of another length in every frame, so that no places stay."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import DiagnosticArrayBuilder, StatusLine

CDR_HEADER = b"\0\1\0\0"  # little endian


class SerialisedStatus:
    """Writes a message of one line as CDR has it: numbers of four bytes, texts with their length before, a 0 behind.

    The first is compared with what the middleware makes of the same message; where they differ, messages are given.
    """

    def __init__(self, backend: Backend, wanted: bool = True) -> None:
        """wanted: False for messages in any case."""
        self._backend, self._builder = backend, DiagnosticArrayBuilder(backend)
        self._good: bool | None = None if wanted else False

    def fill(self, stamp_ns: int, frame_id: str, line: StatusLine) -> Any:
        """The serialised message, or the message."""
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
        parts += (_known_text(key), *_pieces(value))
    if line.values:
        parts[-1] = b"\0"  # what fills up to the next number has no place at the end
    return b"".join(parts)


@lru_cache(maxsize=64)
def _head(frame_id: str, level: int, name: str, message: str, hardware_id: str, count: int) -> bytes:
    """What is the same from frame to frame: up to the number of values."""
    parts = [_text(frame_id), struct.pack("<I", 1), struct.pack("<Bxxx", level)]
    return b"".join([*parts, *map(_text, (name, message, hardware_id)), struct.pack("<I", count)])


def _pieces(text: str) -> tuple[bytes, bytes, bytes]:
    content = text.encode()
    length = len(content) + 1
    return length.to_bytes(4, "little"), content, _ENDS[length % 4]


def _text(text: str) -> bytes:
    return b"".join(_pieces(text))


_ENDS = [bytes(1 + -length % 4) for length in range(4)]
"""The 0 behind a text, and what fills up to the next number, by its length."""
_known_text = lru_cache(maxsize=256)(_text)
"""For what comes again with every frame."""
