"""imitate.launch.py: what it starts, with recording replacements of `launch`."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from test_webcam_launch import ROOT, load, webcam  # noqa: F401
from toy_robot import urdf


def started(module, **given):
    *arguments, function = module.generate_launch_description().args[0]
    defaults = {a.args[0]: a.default_value for a in arguments if hasattr(a, "default_value")}
    assert {a.args[0] for a in arguments} - set(defaults) == {"robot", "urdf"}  # which must be given
    return function.function(SimpleNamespace(launch_configurations={**defaults, **given}))


def test_it_starts_the_tracker_the_robot_and_its_model(webcam, tmp_path):  # noqa: F811
    module, path = load("imitate"), tmp_path / "toy.urdf"
    path.write_text(urdf())
    tracker, imitate, shown = started(module, robot="g1", urdf=str(path), free_base="true")
    assert Path(tracker.args[0].args[0]).samefile(ROOT / "launch" / "tracker.launch.py")
    (parameters,) = imitate.parameters
    assert imitate.executable == "imitate" and parameters["robot"] == "g1" and parameters["free_base"] is True
    assert ("joint_states", "joint_commands") in shown.remappings
    assert len(started(module, robot="g1", urdf=str(path), robot_model="false")) == 2


def test_a_urdf_that_is_not_there_is_said(webcam, tmp_path):  # noqa: F811
    with pytest.raises(RuntimeError, match="expected the path of the robot's URDF"):
        started(load("imitate"), robot="g1", urdf=str(tmp_path / "none.urdf"))
