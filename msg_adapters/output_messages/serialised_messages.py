"""Messages in their serialised form, of which only the numbers and stamps are written anew from frame to frame.

To turn a message of nested Python objects into bytes takes ten times as long as to send them. From frame to frame the
bytes differ in numbers alone, at the same places, as long as the frame_id stays and as many numbers come. The places
are found by serialising a message of marked numbers; what is then made is compared with what the middleware makes of
the same message before it is ever used. Where they differ, the message itself is given.
"""

from __future__ import annotations

import struct
from typing import Any, Hashable

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import StampedBuilder

MARKED_STAMP = 706_658_526 * 1_000_000_000 + 464_374_526
"""ns: a stamp whose two words stand nowhere else."""
STAMP = struct.Struct("=II")
CDR_HEADER = 4
"""bytes before the content, from which the alignment of what follows is counted."""
MOST_TEMPLATES = 64
"""A sender that changes its frame_id with every message takes no more memory than this."""


class SerialisedMessage:
    """Fills one builder's messages as bytes."""

    def __init__(self, builder: StampedBuilder, backend: Backend) -> None:
        self._builder, self._backend = builder, backend
        self._templates: dict[Hashable, Template | None] = {}

    def fill(self, stamp_ns: int, frame_id: str, *content: np.ndarray) -> Any:
        """The serialised message, or where it has no known places the message; content: as the builder's `fill`."""
        numbers = self._builder.numbers(*content)
        key = frame_id, len(numbers), self._builder.shape
        if key not in self._templates:
            if len(self._templates) >= MOST_TEMPLATES:
                self._templates.clear()
            self._templates[key] = self._learn(stamp_ns, frame_id, numbers)
        template = self._templates[key]
        if template is None:
            return self._builder.place(stamp_ns, frame_id, numbers)
        return template.of(stamp_ns, numbers)

    def _learn(self, stamp_ns: int, frame_id: str, numbers: np.ndarray) -> Template | None:
        numbers, marked = numbers.copy(), _marked(numbers)
        template = Template(self._backend.serialise(self._builder.place(MARKED_STAMP, frame_id, marked)), marked)
        message = self._builder.place(stamp_ns, frame_id, numbers)
        good = template.found and self._backend.alike(template.of(stamp_ns, numbers), message)
        return template if good else None


class Template:
    """A serialised message and the places of its numbers and stamps."""

    def __init__(self, serialised: bytes, marked: np.ndarray) -> None:
        """serialised: the message with MARKED_STAMP and the numbers `marked`, all different."""
        self._buffer = bytearray(serialised)
        seconds, nanoseconds = divmod(MARKED_STAMP, 1_000_000_000)
        words = self._view(np.dtype(np.uint32))
        first = np.flatnonzero((words[:-1] == seconds) & (words[1:] == nanoseconds))
        self._stamps = (CDR_HEADER + 4 * first).tolist()
        self._places: Any = slice(None)
        at = serialised.find(marked.tobytes())
        if at >= 0:  # all in a row, as in most messages
            self._numbers = np.frombuffer(self._buffer, marked.dtype, len(marked), at)
        else:
            self._numbers = self._view(marked.dtype)
            self._places = np.flatnonzero(np.isin(self._numbers, marked))
        #: Whether every number and a stamp has its place.
        self.found = len(first) > 0 and np.array_equal(self._numbers[self._places], marked)

    def of(self, stamp_ns: int, numbers: np.ndarray) -> bytes:
        """The message with these numbers."""
        seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
        for place in self._stamps:
            STAMP.pack_into(self._buffer, place, seconds, nanoseconds)
        self._numbers[self._places] = numbers
        return bytes(self._buffer)

    def _view(self, dtype: np.dtype) -> np.ndarray:
        count = (len(self._buffer) - CDR_HEADER) // dtype.itemsize
        return np.frombuffer(self._buffer, dtype, count, CDR_HEADER)


def _marked(numbers: np.ndarray) -> np.ndarray:
    """As many numbers of the same kind, which stand nowhere else."""
    if numbers.dtype == np.uint8:
        return np.random.default_rng(0).integers(0, 256, len(numbers), np.uint8)
    return 1e200 * np.linspace(1, 2, len(numbers))
