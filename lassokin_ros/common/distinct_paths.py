"""No output of a command may replace one of its inputs or another of its outputs."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

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
