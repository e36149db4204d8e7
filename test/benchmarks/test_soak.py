"""benchmarks/soak.py for seconds instead of hours: the counts add up, and the limits can fail."""

import json
import subprocess
import sys

import numpy as np
import pytest

from benchmarks import soak
from benchmarks.timing import live_load, usage
from benchmarks.timing.usage import Limits, Usage
from lassokin_ros.pipeline.keypoint_queue import OVERTAKEN


def test_the_core_does_not_grow(capsys, tmp_path):
    file = tmp_path / "soak.json"
    soak.main(["--hours", str(240 / soak.HZ / 3600), "--json", str(file)])
    rows = {record["what"]: record for record in json.loads(file.read_text())}
    assert rows["frames"]["end"] == rows["frames, accepted"]["end"] == "240"
    assert rows["largest element of R^T R - 1"]["holds"] == "yes"
    assert "file descriptors" in capsys.readouterr().out


def test_wrong_rotations_and_values_that_are_not_finite_are_detected():
    turn = np.eye(3)[None]
    assert soak._deviation(turn, np.zeros(6)) == 0
    assert soak._deviation(1.001 * turn, np.zeros(6)) > soak.LARGEST_DEVIATION
    assert soak._deviation(turn, np.array([np.nan])) == float("inf")


def test_growth_is_detected():
    before, after = Usage(100.0, 10, 3, 1.0), Usage(100.0 + 2 * usage.MOST_GROWTH_MB, 11, 3, 2.0)
    assert [record["holds"] for record in soak.usage_rows(before, after)] == ["NO", "NO", "yes", ""]


def test_the_real_node_passes_two_seconds(monkeypatch, clock_hz=200.0):
    pytest.importorskip("rclpy")
    monkeypatch.setattr(live_load, "WARM_UP_S", 1.0)
    monkeypatch.setattr(live_load, "STEPS", 20)
    rows = {record["what"]: record for record in live_load.soak_live(2.0, 1, 30.0, clock_hz)}
    assert rows["messages sent"]["end"] == rows["messages received"]["end"] == "60"
    assert rows["messages neither received nor counted"]["end"] == "0"
    late = int(rows.get(f"messages {OVERTAKEN}", {"end": 0})["end"])  # on a machine that is busy with other work
    assert late < 60 and int(rows["messages answered for everybody"]["end"]) + late >= 50
    assert rows["exit code at SIGINT, lines on stderr"]["end"].startswith("0,")


def test_limits_hold_in_a_process_that_is_started_with_them():
    code = "import resource as r; print(r.getrlimit(r.RLIMIT_AS), r.getrlimit(r.RLIMIT_NOFILE))"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, preexec_fn=Limits(800, 20).apply, capture_output=True, text=True, check=True)
    assert done.stdout == f"{(800 << 20, 800 << 20)} {(20, 20)}\n"
