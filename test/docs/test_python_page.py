"""docs/python.md: the table of an estimate's fields is complete, and the example is the file's and runs."""

import re
import runpy
import struct
import subprocess
import sys
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from recordings import beginning_of

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
    computed = [name for name, value in vars(Estimate).items() if isinstance(value, property) and name != "accepted"]
    assert named_in("The fields of an estimate") == sorted(computed + [field.name for field in fields(Estimate)])


def test_every_field_of_the_uncertainty_is_in_the_table():
    computed = [name for name, value in vars(JointUncertainty).items() if isinstance(value, cached_property)]
    assert named_in("The uncertainty of an estimate") == sorted(computed)


def test_the_example_is_that_of_the_page_and_is_short():
    code = EXAMPLE.read_text(encoding="utf-8").partition("make_detector\n\n")[2]
    assert re.sub("^", "    ", code.rstrip(), flags=re.MULTILINE) in PAGE
    assert len(code.splitlines()) == 14


def test_the_example_turns_the_video_of_a_phone(tmp_path, monkeypatch):
    """By the file's metadata, also with OpenCV 4.11, which does not do it by default."""
    cv2, shapes = pytest.importorskip("cv2"), []
    real = cv2.VideoCapture

    def unturned(name):
        capture = real(name)
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        return capture

    file = tmp_path / "phone.mp4"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (160, 96))
    writer.write(np.zeros((96, 160, 3), np.uint8))
    writer.release()
    data = bytearray(file.read_bytes())
    place = data.index(b"tkhd") + 44  # the track's transformation, ISO 14496-12
    data[place : place + 36] = struct.pack(">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, 96 << 16, 0, 1 << 30)
    file.write_bytes(data)
    detector = SimpleNamespace(detect=lambda image, _: shapes.append(image.shape) or [], close=lambda: None)
    monkeypatch.setattr("lassokin_ros.detector.backend.make_detector", lambda name: detector)
    monkeypatch.setattr(cv2, "VideoCapture", unturned)
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), str(file), "1.7"])
    runpy.run_path(str(EXAMPLE))
    assert shapes == [(160, 96, 3)]


def test_the_example_runs(tmp_path):
    pytest.importorskip("mediapipe", reason="the example is for MediaPipe")
    video = beginning_of(ROOT / "examples" / "balancing.mp4", tmp_path / "sample.mp4", 12)
    command = [sys.executable, EXAMPLE, video, "1.72"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=300)
    lines = [line for line in done.stdout.splitlines() if re.match(r"\d\.\d\d s \[", line)]
    assert done.returncode == 0 and len(lines) > 10, done.stderr[-300:]


def test_the_session_of_the_page_tells_people_apart(capsys):
    (code,) = [block for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "Session(" in block]
    exec(compile(code, "docs/python.md", "exec"), {})
    said = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in said} == {"p1", "p2"} and len(said) > 50
