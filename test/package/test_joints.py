"""The public joint indices are those of the built-in skeleton, and the module imports nothing."""

import re
import subprocess
import sys
from pathlib import Path

from lassokin_ros import joints
from lassokin_ros.core.body.skeleton import Skeleton


def test_constants_and_names_are_those_of_the_skeleton():
    skeleton = Skeleton.load("anthropometric", 1.75)
    assert joints.NAMES == tuple(skeleton.joint_names)
    assert [joints.INDEX[name] for name in skeleton.joint_names] == list(range(24))
    assert [getattr(joints, name.upper()) for name in skeleton.joint_names] == list(range(24))


def test_the_table_of_joints_is_that_of_the_module():
    text = (Path(__file__).resolve().parents[2] / "docs" / "reference.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"(?m)^\| index \| [^|]+ \| index .*\n\|[-|]+\n((?:\|.*\n)+)", text)
    pairs = re.findall(r"\| (\d+) \| `?(\w+)`? (?=\|)", table)
    assert len(pairs) == 24 and {name: int(index) for index, name in pairs} == joints.INDEX


def test_the_reference_names_the_order_of_each_joints_axes():
    text = (Path(__file__).resolve().parents[2] / "docs" / "reference.md").read_text(encoding="utf-8")
    rows = re.findall(r"(?m)^\| ([xyz]), ([xyz]), ([xyz]) \| ([^|]+) \|$", text)
    named = {part: "".join(axes) for *axes, parts in rows for part in parts.split(", ")}
    skeleton, orders = Skeleton.load("anthropometric", 1.75), {}
    for name, axes in zip(skeleton.joint_names, skeleton.axes):
        part = name.rpartition("_")[2]
        orders[part if part in named else {"foot": "feet"}.get(part, f"{part}s")] = axes
    assert named == orders and len(named) == 15


def test_the_module_imports_nothing():
    code = "import sys, lassokin_ros.joints; assert 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
