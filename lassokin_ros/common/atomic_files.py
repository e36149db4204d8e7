"""Files that appear under their name only when they are complete, all of a set or none."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from lassokin_ros.core.errors import LassokinError


def refuse_existing(path: Path, replace: bool, error: type[LassokinError]) -> None:
    """Raise `error` when a file cannot come into being at `path`; replace: one that is there gives way."""
    try:
        folder, there, place = path.is_dir(), path.exists(), path.parent.is_dir()
    except OSError as problem:  # a folder on the way that may not be searched
        raise error(f"'{path}' cannot be written: {problem.strerror}") from None
    if folder:
        raise error(f"'{path}' is a folder; expected the name of a file")
    if there and not replace:
        raise error(f"'{path}' exists already; choose another name or say --force")
    if not place:
        raise error(f"there is no folder '{path.parent}' for '{path.name}'")


def files_of_people(folder: Path, stem: str, suffix: str) -> list[Path]:
    """Those in a folder of which several people have one each, by name: <stem>_<id><suffix>; an id is p and a number.

    The number is the name's end: `walk_p2_p7.yaml` belongs to another recording than `walk`, and so may `walk_pages`.
    """
    name = re.compile(rf"{re.escape(stem)}_p\d+{re.escape(suffix)}")
    return sorted(file for file in folder.glob("*") if name.fullmatch(file.name))


class AtomicFiles:
    """A set of files that are renamed to their places together, at the end of a `with` statement without an error."""

    def __init__(self, replace: bool, error: type[LassokinError]) -> None:
        """replace: files that are there give way; error: what is raised when a file cannot be written."""
        self._replace, self._error = replace, error
        self._parts: dict[Path, Path] = {}
        self.placed: list[Path] = []
        """What has its name already: said when one that comes after cannot have its own."""

    def write(self, path: Path, fill: Callable[[BinaryIO], None]) -> None:
        """Have `fill` write a file that will be at `path`."""
        refuse_existing(path, self._replace, self._error)
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        self._parts[path] = part
        try:
            with part.open("wb") as file:
                fill(file)
                file.flush()
                os.fsync(file.fileno())  # what has its name is on the disk, even when the power fails
        except OSError as problem:
            raise self._error(f"'{path}' cannot be written: {problem.strerror or problem}") from None

    def write_text(self, path: Path, text: str) -> None:
        """A file of this text, in UTF-8."""
        data = text.encode()
        self.write(path, lambda file: _put(file, data))

    def __enter__(self) -> AtomicFiles:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            for part in self._parts.values():
                with suppress(OSError):  # none there, or a read-only disk, of which another error tells
                    part.unlink()

    def _finish(self) -> None:
        try:
            self.check()
            for path, part in self._parts.items():
                try:
                    part.replace(path)
                except OSError as problem:
                    raise self._error(f"'{path}' cannot be written: {problem.strerror or problem}") from None
                self.placed.append(path)
        except self._error as error:
            if not self.placed:
                raise
            raise self._error(f"{error}; written before: {', '.join(map(str, self.placed))}") from None

    def check(self) -> None:
        """Raise the error when something has come into being in a file's place meanwhile."""
        for path in self._parts:
            refuse_existing(path, self._replace, self._error)


def _put(file: BinaryIO, data: bytes) -> None:
    file.write(data)
