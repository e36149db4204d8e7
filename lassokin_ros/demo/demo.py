"""`make demo`: the real node tracks a synthetic person on real DDS; the outputs are compared with the truth.

The demo writes a recording of keypoints with detector noise and lens distortion, plays it into the node in real time,
records the outputs, prints a table, and writes a picture and an HTML report.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lassokin_ros.common.command_line import INTERRUPTED, USAGE_ERROR
from lassokin_ros.common.interruption import Interrupted, interruptible
from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.observation import Status
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.result import LIMITS, DemoResult

RATE = 30.0  # Hz
SECONDS = 18.0
LEAST_S, MOST_S = 1.0, 3600.0
"""s: range of --seconds. The limits of the table do not hold for shorter motions; longer ones need much memory."""
QUEUE_DEPTH = 60
START_NS = 1_700_000_000_000_000_000


def run(folder: Path, seconds: float, rate: float = 1.0) -> DemoResult:
    """Write the recording, play it into the node, and write `keypoints` and `tracked` into the folder.

    seconds: length of the motion. rate: playback speed, 1 = real time. Raises a LassokinError if the node does not
    start or does not answer.
    """
    from lassokin_ros.common.progress import Progress
    from lassokin_ros.demo.live_playback import LiveNode, PlaybackError
    from lassokin_ros.demo.synthetic import WEBCAM
    from lassokin_ros.replay.keypoint_recording import write_keypoint_recording

    tracker, times, states, pixels, confidence = _scene(seconds)
    stamps = START_NS + np.round(times * 1e9).astype(np.int64)
    truth = tracker.kinematics.pose(states).positions
    recording = folder / "keypoints"
    write_keypoint_recording(
        recording, stamps, pixels, confidence, WEBCAM.K, WEBCAM.D, WEBCAM.size, replace=recording.exists()
    )
    # A deep queue: if the machine is busy for a moment, the latency grows, but no frames are lost.
    with LiveNode({"queue_depth": QUEUE_DEPTH}) as live:
        progress = Progress(len(times), "frames", plain_lines=4)
        try:
            live.play(recording, rate, on_frame=progress.advance)
        finally:
            progress.close()
    if not live.latencies_ms():
        raise PlaybackError("the node answered no frame of the recording")
    live.record(folder / "tracked", replace=(folder / "tracked").exists())
    return _result(live, tracker, times, stamps, truth, pixels, confidence)


def _scene(seconds: float) -> tuple[Tracker, np.ndarray, BodyState, np.ndarray, np.ndarray]:
    """Return a new tracker, and of f frames: times (f,) s, true states, pixels (f, l, 2) px and confidence (f, l)."""
    from lassokin_ros.demo.synthetic import detections, exact_pixels, motion

    tracker, times = Tracker(TrackerConfig()), np.arange(round(seconds * RATE)) / RATE
    states = motion(tracker.skeleton, times)
    return tracker, times, states, *detections(exact_pixels(tracker.kinematics, states), RATE, seed=1)


def _result(live, tracker, times, stamps, truth, pixels, confidence) -> DemoResult:  # type: ignore[no-untyped-def]
    """Match the outputs with the inputs by stamp."""
    joints, certificates = live.messages("~/joints"), live.messages("~/certificate")
    places = {stamp: row for row, stamp in enumerate(stamps.tolist())}
    rows = [places[m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec] for m in joints]
    estimate = np.array([[[p.position.x, p.position.y, p.position.z] for p in m.poses] for m in joints])
    values = [{pair.key: pair.value for pair in m.status[0].values} for m in certificates]
    return DemoResult(
        tracker,
        times[rows],
        estimate,
        truth[rows],
        pixels[rows],
        confidence[rows],
        np.array([float(v["support size"]) for v in values]),
        np.array([float(v["reprojection error [px]"]) for v in values]),
        np.array(live.latencies_ms()),
        len(live.sent),
        live.rejected(),
        live.overtaken(),
        live.state(),
    )


def write_page(folder: Path) -> None:
    """Replay `keypoints` in the folder and write report.html. Raises a LassokinError."""
    from lassokin_ros.common.atomic_files import AtomicFiles
    from lassokin_ros.pipeline.session import Session
    from lassokin_ros.pipeline.settings import NodeSettings
    from lassokin_ros.replay.bags import BagReader
    from lassokin_ros.replay.keypoint_recording import CAMERA_INFO, KEYPOINTS
    from lassokin_ros.replay.playback import Playback
    from lassokin_ros.replay.report.report import Report, ReportError

    with BagReader(folder / "keypoints") as bag:
        tracker = Playback(Session(TrackerConfig(), NodeSettings()))
        report = Report(folder / "report.html", tracker.session, replace=True)
        tracker.listeners.append(report.add)
        for topic, time_ns, message in bag.messages(bag.topics):
            process = tracker.keypoints if topic == KEYPOINTS else tracker.camera_info
            process(message, time_ns)  # only the page is needed; the outputs of the node are recorded already
    with AtomicFiles(replace=True, error=ReportError) as files:
        report.write(files, "the demo's keypoints", (KEYPOINTS, CAMERA_INFO))


def comparison_lines(result: DemoResult, seconds: float) -> list[str]:
    """Return the lines that compare the same motion with one camera, with measured depth, and with a second camera."""
    from lassokin_ros.demo.comparison import track_with_depth, track_with_second_camera

    tracker, times, states, pixels, confidence = _scene(seconds)
    truth = tracker.kinematics.pose(states).positions
    lines = [
        f"{'the same motion with':<52}{'joint error [mm]':>18}{'root [mm]':>12}",
        _row("one camera, live (above)", result),
    ]
    for title, track in (
        ("a depth camera (3 cm noise, 10 % hidden)", track_with_depth),
        ("a second camera from the side", track_with_second_camera),
    ):
        joints = track(states, times, pixels, confidence)
        there = np.isfinite(joints[:, 0, 0])
        lines.append(_row(title, replace(result, estimate=joints[there], truth=truth[there])))
    return lines


def _row(title: str, result: DemoResult) -> str:
    return f"  {title:<50}{np.median(result.error_mm):>18.0f}{np.median(result.root_error_mm):>12.0f}"


def table(result: DemoResult) -> str:
    """Return the table of figures and their limits."""
    exceeded, slow = result.exceeded_limits(), result.exceeded_speed_limits()
    lines = [f"{'':<32}{'measured':>10}{'limit':>13}"]
    for name, value in result.figures().items():
        limit, unit = LIMITS[name]
        sign = ">=" if name == "frames out" else "<="
        share = unit.startswith("share")
        text, bound = (f"{value:.1%}", f"{sign} {limit:.0%}") if share else (f"{value:.1f}", f"{sign} {limit:g}")
        mark = "   FAILED" if name in exceeded else "   SLOW" if name in slow else ""
        lines.append(f"{name + ('' if share else f' [{unit}]'):<32}{text:>10}{bound:>13}{mark}")
    mark = "   FAILED" if "tracking state" in exceeded else ""
    lines.append(f"{'tracking state at the end':<32}{result.state:>10}{Status.TRACKING.value:>13}{mark}")
    counts = f"{len(result.times)} out, {result.rejected} rejected, {result.overtaken} overtaken"
    lines.append(f"frames: {result.frames_in} in, {counts}")
    return "\n".join(lines)


def slow_line(result: DemoResult) -> str:
    """Return the line that reports a slow or busy machine, empty if the figures of speed are within their limits."""
    if not result.exceeded_speed_limits():
        return ""
    figures, limit = result.figures(), LIMITS["latency p99"][0]
    return (
        f"This machine is slow or busy: of {result.frames_in} frames {result.overtaken} were overtaken by newer ones, "
        f"{result.late()} were later than {limit:g} ms; latency p50 {figures['latency p50']:.0f} ms, p99 "
        f"{figures['latency p99']:.0f} ms. This is no failure."
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo and return the exit code.

    The code is 0 if the skeleton is right, on a slow or busy machine too; 1 if a figure other than those of speed is
    outside its limit, 2 if the demo could not run (one line on stderr) and 130 after an interrupt.
    """
    parser = argparse.ArgumentParser(prog="demo", description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="folder for the results")
    parser.add_argument("--seconds", type=_seconds, default=SECONDS, help="length of the motion in s")
    options = parser.parse_args(arguments)
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))  # isolates the demo from other nodes
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        with interruptible():
            return show(options.output, options.seconds)
    except (ImportError, OSError, LassokinError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return USAGE_ERROR
    except Interrupted:
        print(f"demo: interrupted; the results in {options.output} are not complete", file=sys.stderr)
        return INTERRUPTED


def show(folder: Path, seconds: float) -> int:
    """Run the demo, write the results and print the table; return 0 if the skeleton is right, else 1."""
    from lassokin_ros.demo.picture import draw

    folder.mkdir(parents=True, exist_ok=True)
    print(f"Input: a person walks, waves and squats for {seconds:g} s at {RATE:g} Hz; keypoints with noise, gaps and")
    print("outliers, sent to the tracker on DDS. The tracker has the person's body proportions and no other knowledge.")
    result = run(folder, seconds)
    draw(result, folder / "skeleton.svg")
    write_page(folder)
    print(table(result))
    print("\n".join(comparison_lines(result, seconds)))
    print(f"report for a browser: {folder / 'report.html'} (the same motion through lassokin replay --report)")
    print(f"picture: {folder / 'skeleton.svg'}   recordings: {folder}/keypoints, {folder}/tracked (rosbag2)")
    if slow := slow_line(result):
        print(slow)
    exceeded = result.exceeded_limits()
    if exceeded:
        print(f"outside the limits: {', '.join(exceeded)}", file=sys.stderr)
    return 1 if exceeded else 0


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = float("nan")
    if not LEAST_S <= seconds <= MOST_S:
        raise argparse.ArgumentTypeError(f"{text}; expected {LEAST_S:g} to {MOST_S:g} s")
    return seconds
