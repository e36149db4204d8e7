"""Parameters have one source: the parameter file, the table and the node are generated from it."""

from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.node.parameters import describe, parameter_file, parameter_table
from lassokin_ros.pipeline.parameter_files import all_settings
from lassokin_ros.pipeline.settings import NodeSettings

ROOT = Path(__file__).resolve().parents[2]


def test_parameter_names_are_unique_and_described():
    names = [item.name for item in all_settings()]
    assert len(set(names)) == len(names)
    assert all(item.metadata["description"] for item in all_settings())


def test_defaults_are_in_their_ranges():
    TrackerConfig().checked()
    NodeSettings().checked()


def test_the_parameter_file_is_up_to_date():
    text = (ROOT / "config" / "tracker.yaml").read_text(encoding="utf-8")
    assert text == parameter_file(), "run: python3 -m lassokin_ros.node.parameters > config/tracker.yaml"
    values = yaml.safe_load(text)["/**"]["ros__parameters"]
    defaults = {i.name: list(i.default) if isinstance(i.default, tuple) else i.default for i in all_settings()}
    assert values == defaults
    assert [type(value) for value in values.values()] == [type(default) for default in defaults.values()]


def test_the_reference_contains_the_table():
    files = [file for file in (ROOT / "README.md", ROOT / "docs" / "reference.md") if file.is_file()]
    if not files:
        pytest.skip("there is no documentation in this tree")
    text = "".join(file.read_text(encoding="utf-8") for file in files)
    table = parameter_table()
    assert len(table.splitlines()) == 2 + len(list(all_settings()))
    assert table in text, "put in the output of: python3 -m lassokin_ros.node.parameters --table"


def test_a_descriptor_has_unit_range_and_whether_the_parameter_is_live():
    pytest.importorskip("rcl_interfaces")
    for item in all_settings():
        facts, told = item.metadata, describe(item)
        unit = f" [{facts['unit']}]" if facts["unit"] else ""
        assert (told.description, told.read_only) == (facts["description"] + unit, not facts["live"])
        ranges = [(one.from_value, one.to_value) for one in (*told.floating_point_range, *told.integer_range)]
        assert ranges == ([] if facts["low"] is None else [(facts["low"], facts["high"])])


@pytest.mark.parametrize("prefix", ["/human/", "my human/", "\t"])
def test_a_prefix_that_tf2_refuses_is_refused(prefix):
    with pytest.raises(ConfigurationError, match="frame_prefix"):
        NodeSettings(frame_prefix=prefix).checked()
    assert NodeSettings(frame_prefix="").checked()


@pytest.mark.parametrize("item", fields(NodeSettings), ids=lambda item: item.name)
def test_values_out_of_range_are_refused(item):
    wrong = "sensor_msgs/msg/Image" if isinstance(item.default, str) else "no"
    if item.name in ("depth", "fixed_frame", "frame_prefix"):
        wrong = 3
    with pytest.raises(ConfigurationError, match=item.name):
        NodeSettings(**{item.name: wrong}).checked()
    if item.metadata["high"] is not None:
        with pytest.raises(ConfigurationError, match=item.name):
            NodeSettings(**{item.name: type(item.default)(item.metadata["high"] + 1)}).checked()
