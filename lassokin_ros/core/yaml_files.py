"""YAML read safely: no object construction, no aliases, a bounded size, no unknown keys, one clear error."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml

from lassokin_ros.core.errors import LassokinError

MAX_CHARACTERS = 1_000_000
SUFFIXES = (".yaml", ".yml")
"""Of files that we write: a skeleton of another suffix would be taken for another format when it is read."""


def read_text(path: Path, error: type[LassokinError]) -> str:
    """The text of a file; `error` is raised, with the reason, when it is too long, no UTF-8 or cannot be read."""
    try:
        with path.open(encoding="utf-8-sig") as file:  # some editors put a byte order mark before it
            return file.read(MAX_CHARACTERS + 1)
    except UnicodeDecodeError as problem:
        raise error(f"{path} is no UTF-8 text: {problem.reason} at byte {problem.start}") from None
    except OSError as problem:
        raise error(f"{path} cannot be read: {problem.strerror}") from None


class _Loader(yaml.SafeLoader):
    """PyYAML's safe one, without aliases: a few lines of them stand for more than any memory holds."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError(f"line {self.peek_event().start_mark.line + 1}: aliases (*name) are not read")
        return super().compose_node(parent, index)

    def construct_scalar(self, node: Any) -> Any:
        """JSON writes a character beyond 16 bits as two halves, which PyYAML leaves so; half a one alone is no text."""
        value = super().construct_scalar(node)
        return value if value.isascii() else value.encode("utf-16", "surrogatepass").decode("utf-16")


def load_value(text: str, source: str, error: type[LassokinError]) -> Any:
    """Parse YAML text of any kind; `error` is raised, with `source` and the place, when it is none."""
    if len(text) > MAX_CHARACTERS:
        raise error(f"{source} is too long; expected at most {MAX_CHARACTERS} characters")
    try:
        return yaml.load(text, Loader=_Loader)  # a safe one
    except RecursionError:
        raise error(f"{source} is nested too deeply") from None
    except Exception as problem:  # besides YAMLError, whatever !!int, !!timestamp and the like make of their text
        reason = " ".join(str(problem).split())[:300]
        raise error(f"{source} is no valid YAML: {reason}") from None


def load_mapping(text: str, source: str, error: type[LassokinError]) -> dict[str, Any]:
    """Parse YAML text that must be a mapping; `error` is raised, with `source` and the place, when it is not."""
    data = load_value(text, source, error)
    if not isinstance(data, dict):
        raise error(f"{source} holds {type(data).__name__}; expected a mapping at the top level")
    return data


def user_path(name: str) -> Path:
    """A path as somebody writes it: with `~` for the home, where there is one."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        return Path(name)


def check_keys(data: Mapping[Any, Any], known: Collection[str], where: str, error: type[LassokinError]) -> None:
    """`error` is raised, with the keys that are read, for one that nobody reads: it was meant to say something."""
    for key in data:
        if key not in known:
            near = get_close_matches(str(key), known, 1)
            meant = f"; did you mean '{near[0]}'?" if near else ""
            raise error(f"{where} has the key {key!r}, which is none of: {', '.join(known)}{meant}")


def finite_numbers(value: Any, count: int) -> list[float] | None:
    """A list of so many finite numbers as floats; None for anything else."""
    if not (isinstance(value, list) and len(value) == count and all(isinstance(v, (int, float)) for v in value)):
        return None
    try:
        numbers = [float(v) for v in value]
    except OverflowError:  # of an integer of some hundred digits
        return None
    return numbers if all(map(math.isfinite, numbers)) else None
