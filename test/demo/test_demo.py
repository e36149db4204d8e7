"""The demo for a few seconds of motion: its limits hold, its files exist, and errors are reported."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="the demo needs rclpy")
pytest.importorskip("rosbags", reason="the demo needs rosbags")

from recordings import FRAME_TOPICS, read  # noqa: E402

from lassokin_ros.demo.demo import RATE, main, run, table  # noqa: E402
from lassokin_ros.demo.result import LIMITS  # noqa: E402
from lassokin_ros.replay.bags import BagReader  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 4


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run(tmp_path_factory.mktemp("demo"), SECONDS, rate=2.0)


def latencies_not_kept(said):
    """In the demo's last lines: the latency limits, which a machine that runs other tests may exceed."""
    words = said.splitlines()[-1].removeprefix("outside the limits: ").split(", ")
    return [name for name in words if name in ("latency p50", "latency p99")]


def test_the_command_keeps_its_limits_and_writes_its_files(tmp_path):
    command = [sys.executable, "-m", "lassokin_ros.demo", "--output", str(tmp_path / "out"), "--seconds", str(SECONDS)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    print(done.stdout, done.stderr)
    late = latencies_not_kept(done.stderr)
    assert done.returncode == (1 if late else 0), done.stderr
    frames = round(SECONDS * RATE)
    assert f"frames: {frames} in, {frames} out, 0 rejected" in done.stdout
    assert done.stdout.count("FAILED") == len(late)
    assert f"{frames}/{frames} frames" in done.stderr  # progress, in a few lines without a terminal
    for name in LIMITS:
        assert name in done.stdout
    assert sorted(os.listdir(tmp_path / "out")) == ["keypoints", "report.html", "skeleton.svg", "tracked"]
    assert "report.html" in done.stdout
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert f"{frames} ({1:.1%})" in page and "nothing suggests a wrong pose" in page
    picture = ElementTree.parse(tmp_path / "out" / "skeleton.svg").getroot()
    plots = [group for group in picture if group.tag.endswith("}g")]
    assert len(plots) == 3 * 6 + 2
    with BagReader(tmp_path / "out" / "tracked") as bag:
        counts = {topic.name: topic.count for topic in bag.topics}
    assert all(counts[topic] == frames for topic in FRAME_TOPICS)
    assert counts["/tracker/robot_description"] >= 1 and counts["/diagnostics"] >= 2
    inputs, outputs = (
        read(tmp_path / "out" / bag, topic)
        for bag, topic in (("keypoints", "/keypoints"), ("tracked", "/tracker/joints"))
    )
    delays = [(b - a) * 1e-9 for (a, _), (b, _) in zip(inputs, outputs)]
    assert -0.001 < min(delays) and (late or np.median(delays) < 0.1)  # recorded at the time of the playback


def test_the_result_is_compared_with_the_motion_frame_by_frame(result):
    assert result.frames_in == len(result.times) == round(SECONDS * RATE)
    assert np.allclose(result.times, np.arange(len(result.times)) / RATE, atol=1e-9)
    assert result.estimate.shape == result.truth.shape == (len(result.times), 24, 3)
    assert result.error_mm.shape == (len(result.times),) and result.state == "tracking"
    exact = replace(result, estimate=result.truth)
    assert exact.error_mm.max() == 0 and exact.root_error_mm.max() == 0
    moved = replace(result, estimate=result.truth + [0.03, 0.0, 0.04])
    assert moved.error_mm.max() < 1e-9 and np.allclose(moved.root_error_mm, 50)


def test_every_exceeded_limit_is_reported(result):
    kept = replace(result, latencies_ms=np.full(5, 1.0))
    assert kept.exceeded_limits() == [] and "FAILED" not in table(kept)
    far = result.truth + np.arange(24)[None, :, None] * 0.05
    for broken, names in (
        (replace(kept, estimate=far), ["joint error, median", "joint error, mean"]),
        (replace(kept, latencies_ms=np.full(5, 1000.0)), ["latency p50", "latency p99"]),
        (replace(kept, rejected=50), ["rejected"]),
        (replace(kept, frames_in=10_000), ["frames out"]),
        (replace(kept, state="lost"), ["tracking state"]),
        (replace(kept, reprojection_px=np.full(5, np.nan)), ["reprojection error, median"]),
    ):
        assert broken.exceeded_limits() == names
        assert table(broken).count("FAILED") == len(names)


def children_of(pid):
    """The command lines of a process' children, by their ids."""
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii")
    return {child: Path(f"/proc/{child}/cmdline").read_bytes() for child in text.split()}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["int", "term"])
def test_an_interrupted_demo_prints_one_line_and_leaves_no_node(tmp_path, number):
    command = [sys.executable, "-m", "lassokin_ros.demo", "--output", str(tmp_path / "out"), "--seconds", "60"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as demo:
        deadline, nodes = time.monotonic() + 60, {}
        while not any(b"lassokin_ros.node.command" in line for line in nodes.values()):
            assert demo.poll() is None and time.monotonic() < deadline, "no node was started"
            nodes = children_of(demo.pid)
        demo.send_signal(number)
        said = demo.communicate(timeout=60)[1].splitlines()
    assert demo.returncode == 130 and said[-1].startswith("demo: interrupted; "), said
    assert not any("Traceback" in line for line in said)
    assert not any(Path(f"/proc/{child}").exists() for child in nodes)


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf", "long"])
def test_an_invalid_duration_is_refused_with_the_expected_range(seconds, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--output", str(tmp_path / "out"), "--seconds", seconds])
    assert ended.value.code == 2 and f"--seconds: {seconds}; expected 1 to 3600 s" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_unwritable_output_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    command = [sys.executable, "-m", "lassokin_ros.demo", "--output", str(tmp_path / "file"), "--seconds", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2 and done.stderr.startswith("demo: ") and done.stderr.count("\n") == 1


def test_a_home_that_cannot_be_written_is_one_line_with_the_remedy(tmp_path):
    """ROS writes its logs there."""
    environment = {k: v for k, v in os.environ.items() if k not in ("ROS_LOG_DIR", "ROS_HOME")}
    command = [sys.executable, "-m", "lassokin_ros.demo", "--output", str(tmp_path / "out"), "--seconds", "1"]
    environment["HOME"] = "/proc/nowhere"
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, env=environment, check=False)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("demo: ") and "set ROS_LOG_DIR" in done.stderr
