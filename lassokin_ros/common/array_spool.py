"""Arrays in a temporary file, for data whose size grows with the length of a recording."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.errors import LassokinError


class SpoolError(LassokinError):
    """The temporary file cannot be written."""


class Record(NamedTuple):
    """Position of a record in the file. layout: index of its layout."""

    offset: int
    layout: int


class ArraySpool:
    """An unnamed file in the folder for temporary files, to which records of named arrays are appended.

    The file is deleted with the object. Methods raise SpoolError if the file cannot be written.
    """

    def __init__(self) -> None:
        with _clear_errors():
            self._file = tempfile.TemporaryFile()
        self._layouts: dict[tuple[object, ...], int] = {}
        self._known: list[np.dtype] = []
        self._end = 0

    def append(self, arrays: Mapping[str, np.ndarray]) -> Record:
        """Store the arrays."""
        layout = tuple((name, array.dtype, array.shape) for name, array in arrays.items())
        if layout not in self._layouts:
            self._layouts[layout] = len(self._known)
            self._known.append(np.dtype(list(layout)))
        record = Record(self._end, self._layouts[layout])
        with _clear_errors():
            for array in arrays.values():
                self._end += self._file.write(array.tobytes())
        return record

    def read(self, record: Record) -> dict[str, np.ndarray]:
        """Return the arrays of a record by name, read-only."""
        return {name: column[0] for name, column in self._rows([record]).items()}

    def columns(self, records: Sequence[Record]) -> dict[str, np.ndarray]:
        """Return the arrays of f records with one layout, by name, with a first axis (f, ...).

        If the records are the whole file, it is mapped instead of read: pages are loaded when they are used.
        """
        if len({record.layout for record in records}) != 1:
            raise ValueError("the records have several layouts; expected one or more records with the same arrays")
        return self._rows(records)

    def _rows(self, records: Sequence[Record]) -> dict[str, np.ndarray]:
        kind = self._known[records[0].layout]
        self._flush()
        if not kind.names:
            return {}
        if len(records) * kind.itemsize == self._end:
            rows: np.ndarray = np.memmap(self._file, dtype=kind, mode="r", shape=(len(records),)).view(np.ndarray)
        else:
            parts = (os.pread(self._file.fileno(), kind.itemsize, record.offset) for record in records)
            rows = np.frombuffer(b"".join(parts), dtype=kind)
        return {name: rows[name] for name in kind.names or ()}

    def _flush(self) -> None:
        with _clear_errors():
            self._file.flush()


@contextmanager
def _clear_errors() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        place = tempfile.gettempdir()
        raise SpoolError(
            f"a temporary file in {place} cannot be written: {error.strerror}; free space there, or set TMPDIR to "
            "another folder"
        ) from None
