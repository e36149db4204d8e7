"""YAML read safely: no object construction, a bounded size, one clear error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from lassokin_ros.core.errors import LassokinError

MAX_CHARACTERS = 1_000_000


def read_text(path: Path, error: type[LassokinError]) -> str:
    """The text of a file; `error` is raised, with the reason, when it is too long, no UTF-8 or cannot be read."""
    try:
        with path.open(encoding="utf-8") as file:
            return file.read(MAX_CHARACTERS + 1)
    except UnicodeDecodeError as problem:
        raise error(f"{path} is no UTF-8 text: {problem.reason} at byte {problem.start}") from None
    except OSError as problem:
        raise error(f"{path} cannot be read: {problem.strerror}") from None


def load_mapping(text: str, source: str, error: type[LassokinError]) -> dict[str, Any]:
    """Parse YAML text that must be a mapping; `error` is raised, with `source` and the place, when it is not."""
    if len(text) > MAX_CHARACTERS:
        raise error(f"{source} is too long; expected at most {MAX_CHARACTERS} characters")
    try:
        data = yaml.safe_load(text)
    except RecursionError:
        raise error(f"{source} is nested too deeply") from None
    except yaml.YAMLError as problem:
        reason = " ".join(str(problem).split())
        raise error(f"{source} is no valid YAML: {reason}") from None
    if not isinstance(data, dict):
        raise error(f"{source} holds {type(data).__name__}; expected a mapping at the top level")
    return data
