"""`make demo`: the real node tracks a synthetic person on real DDS; the outputs are compared with the truth.

The demo writes a recording of keypoints with detector noise and lens distortion, plays it into the node in real time,
records the outputs, prints a table, and writes a picture and an HTML report. The same motion is also tracked with
measured depth and with a second camera.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lassokin_ros.common.command_line import INTERRUPTED, USAGE_ERROR
from lassokin_ros.common.interruption import Interrupted, interruptible
from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.result import DemoResult, slow_line, table
from lassokin_ros.demo.synthetic import DISTANCE, WEBCAM, detections, exact_pixels, motion

if TYPE_CHECKING:
    from lassokin_ros.demo.live_playback import LiveNode

RATE = 30.0  # Hz
SECONDS = 18.0
LEAST_S, MOST_S = 1.0, 3600.0
"""s: range of --seconds. The limits of the table do not hold for shorter motions; longer ones need much memory."""
QUEUE_DEPTH = 60
START_NS = 1_700_000_000_000_000_000
NOISE, BIAS = 0.03, 0.02
"""m: standard deviations of the noise of a depth, and of its lasting part."""
OCCLUDED, NEARER = 0.1, (0.1, 0.5)
"""Share of the points that an occluder covers, and the range by which it is nearer, m."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The motion. times: (f,) s. states: (f, ...). pixels, confidence: (f, l, 2) px and (f, l), of the detector."""

    tracker: Tracker
    times: np.ndarray
    states: BodyState
    pixels: np.ndarray
    confidence: np.ndarray

    @property
    def truth(self) -> np.ndarray:
        """(f, n, 3) m: the joints."""
        return self.tracker.kinematics.pose(self.states).positions

    @property
    def landmarks(self) -> np.ndarray:
        """(f, l, 3) m."""
        return self.tracker.kinematics.pose(self.states).landmarks


def scene(seconds: float) -> Scene:
    """Return the motion of a length in s, with a new tracker."""
    tracker, times = Tracker(TrackerConfig()), np.arange(round(seconds * RATE)) / RATE
    states = motion(tracker.skeleton, times)
    return Scene(tracker, times, states, *detections(exact_pixels(tracker.kinematics, states), RATE, seed=1))


def run(folder: Path, seconds: float, rate: float = 1.0) -> DemoResult:
    """Write the recording, play it into the node, and write `keypoints` and `tracked` into the folder.

    seconds: length of the motion. rate: playback speed, 1 = real time. Raises a LassokinError if the node does not
    start or does not answer.
    """
    from lassokin_ros.common.progress import Progress
    from lassokin_ros.demo.live_playback import LiveNode, PlaybackError
    from lassokin_ros.replay.keypoint_recording import write_keypoint_recording

    shown = scene(seconds)
    stamps = START_NS + np.round(shown.times * 1e9).astype(np.int64)
    recording = folder / "keypoints"
    camera = WEBCAM.K, WEBCAM.D, WEBCAM.size
    write_keypoint_recording(recording, stamps, shown.pixels, shown.confidence, *camera, replace=recording.exists())
    # A deep queue: if the machine is busy for a moment, the latency grows, but no frames are lost.
    with LiveNode({"queue_depth": QUEUE_DEPTH}) as live:
        progress = Progress(len(stamps), "frames", plain_lines=4)
        try:
            live.play(recording, rate, on_frame=progress.advance)
        finally:
            progress.close()
    if not live.latencies_ms():
        raise PlaybackError("the node answered no frame of the recording")
    live.record(folder / "tracked", replace=(folder / "tracked").exists())
    return _result(live, shown, stamps)


def _result(live: LiveNode, shown: Scene, stamps: np.ndarray) -> DemoResult:
    """Match the outputs with the inputs by stamp."""
    joints, certificates = live.messages("~/joints"), live.messages("~/certificate")
    places = {stamp: row for row, stamp in enumerate(stamps.tolist())}
    rows = [places[m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec] for m in joints]
    values: list[dict[str, Any]] = [{pair.key: pair.value for pair in m.status[0].values} for m in certificates]
    return DemoResult(
        skeleton=shown.tracker.skeleton,
        times=shown.times[rows],
        estimate=np.array([[[p.position.x, p.position.y, p.position.z] for p in m.poses] for m in joints]),
        truth=shown.truth[rows],
        pixels=shown.pixels[rows],
        confidence=shown.confidence[rows],
        support=np.array([float(v["support size"]) for v in values]),
        reprojection_px=np.array([float(v["reprojection error [px]"]) for v in values]),
        latencies_ms=np.array(live.latencies_ms()),
        frames_in=len(live.sent),
        rejected=live.rejected(),
        overtaken=live.overtaken(),
        state=live.state(),
    )


