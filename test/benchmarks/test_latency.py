"""benchmarks/latency.py on a few frames: every part gives its rows, and the timed code is that of the tracker."""

import json
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks import latency, solvers
from benchmarks.against import BODY, LAYOUT
from benchmarks.data.motion import load_motion, on_skeleton
from benchmarks.latency import PEOPLE, Run, interleaved, main
from benchmarks.methods.robot_ik import available
from benchmarks.timing.stages import STAGES, profile
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.lasso import solver
from lassokin_ros.core.tracker import Tracker

MOTION = load_motion(Path("no such folder"), 12)
LONGER_S = 0.02


def test_a_skeleton_with_both_hands_has_55_joints_and_65_landmarks():
    hands = Skeleton.load(str(BODY), 1.75)
    assert on_skeleton(MOTION, hands).rotations.shape == (12, 55, 3, 3)
    assert len(Layout.load(str(LAYOUT), hands).names) == 65
    assert np.allclose(hands.rest_positions.mean(0)[0], 0, atol=1e-12)  # left and right mirror each other


def test_profile_times_every_stage_and_restores_the_tracker():
    certify = solver.certify
    records = {r["what"]: r for r in profile(Run(MOTION).tracker, Run(MOTION).observations, MOTION)}
    assert solver.certify is certify
    assert "whole core step" in records and set(records) <= {*STAGES, "whole core step"}
    assert 0 < records["solve"]["p50_us"] < records["whole core step"]["p50_us"]


def test_interleaved_counts_frames_and_computes_ratios():
    order = []

    def step(name, work):
        def run(frame):
            order.append(name)
            sum(range(work))
            return frame > 0

        return run

    records = interleaved({"short": step("short", 100), "long": step("long", 100_000)}, 4)
    assert order == ["short", "long", "long", "short"] * 2
    assert [r["frames"] for r in records] == [3, 3] and records[0]["ratio"] == 1 and records[1]["ratio"] > 5


@pytest.mark.parametrize(
    "command, option",
    [(latency.main, o) for o in ("--frames=0", "--frames=9", "--frames=x", "--parts=core,cores", "--parts=")]
    + [(solvers.main, o) for o in ("--problems=0", "--kinds=foo", "--tolerance=nan", "--tolerance=0", "--seed=-1")],
)
def test_invalid_options_are_refused_by_name(command, option, capsys):
    with pytest.raises(SystemExit) as end:
        command([option])
    said = capsys.readouterr().err
    assert end.value.code == 2 and f"argument {option.split('=')[0]}: " in said and "; expected " in said


def test_the_command_line_prints_every_part(tmp_path, capsys):
    file = tmp_path / "records.json"
    options = ["--data", str(tmp_path), "--frames", "12", "--parts", "core,people,peers", "--json", str(file)]
    assert main(options) == 0
    records = json.loads(file.read_text(encoding="utf-8"))
    by_part = {part: [r["what"] for r in records if r["part"] == part] for part in ("people", "peers")}
    assert len(by_part["people"]) == len(PEOPLE)
    assert by_part["peers"] == ["tracker step", *available()]
    assert all(0 < r["p50_us"] <= r["p95_us"] <= r["p99_us"] for r in records)
    assert "synthetic motion" in capsys.readouterr().out


def test_callback_stages_are_timed(tmp_path, monkeypatch):
    """With rclpy the real node's callback on real DDS, without it serialised messages.

    The tracker's step is made longer by a known time. The callback contains it, and what is beyond the step does not.
    """
    pytest.importorskip("rosbags")
    track = Tracker.track
    monkeypatch.setattr(Tracker, "track", lambda *given: (time.sleep(LONGER_S), track(*given))[1])
    file = tmp_path / "records.json"
    assert main(["--data", str(tmp_path), "--frames", "10", "--parts", "callback", "--json", str(file)]) == 0
    times = {r["what"]: r["p50_us"] for r in json.loads(file.read_text(encoding="utf-8"))}
    assert {"decode", "undistort", "encode joint_states", "publish joint_states"} <= set(times)
    for what, beyond in times.items():
        if what.startswith("beyond the tracker's step, "):
            whole = times[what.replace("beyond the tracker's step", "whole callback")]
            assert 0 < beyond <= whole - 0.99e6 * LONGER_S
