"""Serialised messages in which only numbers and stamps are rewritten from frame to frame.

Serialising a message of nested Python objects takes ten times as long as sending it. From frame to frame only numbers
change, at fixed positions, as long as the frame_id and the number of values are the same. The positions are found by
serialising a message with marked numbers. Before the positions are used, a message made with them is compared with the
middleware's serialisation of the same message. If they differ, the message object is used.
"""

from __future__ import annotations

import struct
from typing import Any, Hashable

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import StampedBuilder

MARKED_STAMP = 706_658_526 * 1_000_000_000 + 464_374_526
"""ns: a stamp whose two words occur nowhere else in the message."""
STAMP = struct.Struct("=II")
CDR_HEADER = 4
"""bytes before the content; alignment is counted from there."""
MOST_TEMPLATES = 64
"""Largest number of stored layouts, so that a changing frame_id does not use memory without bound."""


class SerialisedMessage:
    """Fills the messages of one builder as bytes."""

    def __init__(self, builder: StampedBuilder, backend: Backend) -> None:
        self._builder, self._backend = builder, backend
        self._templates: dict[Hashable, Template | None] = {}

    def fill(self, stamp_ns: int, frame_id: str, *content: np.ndarray) -> Any:
        """Return the serialised message, or the message object if it is empty or no positions are known.

        content: as in the builder's `fill`.
        """
        numbers = self._builder.numbers(*content)
        if len(numbers) == 0:
            return self._builder.place(stamp_ns, frame_id, numbers)
        key = frame_id, len(numbers), self._builder.shape
        template = self._templates.get(key)
        if template is not None:
            return template.of(stamp_ns, numbers)
        if key in self._templates:
            return self._builder.place(stamp_ns, frame_id, numbers)
        if len(self._templates) >= MOST_TEMPLATES:
            self._templates.clear()
        self._templates[key] = self._learn(stamp_ns, frame_id, numbers)
        return self.fill(stamp_ns, frame_id, *content)

    def _learn(self, stamp_ns: int, frame_id: str, numbers: np.ndarray) -> Template | None:
        numbers, marked = numbers.copy(), _marked(numbers)
        template = Template(self._backend.serialise(self._builder.place(MARKED_STAMP, frame_id, marked)), marked)
        message = self._builder.place(stamp_ns, frame_id, numbers)
        good = template.found and self._backend.alike(template.of(stamp_ns, numbers), message)
        return template if good else None


class Template:
    """A serialised message and the positions of its numbers and stamps."""

    def __init__(self, serialised: bytes, marked: np.ndarray) -> None:
        """serialised: the message with MARKED_STAMP and the numbers `marked`, all different."""
        self._buffer = bytearray(serialised)
        seconds, nanoseconds = divmod(MARKED_STAMP, 1_000_000_000)
        words = self._view(np.dtype(np.uint32))
        first = np.flatnonzero((words[:-1] == seconds) & (words[1:] == nanoseconds))
        self._stamps = [slice(at, at + STAMP.size) for at in (CDR_HEADER + 4 * first).tolist()]
        self._places: Any = slice(None)
        at = serialised.find(marked.tobytes())
        if at >= 0:  # contiguous, as in most messages
            self._numbers = np.frombuffer(self._buffer, marked.dtype, len(marked), at)
        else:
            self._numbers = self._view(marked.dtype)
            self._places = np.flatnonzero(np.isin(self._numbers, marked))
        #: Whether the positions of all numbers and of a stamp were found.
        self.found = len(first) > 0 and np.array_equal(self._numbers[self._places], marked)

    def of(self, stamp_ns: int, numbers: np.ndarray) -> bytes:
        """Return the message with these numbers."""
        stamp = STAMP.pack(*divmod(stamp_ns, 1_000_000_000))
        for place in self._stamps:
            self._buffer[place] = stamp
        self._numbers[self._places] = numbers
        return bytes(self._buffer)

    def _view(self, dtype: np.dtype) -> np.ndarray:
        count = (len(self._buffer) - CDR_HEADER) // dtype.itemsize
        return np.frombuffer(self._buffer, dtype, count, CDR_HEADER)


def _marked(numbers: np.ndarray) -> np.ndarray:
    """Return as many numbers of the same kind, which occur nowhere else in the message."""
    if numbers.dtype == np.uint8:
        return np.random.default_rng(0).integers(0, 256, len(numbers), np.uint8)
    return 1e200 * np.linspace(1, 2, len(numbers))
