"""Output files: none replaces an input or another output, and a set of files gets its names at once, or not at all."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import BinaryIO

from lassokin_ros.core.errors import LassokinError

Named = tuple[str, Path]
"""The kind of a path, for the error text, and the path."""


def refuse_shared(inputs: Iterable[Named], outputs: Iterable[Named], error: type[LassokinError]) -> None:
    """Raise `error` if an output is an input or another output, by any name. Call it before the work."""
    taken = {real_path(path): what for what, path in inputs}
    read = set(taken)
    for what, path in outputs:
        place = real_path(path)
        if place in read:
            raise error(f"{what} '{path}' is also {taken[place]}, which is read; choose another path")
        if place in taken:
            raise error(f"{taken[place]} and {what} both name '{path}'; choose another name for one of them")
        taken[place] = what


def real_path(path: Path) -> Path:
    """Resolve links. `Path.resolve` is not used because it raises an error for circular links."""
    return Path(os.path.realpath(path))


def refuse_existing(path: Path, replace: bool, error: type[LassokinError]) -> None:
    """Raise `error` if a file cannot be created at `path`. replace: an existing file may be replaced."""
    try:
        folder, there, place = path.is_dir(), path.exists(), path.parent.is_dir()
    except OSError as problem:  # a parent folder without search permission
        raise error(f"'{path}' cannot be written: {problem.strerror}") from None
    if folder:
        raise error(f"'{path}' is a folder; expected the name of a file")
    if there and not replace:
        raise error(f"'{path}' exists already; choose another name or add --force")
    if not place:
        raise error(f"there is no folder '{path.parent}' for '{path.name}'")
    try:
        TemporaryFile(dir=path.parent).close()  # root has permissions also where nothing can be created
    except OSError as problem:
        raise error(f"'{path}' cannot be written: {problem.strerror}") from None


def files_of_people(folder: Path, stem: str, suffix: str) -> list[Path]:
    """Return the per-person files in a folder: <stem>_<id><suffix>, where an id is p and a number.

    The number ends the name: `walk_p2_p7.yaml` belongs to the recording `walk_p2`, not to `walk`.
    """
    name = re.compile(rf"{re.escape(stem)}_p\d+{re.escape(suffix)}")
    return sorted(file for file in folder.glob("*") if name.fullmatch(file.name))


class AtomicFiles:
    """A set of files that are renamed together when a `with` statement ends without an exception."""

    def __init__(self, replace: bool, error: type[LassokinError]) -> None:
        """replace: existing files may be replaced. error: the exception raised if a file cannot be written."""
        self._replace, self._error = replace, error
        self._parts: dict[Path, Path] = {}
        self._old: list[Path] = []
        self.placed: list[Path] = []
        """Paths that have been renamed already. The error text lists them if a later rename fails."""

    def part(self, path: Path) -> Path:
        """Return where the file is to be written that will appear at `path`. It has the same suffix."""
        refuse_existing(path, self._replace, self._error)
        return self._parts.setdefault(path, path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}"))

    def write(self, path: Path, fill: Callable[[BinaryIO], object]) -> None:
        """Call `fill` to write the file that will appear at `path`."""
        part = self.part(path)
        try:
            with part.open("wb") as file:
                fill(file)
                file.flush()
                os.fsync(file.fileno())  # the content is on the disk before the name, also after a power failure
        except OSError as problem:
            raise self._error(f"'{path}' cannot be written: {problem.strerror or problem}") from None

    def write_text(self, path: Path, text: str) -> None:
        """Write a text file in UTF-8."""
        data = text.encode()
        self.write(path, lambda file: file.write(data))

    def remove(self, path: Path) -> None:
        """Remove a file of an earlier run when the others have their names."""
        self._old.append(path)

    def __enter__(self) -> AtomicFiles:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            for part in self._parts.values():
                with suppress(OSError, ValueError):  # renamed already; or a name or disk that raised its own error
                    part.unlink()
            self._parts.clear()

    def _finish(self) -> None:
        try:
            self.check()
            for path, part in self._parts.items():
                try:
                    part.replace(path)
                except OSError as problem:
                    raise self._error(f"'{path}' cannot be written: {problem.strerror or problem}") from None
                self.placed.append(path)
            for path in self._old:
                try:
                    path.unlink(missing_ok=True)
                except OSError as problem:
                    raise self._error(f"'{path}' of an earlier run cannot be removed: {problem.strerror}") from None
        except self._error as error:
            if not self.placed:
                raise
            raise self._error(f"{error}; written before: {', '.join(map(str, self.placed))}") from None

    def check(self) -> None:
        """Raise the error if another file has appeared at one of the paths."""
        for path in self._parts:
            refuse_existing(path, self._replace, self._error)
