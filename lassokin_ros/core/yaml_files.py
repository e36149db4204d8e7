"""YAML read safely: no object construction, a bounded size, one clear error."""

from __future__ import annotations

from typing import Any

import yaml

from lassokin_ros.core.errors import LassokinError

MAX_CHARACTERS = 1_000_000


def load_mapping(text: str, source: str, error: type[LassokinError]) -> dict[str, Any]:
    """Parse YAML text that must be a mapping; `error` is raised, with `source` and the place, when it is not."""
    if len(text) > MAX_CHARACTERS:
        raise error(f"{source} has {len(text)} characters; expected at most {MAX_CHARACTERS}")
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as problem:
        reason = " ".join(str(problem).split())
        raise error(f"{source} is no valid YAML: {reason}") from None
    if not isinstance(data, dict):
        raise error(f"{source} holds {type(data).__name__}; expected a mapping at the top level")
    return data
