"""Safe reading of YAML: no object construction, no aliases, limited size, no unknown keys, one clear error."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from lassokin_ros.core.errors import LassokinError

MAX_CHARACTERS = 1_000_000


def read_text(path: Path, error: type[LassokinError]) -> str:
    """The text of a file. Raises `error` if it is too long, not UTF-8 or cannot be read."""
    try:
        with path.open(encoding="utf-8-sig") as file:  # some editors write a byte order mark
            return file.read(MAX_CHARACTERS + 1)
    except UnicodeDecodeError as problem:
        raise error(f"{path} is no UTF-8 text: {problem.reason} at byte {problem.start}") from None
    except OSError as problem:
        raise error(f"{path} cannot be read: {problem.strerror}") from None


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader without aliases: a few lines with aliases can expand to more than the memory."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError(f"line {self.peek_event().start_mark.line + 1}: aliases (*name) are not read")
        return super().compose_node(parent, index)

    def construct_scalar(self, node: Any) -> Any:
        """Join surrogate pairs, as which JSON escapes a character beyond 16 bits; a single one is invalid."""
        value = super().construct_scalar(node)
        return value if value.isascii() else value.encode("utf-16", "surrogatepass").decode("utf-16")


_ShippedLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The safe loader of libyaml, ten times as fast; its nodes cannot be checked for aliases."""


@cache
def shipped_mapping(package: str, name: str) -> dict[str, Any]:
    """The mapping in a YAML file of this project, read once. Do not change it. name: path in the package."""
    text = (resources.files(package) / name).read_text(encoding="utf-8")
    data: dict[str, Any] = yaml.load(text, Loader=_ShippedLoader)
    return data


def load_value(text: str, source: str, error: type[LassokinError]) -> Any:
    """Parse YAML text of any kind. Raises `error`, with `source` and the position, if it is not valid."""
    if len(text) > MAX_CHARACTERS:
        raise error(f"{source} is too long; expected at most {MAX_CHARACTERS} characters")
    try:
        return yaml.load(text, Loader=_Loader)  # a subclass of SafeLoader
    except RecursionError:
        raise error(f"{source} is nested too deeply") from None
    except Exception as problem:  # YAMLError, or an error of a constructor (!!int, !!timestamp, ...)
        reason = " ".join(str(problem).split())[:300]
        raise error(f"{source} is no valid YAML: {reason}") from None


def load_mapping(text: str, source: str, error: type[LassokinError]) -> dict[str, Any]:
    """Parse YAML text that must be a mapping. Raises `error`, with `source` and the position, if it is not."""
    data = load_value(text, source, error)
    if not isinstance(data, dict):
        raise error(f"{source} holds {type(data).__name__}; expected a mapping at the top level")
    return data


def user_path(name: str) -> Path:
    """The path for a name given by the user, with `~` expanded if there is a home directory."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        return Path(name)


def check_keys(data: Mapping[Any, Any], known: Collection[str], where: str, error: type[LassokinError]) -> None:
    """Raise `error`, with the list of known keys, for a key that is not known."""
    for key in data:
        if key not in known:
            near = get_close_matches(str(key), known, 1)
            meant = f"; did you mean '{near[0]}'?" if near else ""
            raise error(f"{where} has the key {key!r}, which is none of: {', '.join(known)}{meant}")


def finite_numbers(value: Any, count: int) -> list[float] | None:
    """A list of `count` finite numbers as floats; None for anything else."""
    if not (isinstance(value, list) and len(value) == count and all(isinstance(v, (int, float)) for v in value)):
        return None
    try:
        numbers = [float(v) for v in value]
    except OverflowError:  # an integer with hundreds of digits
        return None
    return numbers if all(map(math.isfinite, numbers)) else None
