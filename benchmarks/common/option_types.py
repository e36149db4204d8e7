"""Command lines: the options that benchmarks share, and types of options whose refusal names the expected form."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any


def names(text: str) -> list[str]:
    """Words with commas or blanks between."""
    return [name for name in text.replace(",", " ").split() if name]


def some_of(known: Collection[str]) -> Callable[[str], list[str]]:
    """An option's type: one or more of the known names."""

    def read(text: str) -> list[str]:
        chosen = names(text)
        if not chosen or not set(chosen) <= set(known):
            raise argparse.ArgumentTypeError(f"'{text}'; expected some of: {', '.join(known)}")
        return chosen

    return read


def number(kind: Callable[[str], float], holds: Callable[[float], bool], expected: str) -> Callable[[str], Any]:
    """An option's type: the value that `kind` reads from the text, if it is finite and `holds`."""

    def read(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and holds(value)):
            raise argparse.ArgumentTypeError(f"{text}; expected {expected}")
        return value

    return read


def output_file(text: str) -> Path:
    """An option's type: path of a file to write. It is checked before the work, which may take hours."""
    path = Path(text)
    if path.is_dir() or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text}; expected a file in a folder that exists")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise argparse.ArgumentTypeError(f"{text}; expected a place that may be written")
    return path


def command_line(description: str | None, *shared: str) -> argparse.ArgumentParser:
    """The parser of a script with this docstring, with the options of `SHARED` that are named."""
    result = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in (*shared, "json"):
        result.add_argument(f"--{name}", **SHARED[name])
    return result


count = number(int, lambda n: n >= 1, "1 or more")
seed = number(int, lambda n: n >= 0, "a whole number, 0 or more")
finite = number(float, lambda x: True, "a finite number")
positive = number(float, lambda x: x > 0, "a number above 0")
size = number(float, lambda x: x >= 0, "a number, 0 or more")
share = number(float, lambda x: 0 <= x <= 1, "a share, 0 to 1")
frames = number(int, lambda n: n >= 10, "10 or more")

SHARED: dict[str, dict[str, Any]] = {
    "data": {"type": Path, "metavar": "DIR", "help": "the shared data (default: LASSOKIN_DATA or ../shared/data)"},
    "validation-people": {"action": "store_true", "help": "the people with whom the design was chosen, not the test's"},
    "seed": {"type": seed, "default": 0, "help": "(0)"},
    "jobs": {"type": count, "default": os.cpu_count(), "help": "processes (one per core)"},
    "json": {"type": output_file, "metavar": "FILE", "help": "write the records as a JSON list"},
}
