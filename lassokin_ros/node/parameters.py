"""ROS parameters from the dataclasses of settings: declaration, checks, and output as YAML and as a table.

Names, defaults, descriptions, units and ranges are defined only in core/config.py and pipeline/settings.py.
`python3 -m lassokin_ros.node.parameters` prints config/tracker.yaml; with `--table` it prints the table of
docs/reference.md.
"""

from __future__ import annotations

import sys
from dataclasses import Field, fields, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Callable, Sequence

from lassokin_ros.core.config import TrackerConfig, without_bool
from lassokin_ros.core.errors import ConfigurationError, LassokinError
from lassokin_ros.pipeline.parameter_files import all_settings
from lassokin_ros.pipeline.settings import NodeSettings

if TYPE_CHECKING:
    from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
    from rclpy.node import Node
    from rclpy.parameter import Parameter

Settings = tuple[TrackerConfig, NodeSettings]
MISSPELT = 0.8
"""Similarity (difflib) from which on an unknown name is a misspelt one."""
ROS_TYPES = {float: "double", int: "integer", bool: "bool", str: "string", tuple: "string array"}


def describe(item: Field) -> ParameterDescriptor:
    """The parameter descriptor of one setting: description, unit, range, choices; read-only unless live."""
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    facts = item.metadata
    descriptor = ParameterDescriptor(name=item.name, description=facts["description"], read_only=not facts["live"])
    if facts["unit"]:
        descriptor.description += f" [{facts['unit']}]"
    if facts["choices"]:
        descriptor.additional_constraints = f"one of: {', '.join(facts['choices'])}"
    if facts["low"] is not None:
        low, high = facts["low"], facts["high"]
        if isinstance(item.default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return descriptor


def declare(node: Node) -> Settings:
    """Declare all settings on the node and return them with the values given at start.

    Raises ConfigurationError for a value of the wrong type or out of its range, and for a misspelt name.
    """
    _refuse_misspelt(node)
    tracker = _declared(node, TrackerConfig())
    settings = NodeSettings()
    return tracker.checked(), _declared(node, settings).checked()


def _declared(node: Node, config: Any) -> Any:
    from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException

    values = {}
    for item in fields(config):
        given = getattr(node, "_parameter_overrides", {}).get(item.name)
        if given is not None and (value := without_bool(given.value, item.metadata)) != given.value:
            node._parameter_overrides[item.name] = type(given)(item.name, value=value)
        if given is not None and given.value is None and isinstance(item.default, tuple):
            del node._parameter_overrides[item.name]  # an empty list in a file: ROS knows no type of its elements
        try:
            default = list(item.default) if isinstance(item.default, tuple) else item.default
            values[item.name] = node.declare_parameter(item.name, default, describe(item)).value
        except (InvalidParameterTypeException, InvalidParameterValueException):
            kind = ROS_TYPES[type(item.default)]
            hint = " (written with a decimal point)" if kind == "double" else ""
            raise ConfigurationError(
                f"parameter '{item.name}' is {given.value if given else 'wrong'!r}; expected "
                f"{_range(item) or 'a value'}, of type {kind}{hint}"
            ) from None
    return replace(config, **values)


def _refuse_misspelt(node: Node) -> None:
    """Raise ConfigurationError for a parameter given at start whose name is nearly one of the settings."""
    known = [item.name for item in all_settings()]
    for name in getattr(node, "_parameter_overrides", {}):
        close = [] if name in known or node.has_parameter(name) else get_close_matches(name, known, 1, MISSPELT)
        if close:
            raise ConfigurationError(
                f"there is no parameter '{name}'; did you mean '{close[0]}'? If it is another node's, give it under "
                "the name of that node in place of /**"
            )


def unknown_parameters(node: Node) -> list[str]:
    """One line for each parameter given at start that the node does not have. It may be another node's."""
    given = getattr(node, "_parameter_overrides", {})
    unknown = [name for name in given if not node.has_parameter(name) and not _overrides_another_topic(node, name)]
    return [f"there is no parameter '{name}'" for name in unknown]


def _overrides_another_topic(node: Node, name: str) -> bool:
    """True for a QoS override of another node's topic, as in a file for several nodes."""
    topic, _, _ = name.rpartition(".")
    return name.startswith("qos_overrides.") and not node.get_parameters_by_prefix(topic)


def changes_of(node: Node, parameters: Sequence[Parameter]) -> list[Parameter]:
    """Return the parameters of a request without those that are read-only and would keep their value.

    rclpy refuses a read-only parameter even with its present value, so that `ros2 param load` of what `ros2 param dump`
    has written would fail. `off`, which that command reads as false, becomes a string again.
    """
    metadata = {item.name: item.metadata for item in all_settings()}
    changes = []
    for parameter in parameters:
        if parameter.name in metadata:
            value = without_bool(parameter.value, metadata[parameter.name])
            parameter = parameter if value == parameter.value else type(parameter)(parameter.name, value=value)
        if not _keeps_its_value(node, parameter):
            changes.append(parameter)
    return changes


def _keeps_its_value(node: Node, parameter: Parameter) -> bool:
    if not node.has_parameter(parameter.name) or not node.describe_parameter(parameter.name).read_only:
        return False
    present = node.get_parameter(parameter.name)
    return bool(present.type_ == parameter.type_ and present.value == parameter.value)


class LiveParameters:
    """Applies changes of live settings. A request is applied completely or not at all."""

    def __init__(self, node: Node, settings: Settings, on_change: Callable[[Settings], None]) -> None:
        """on_change: called with the new settings after each change that was accepted."""
        self.settings = settings
        self._on_change = on_change
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        from rcl_interfaces.msg import SetParametersResult

        try:
            self._changed(parameters)
        except (LassokinError, TypeError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        self.settings = self._changed(parameters)
        self._on_change(self.settings)

    def _changed(self, parameters: Sequence[Parameter]) -> Settings:
        tracker, node = self.settings
        tracker, node = _with_values(tracker, parameters).checked(), _with_values(node, parameters).checked()
        node.check_with(tracker)
        return tracker, node


def _with_values(config: Any, parameters: Sequence[Parameter]) -> Any:
    names = {item.name for item in fields(config)}
    return replace(config, **{p.name: p.value for p in parameters if p.name in names})


def parameter_file() -> str:
    """The text of config/tracker.yaml: all parameters with defaults and comments."""
    lines = [
        "# Every parameter of the tracker with its default. Made by `python3 -m lassokin_ros.node.parameters`.",
        "# (live) may be changed while the node runs, the others are read-only.",
        "/**:",
        "  ros__parameters:",
    ]
    for item in all_settings():
        facts = [_range(item), "live" if item.metadata["live"] else ""]
        remark = "; ".join(fact for fact in facts if fact)
        lines.append(f"    # {item.metadata['description']}" + (f" ({remark})" if remark else ""))
        lines.append(f"    {item.name}: {_yaml(item.default)}")
    return "\n".join(lines) + "\n"


def parameter_table() -> str:
    """The table of parameters of docs/reference.md, in Markdown."""
    lines = ["| parameter | default | unit | range | live | meaning |", "|---|---|---|---|---|---|"]
    for item in all_settings():
        facts = item.metadata
        live = "yes" if facts["live"] else ""
        unit = facts["unit"]
        limits = _range(item).removesuffix(f" {unit}") if unit else _range(item)
        lines.append(f"| `{item.name}` | {_yaml(item.default)} | {unit} | {limits} | {live} | {facts['description']} |")
    return "\n".join(lines) + "\n"


def _range(item: Field) -> str:
    facts = item.metadata
    if facts["choices"]:
        return f"one of: {', '.join(facts['choices'])}"
    return "" if facts["low"] is None else f"{facts['low']:g} to {facts['high']:g} {facts['unit']}".rstrip()


def _yaml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_yaml, value))}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


if __name__ == "__main__":
    sys.stdout.write(parameter_table() if "--table" in sys.argv[1:] else parameter_file())
