"""Types of command line options. A wrong value gives one line with the expected form."""

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


count = number(int, lambda n: n >= 1, "1 or more")
seed = number(int, lambda n: n >= 0, "a whole number, 0 or more")
finite = number(float, lambda x: True, "a finite number")
positive = number(float, lambda x: x > 0, "a number above 0")
size = number(float, lambda x: x >= 0, "a number, 0 or more")
share = number(float, lambda x: 0 <= x <= 1, "a share, 0 to 1")
frames = number(int, lambda n: n >= 10, "10 or more")
