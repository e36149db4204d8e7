"""Read ROS parameter files and `-p name:=value` arguments into settings, without ROS."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import Field, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from lassokin_ros.core.config import TrackerConfig, without_bool
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.yaml_files import load_mapping, load_value, read_text
from lassokin_ros.pipeline.settings import NodeSettings

NODE_NAME = "tracker"
IGNORED = ("use_sim_time", "qos_overrides", "start_type_description_service")
"""Parameters that every node has. They have no effect without ROS."""


def offline_settings(
    files: Sequence[Path],
    assignments: Sequence[str],
    defaults: Mapping[str, Any] | None = None,
    node: str = NODE_NAME,
) -> tuple[TrackerConfig, NodeSettings]:
    """Return the settings from parameter files and assignments "name:=value". Later values override earlier ones.

    defaults: values by name that replace those of the settings' fields. node: see `file_parameters`.

    Raises ConfigurationError for an unreadable or malformed file, an unknown parameter, and a value of the wrong type
    or out of range.
    """
    values: dict[str, Any] = dict(defaults or {})
    for file in files:
        values.update(file_parameters(file, node))
    for assignment in assignments:
        name, separator, text = assignment.partition(":=")
        if not separator or not name:
            raise ConfigurationError(f"-p {assignment!r}; expected name:=value, such as height:=1.80")
        values[name] = _value(name, text)
    return _applied(TrackerConfig(), values).checked(), _applied(NodeSettings(), values).checked()


def file_parameters(file: Path, node: str = NODE_NAME) -> dict[str, Any]:
    """Return the parameters of this node from a ROS parameter file: under `/**` or a name ending in `tracker`.

    node: name with the namespace, such as left/tracker; it chooses if the file has several trackers. Raises
    ConfigurationError.
    """
    data = load_mapping(read_text(file, ConfigurationError), str(file), ConfigurationError)
    mine = [key for key in data if str(key) == "/**" or str(key).split("/")[-1] == NODE_NAME]
    if not mine:
        raise ConfigurationError(
            f"{file} has parameters for {', '.join(map(str, data)) or 'no node'}; expected '{NODE_NAME}' or '/**' at "
            "the top level, and ros__parameters below it"
        )
    named = [key for key in mine if "*" not in str(key)]
    if len(named) > 1:
        others = [key for key in named if str(key).strip("/") != node.strip("/")]
        if others == named:
            raise ConfigurationError(
                f"{file} has parameters for several trackers: {', '.join(named)}; expected those of one, or of "
                f"'{node}'; remove the others from a copy of the file, or launch the tracker in the namespace of one"
            )
        mine = [key for key in mine if key not in others]
    values: dict[str, Any] = {}
    for key in mine:
        parameters = data[key].get("ros__parameters") if isinstance(data[key], Mapping) else None
        if not isinstance(parameters, Mapping):
            raise ConfigurationError(f"{file} has no mapping 'ros__parameters' under '{key}'")
        values.update({str(name): value for name, value in parameters.items()})
    for name in values:
        _check_name(name, str(file))
    return values


def _value(name: str, text: str) -> Any:
    """Parse a value as YAML, as rcl does."""
    _check_name(name, "-p")
    return load_value(text, f"-p {name}:={text[:40]}", ConfigurationError)


def _check_name(name: str, source: str) -> None:
    """Raise ConfigurationError if the parameter does not exist."""
    known = [item.name for item in all_settings()]
    if name in known or name.split(".")[0] in IGNORED:
        return
    close = get_close_matches(name, known, 1)
    hint = f"did you mean '{close[0]}'?" if close else f"expected one of: {', '.join(known)}"
    raise ConfigurationError(f"{source}: there is no parameter '{name}'; {hint}")


def all_settings() -> list[Field]:
    """Return all settings that are parameters, in the order of config/tracker.yaml and of the reference."""
    return [*fields(TrackerConfig), *fields(NodeSettings)]


def _float(value: int) -> float:
    """Return a whole number as float; one with hundreds of digits as infinite, which no range contains."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _applied(config: Any, values: Mapping[str, Any]) -> Any:
    changes = {}
    for item in fields(config):
        if item.name in values:
            value = without_bool(values[item.name], item.metadata)
            whole = isinstance(value, int) and not isinstance(value, bool)
            changes[item.name] = _float(value) if isinstance(item.default, float) and whole else value
    return replace(config, **changes)