def write_page(folder: Path) -> None:
    """Replay `keypoints` in the folder and write report.html. Raises a LassokinError."""
    from lassokin_ros.common.atomic_files import AtomicFiles
    from lassokin_ros.pipeline.session import Session
    from lassokin_ros.pipeline.settings import NodeSettings
    from lassokin_ros.replay.bags import BagReader
    from lassokin_ros.replay.frames import FrameTable
    from lassokin_ros.replay.keypoint_recording import CAMERA_INFO, KEYPOINTS
    from lassokin_ros.replay.playback import Playback
    from lassokin_ros.replay.report.report import Report, ReportError

    with BagReader(folder / "keypoints") as bag:
        tracker = Playback(Session(TrackerConfig(), NodeSettings()))
        frames = FrameTable(tracker.session)
        report = Report(folder / "report.html", tracker.session, frames, replace=True)
        tracker.listeners.append(frames.add)
        for topic, time_ns, message in bag.messages(bag.topics):
            process = tracker.keypoints if topic == KEYPOINTS else tracker.camera_info
            process(message, time_ns)  # only the page is needed; the outputs of the node are recorded already
    with AtomicFiles(replace=True, error=ReportError) as files:
        report.write(files, "the demo's keypoints", (KEYPOINTS, CAMERA_INFO))


def comparison_lines(result: DemoResult, seconds: float) -> list[str]:
    """Return the lines that compare the same motion with one camera, with measured depth, and with a second camera."""
    shown = scene(seconds)
    lines = [
        f"{'the same motion with':<52}{'joint error [mm]':>18}{'root [mm]':>12}",
        _row("one camera, live (above)", result),
    ]
    for title, instants in (
        ("a depth camera (3 cm noise, 10 % hidden)", with_depth(shown)),
        ("a second camera from the side", with_second_camera(shown)),
    ):
        joints = track(instants)
        there = np.isfinite(joints[:, 0, 0])
        lines.append(_row(title, replace(result, estimate=joints[there], truth=shown.truth[there])))
    return lines


def _row(title: str, result: DemoResult) -> str:
    return f"  {title:<50}{np.median(result.error_mm):>18.0f}{np.median(result.root_error_mm):>12.0f}"


def with_depth(shown: Scene) -> list[list[Observation]]:
    """Return the observations with depths (l,) m as a depth camera measures them at the keypoints."""
    lens, random = WEBCAM.lens, np.random.default_rng(2)
    true = shown.landmarks[..., 2]
    depth = true + NOISE * random.normal(size=true.shape) + BIAS * random.normal(size=true.shape[1])
    hidden = random.random(true.shape) < OCCLUDED
    depth = np.where(hidden, depth - random.uniform(*NEARER, size=true.shape), depth)
    rows = zip(shown.times.tolist(), shown.pixels, shown.confidence, depth)
    return [[Observation(at, lens.normalise(px), sure, lens.focal, depth=metres)] for at, px, sure, metres in rows]


def with_second_camera(shown: Scene) -> list[list[Observation]]:
    """Return the observations with those of a second camera 90 degrees to the side, with the same lens and detector."""
    lens, turn = WEBCAM.lens, exponential(np.array([[0.0, np.pi / 2, 0.0]]))[0]
    middle = np.array([0.0, 0.0, DISTANCE])
    side = CameraPose("side", turn, middle - turn @ middle)
    seen = project(side.into_camera(shown.landmarks))
    exact = lens.distort(seen.reshape(-1, 2)).reshape(seen.shape)
    views = (
        (CameraPose("front"), shown.pixels, shown.confidence),
        (side, *detections(exact, 1 / float(np.diff(shown.times).mean()), seed=2)),
    )
    return [
        [Observation(at, lens.normalise(px[frame]), sure[frame], lens.focal, camera=pose) for pose, px, sure in views]
        for frame, at in enumerate(shown.times.tolist())
    ]


def track(instants: Iterable[Sequence[Observation]]) -> np.ndarray:
    """Return the joints (f, n, 3) m of a new tracker, NaN before the first estimate; without one, those before."""
    tracker = Tracker(TrackerConfig())
    joints = [np.full((tracker.skeleton.joint_count, 3), np.nan)]
    for instant in instants:
        pose = tracker.track(instant).pose
        joints.append(joints[-1] if pose is None else pose.positions)
    return np.array(joints[1:])


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


if __name__ == "__main__":
    sys.exit(main())
