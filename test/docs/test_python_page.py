"""docs/python.md: the table of an estimate's fields is complete, and the example is the file's and runs."""

import os
import re
import subprocess
import sys
from dataclasses import fields
from functools import cached_property
from pathlib import Path

import pytest

from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.output.uncertainty import JointUncertainty

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "examples" / "from_mediapipe.py"


def named_in(section):
    """Names of the fields in the table of a section of the page."""
    (text,) = re.findall(rf"^## {section}\n(.*?)^## ", PAGE, re.MULTILINE | re.DOTALL)
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \|", text, re.MULTILINE)
    return sorted(name.strip("`") for row in rows for name in row.split(", "))


def test_every_field_of_an_estimate_is_in_the_table():
    assert named_in("The fields of an estimate") == sorted(field.name for field in fields(Estimate))


def test_every_field_of_the_uncertainty_is_in_the_table():
    computed = [name for name, value in vars(JointUncertainty).items() if isinstance(value, cached_property)]
    stored = [field.name for field in fields(JointUncertainty) if field.name != "posterior"]
    assert named_in("The uncertainty of an estimate") == sorted(computed + stored)


def test_the_example_is_that_of_the_page_and_has_twelve_lines():
    code = EXAMPLE.read_text(encoding="utf-8").partition("TrackerConfig\n\n")[2]
    assert re.sub("^", "    ", code.rstrip(), flags=re.MULTILINE) in PAGE
    assert len(code.splitlines()) == 12


def test_the_example_runs():
    pytest.importorskip("mediapipe", reason="the example is for MediaPipe")
    video = Path(os.environ.get("LASSOKIN_DATA", "none")) / "video" / "balancing_cam03.mp4"
    if not video.is_file():
        pytest.skip("LASSOKIN_DATA has no video")
    done = subprocess.run(
        [sys.executable, EXAMPLE, video, "1.64"], capture_output=True, text=True, cwd=ROOT, timeout=300
    )
    lines = [line for line in done.stdout.splitlines() if re.match(r"\d\.\d\d s \[", line)]
    assert done.returncode == 0 and len(lines) > 90, done.stderr[-300:]
