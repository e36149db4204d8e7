"""The demo for a few seconds of motion: its limits hold, its files exist, and errors are reported."""

import os
import re
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

from live import stamp_of  # noqa: E402
from recordings import FRAME_TOPICS, read  # noqa: E402

from lassokin_ros.demo.demo import (  # noqa: E402
    BIAS,
    NOISE,
    OCCLUDED,
    RATE,
    main,
    run,
    scene,
    show,
    track,
    with_depth,
    with_second_camera,
)
from lassokin_ros.demo.live_playback import LiveNode  # noqa: E402
from lassokin_ros.demo.result import LIMITS, slow_line, table  # noqa: E402
from lassokin_ros.demo.synthetic import DISTANCE  # noqa: E402
from lassokin_ros.replay.bags import BagReader  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 4


def command(output, seconds, **environment):
    """The demo as a process."""
    words = [sys.executable, "-m", "lassokin_ros.demo.demo", "--output", str(output), "--seconds", str(seconds)]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False, **environment)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run(tmp_path_factory.mktemp("demo"), SECONDS, rate=2.0)


def test_the_command_keeps_its_limits_and_writes_its_files(tmp_path):
    command = [
        sys.executable,
        "-m",
        "lassokin_ros.demo.demo",
        "--output",
        str(tmp_path / "out"),
        "--seconds",
        str(SECONDS),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    print(done.stdout, done.stderr)
    assert done.returncode == 0 and "FAILED" not in done.stdout, done.stderr
    slow = done.stdout.count("   SLOW")  # on a machine that also runs other tests
    assert ("This machine is slow or busy" in done.stdout) == (slow > 0)
    frames = round(SECONDS * RATE)
    came, answered, rejected, overtaken = map(
        int, re.search(r"frames: (\d+) in, (\d+) out, (\d+) rejected, (\d+) overtaken", done.stdout).groups()
    )
    assert (came, answered, rejected) == (frames, frames - overtaken, 0) and (slow or not overtaken)
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
    assert all(counts[topic] == answered for topic in FRAME_TOPICS)
    assert counts["/tracker/robot_description"] >= 1 and counts["/diagnostics"] >= 2
    inputs, outputs = (
        read(tmp_path / "out" / bag, topic)
        for bag, topic in (("keypoints", "/keypoints"), ("tracked", "/tracker/joints"))
    )
    sent = {stamp_of(message): at for at, message in inputs}
    delays = [(at - sent[stamp_of(message)]) * 1e-9 for at, message in outputs]
    assert -0.001 < min(delays) and (slow or np.median(delays) < 0.1)  # recorded at the time of the playback


def test_the_result_is_compared_with_the_motion_frame_by_frame(result):
    assert result.frames_in == len(result.times) + result.overtaken == round(SECONDS * RATE)
    frames = result.times * RATE  # some may be overtaken on a busy machine
    assert np.allclose(frames, np.round(frames), atol=1e-6) and (np.diff(frames) > 0.5).all()
    assert frames[0] >= 0 and frames[-1] < result.frames_in
    assert result.estimate.shape == result.truth.shape == (len(result.times), 24, 3)
    assert result.error_mm.shape == (len(result.times),) and result.state == "tracking"
    exact = replace(result, estimate=result.truth)
    assert exact.error_mm.max() == 0 and exact.root_error_mm.max() == 0
    moved = replace(result, estimate=result.truth + [0.03, 0.0, 0.04])
    assert moved.error_mm.max() < 1e-9 and np.allclose(moved.root_error_mm, 50)


@pytest.fixture
def kept(result):
    """The result on a fast machine."""
    return replace(result, latencies_ms=np.full(5, 1.0), frames_in=len(result.times), overtaken=0)


def test_every_exceeded_limit_is_reported(kept, result):
    assert kept.exceeded_limits() == [] and "FAILED" not in table(kept)
    far = result.truth + np.arange(24)[None, :, None] * 0.05
    for broken, names in (
        (replace(kept, estimate=far), ["joint error, median", "joint error, mean"]),
        (replace(kept, rejected=50), ["rejected"]),
        (replace(kept, frames_in=len(kept.times) + 5), ["unanswered"]),
        (replace(kept, state="lost"), ["tracking state"]),
        (replace(kept, reprojection_px=np.full(5, np.nan)), ["reprojection error, median"]),
    ):
        assert broken.exceeded_limits() == names
        assert table(broken).count("FAILED") == len(names)


def test_a_slow_machine_is_reported_in_a_line_and_is_no_failure(kept):
    assert slow_line(kept) == "" and "SLOW" not in table(kept)
    latencies, frames = np.full(100, 90.0), len(kept.times)
    latencies[:30] = 10.0
    for slow, names, words in (
        (replace(kept, latencies_ms=latencies), ["latency p50", "latency p99"], "70 were later than 80 ms"),
        (replace(kept, frames_in=2 * frames, overtaken=frames), ["frames out"], f"{frames} were overtaken"),
    ):
        assert (slow.exceeded_limits(), slow.exceeded_speed_limits()) == ([], names)
        assert table(slow).count("SLOW") == len(names) and "FAILED" not in table(slow)
        assert words in slow_line(slow) and slow_line(slow).endswith("This is no failure.")


@pytest.mark.parametrize("wrong", [False, True], ids=["right", "wrong"])
def test_the_exit_code_depends_on_the_skeleton_and_not_on_the_machine(kept, wrong, monkeypatch, tmp_path, capsys):
    slow = replace(kept, latencies_ms=np.full(5, 1000.0), estimate=kept.estimate + 0.3 * wrong)
    monkeypatch.setattr("lassokin_ros.demo.demo.run", lambda folder, seconds: slow)
    monkeypatch.setattr("lassokin_ros.demo.demo.write_page", lambda folder: None)
    monkeypatch.setattr("lassokin_ros.demo.demo.comparison_lines", lambda result, seconds: [])
    assert show(tmp_path, SECONDS) == int(wrong)
    said, errors = capsys.readouterr()
    assert said.count("This machine is slow or busy: ") == 1
    assert errors == ("outside the limits: root error, median\n" if wrong else "")


def test_a_node_that_falls_behind_is_slow_and_right(tmp_path, monkeypatch):
    """With a short queue the node skips frames for newer ones; each missing one is counted."""
    monkeypatch.setattr("lassokin_ros.demo.demo.QUEUE_DEPTH", 1)
    play = LiveNode.play

    def play_to_a_node_that_stops(self, recording, rate, on_frame):
        sent = []

        def stop_and_continue():
            sent.append(None)
            if len(sent) in (100, 130):
                self._process.send_signal(signal.SIGSTOP if len(sent) == 100 else signal.SIGCONT)
            on_frame()

        play(self, recording, rate, on_frame=stop_and_continue)

    monkeypatch.setattr(LiveNode, "play", play_to_a_node_that_stops)
    slow = run(tmp_path, 8, rate=4.0)
    assert slow.exceeded_limits() == [] and "frames out" in slow.exceeded_speed_limits()
    assert slow.frames_in == len(slow.times) + slow.overtaken and "overtaken" in slow_line(slow)


def children_of(pid):
    """The command lines of a process' children, by their ids."""
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii")
    return {child: Path(f"/proc/{child}/cmdline").read_bytes() for child in text.split()}


def test_an_interrupted_demo_prints_one_line_and_leaves_no_node(tmp_path):
    command = [sys.executable, "-m", "lassokin_ros.demo.demo", "--output", str(tmp_path / "out"), "--seconds", "60"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as demo:
        deadline, nodes = time.monotonic() + 120, {}
        while not any(b"lassokin_ros.node.command" in line for line in nodes.values()):
            assert demo.poll() is None and time.monotonic() < deadline, "no node was started"
            nodes = children_of(demo.pid)
        demo.send_signal(signal.SIGTERM)
        said = demo.communicate(timeout=120)[1].splitlines()
    assert demo.returncode == 130 and said[-1].startswith("demo: interrupted; "), said
    assert not any("Traceback" in line for line in said)
    assert not any(Path(f"/proc/{child}").exists() for child in nodes)


@pytest.mark.parametrize("observe, most_m", [(with_depth, 0.04), (with_second_camera, 0.02)])
def test_measured_depth_and_a_second_camera_reduce_the_error(observe, most_m):
    shown = scene(2.0)
    instants = observe(shown)
    error = np.linalg.norm(track(instants) - shown.truth, axis=-1)
    assert np.isfinite(error).all() and np.median(error) < most_m
    if observe is with_depth:
        off = np.array([one.depth for (one,) in instants]) - shown.landmarks[..., 2]
        assert np.isclose((off < -5 * np.hypot(NOISE, BIAS)).mean(), OCCLUDED, atol=0.04)
        assert np.isclose(np.median(np.abs(off)) / 0.674, np.hypot(NOISE, BIAS), rtol=0.3)
    else:
        side = instants[0][1].camera
        assert np.allclose(side.into_camera(np.array([0.0, 0.0, DISTANCE])), [0, 0, DISTANCE])
        assert np.allclose(np.abs(side.centre), [DISTANCE, 0, DISTANCE])


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf", "long"])
def test_an_invalid_duration_is_refused_with_the_expected_range(seconds, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--output", str(tmp_path / "out"), "--seconds", seconds])
    assert ended.value.code == 2 and f"--seconds: {seconds}; expected 1 to 3600 s" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_written_is_one_line(tmp_path):
    """An output, and a home, where ROS writes its logs."""
    (tmp_path / "file").write_text("")
    environment = {k: v for k, v in os.environ.items() if k not in ("ROS_LOG_DIR", "ROS_HOME")} | {"HOME": "/proc/no"}
    for output, env, said in (("file", None, ""), ("out", environment, "set ROS_LOG_DIR")):
        done = command(tmp_path / output, 1, env=env)
        assert done.returncode == 2 and done.stderr.startswith("demo: ") and done.stderr.count("\n") == 1
        assert said in done.stderr
