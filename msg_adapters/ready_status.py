"""diagnostic_msgs/DiagnosticArray as bytes: text is of another length in every frame, so that no places stay."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any

from msg_adapters.backends import Backend
from msg_adapters.outputs import DiagnosticArrayBuilder, StatusLine

CDR_HEADER = b"\0\1\0\0"  # little endian


class ReadyStatus:
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
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    parts = [CDR_HEADER, struct.pack("<iI", seconds, nanoseconds), _known_text(frame_id), struct.pack("<I", 1)]
    parts += [struct.pack("<Bxxx", line.level), *map(_known_text, (line.name, line.message, line.hardware_id))]
    parts.append(struct.pack("<I", len(line.values)))
    for key, value in line.values.items():
        parts += (_known_text(key), _text(value))
    if line.values:
        last = parts[-1]  # what fills up to the next number has no place at the end
        parts[-1] = last[: 4 + int.from_bytes(last[:4], "little")]
    return b"".join(parts)


def _text(text: str) -> bytes:
    content = text.encode()
    length = len(content) + 1
    return length.to_bytes(4, "little") + content + b"\0\0\0\0"[: 1 + -length % 4]


_known_text = lru_cache(maxsize=256)(_text)
"""For what comes again with every frame."""
