"""Time per frame: the tracker's step and its stages, the node's callback, by people; peers.

    python benchmarks/latency.py [--frames 2000] [--parts core,callback,people,peers] [--json FILE]

Real motion of two clips at 60 Hz, 2 px (synthetic motion without the shared data). The variants of one part run in
turn, frame by frame, so that a busy moment of the machine affects all of them; one process, one thread. Frames that
initialise are measured separately. p50, p95 and p99 are wall times of this machine at this moment; cpu is the median
CPU time of the thread. Ratios between variants use the CPU time, which other processes do not affect.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Mapping, Sequence

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.common.report import Record, data_folder, exit_code, table, write_json  # isort: skip  (before numpy)
import numpy as np

from benchmarks.common import option_types
from benchmarks.data.motion import FOCAL, HEIGHT, Motion, load_motion, observe
from benchmarks.methods.robot_ik import TRUE_PLACES, MinkTracker, PinkTracker, PinocchioLeastSquares, available
from benchmarks.timing.callback import measure_callback
from benchmarks.timing.stages import percentiles, profile
from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker

PARTS = ("core", "callback", "people", "peers")
PEOPLE = (1, 4, 16)
NOISE_PX = 2.0
QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
COLUMNS = {
    "what": "<",
    "calls": ".1f",
    "p50_us": ".0f",
    "p95_us": ".0f",
    "p99_us": ".0f",
    "cpu_us": ".0f",
    "ratio": ".2f",
    "given": "<",
    "error_mm": ".0f",
    "certificate": "<",
}
Step = Callable[[int], bool]
"""Run the step on frame i; return False if this frame must not be counted."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    motion = load_motion(options.data or data_folder() / "mocap", options.frames)
    frames = len(motion.state.translation)
    print(f"{frames} frames of {motion.source} at 60 Hz, {NOISE_PX:g} px; one thread; variants interleaved.")
    records: list[Record] = []
    for part in options.parts:
        title, measured = MEASURES[part](motion)
        print(f"\n{part}: {title}")
        print(table(measured, {key: form for key, form in COLUMNS.items() if key in measured[0]}))
        records += [{**record, "part": part} for record in measured]
    write_json(options.json, records)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = option_types.command_line(__doc__)
    result.add_argument(
        "--data", type=Path, help="folder of clips (default: mocap/ in LASSOKIN_DATA or ../shared/data)"
    )
    result.add_argument("--frames", type=option_types.frames, default=2000, help="(2000)")
    parts = option_types.some_of(PARTS)
    result.add_argument("--parts", type=parts, default=list(PARTS), help=f"comma-separated, of {','.join(PARTS)} (all)")
    return result


class Run:
    """A tracker and its frames."""

    def __init__(self, motion: Motion, seed: int = 0) -> None:
        self.tracker = Tracker(TrackerConfig(height=HEIGHT, landmarks="coco17", noise_px=NOISE_PX))
        self.state = motion.state
        self.observations: list[Observation] = observe(self.state, self.tracker.kinematics, NOISE_PX, seed)
        self.starts = motion.starts

    def step(self, frame: int) -> bool:
        """Track one frame. A clip's first frame resets the tracker and is not counted."""
        return step_together([self], frame)


def step_together(runs: Sequence[Run], frame: int) -> bool:
    """Track one frame of several people, one after the other; False if one of the clips restarts."""
    for run in runs:
        if frame in run.starts:
            run.tracker.reset()
    estimates = [run.tracker.track(run.observations[frame]) for run in runs]
    return not any(estimate.initialised for estimate in estimates)


def interleaved(
    steps: Mapping[str, Step], frames: int, after: Callable[[str, int], None] = lambda name, frame: None
) -> list[Record]:
    """Run each step on each frame, in a rotating order; one record per step, with its ratio to the first.

    after: called with name and frame after each step; it is not timed.
    """
    names = list(steps)
    wall: dict[str, list[float]] = {name: [] for name in names}
    cpu: dict[str, list[float]] = {name: [] for name in names}
    for frame in range(frames):
        for name in names[frame % len(names) :] + names[: frame % len(names)]:
            start, cpu_start = time.perf_counter(), time.thread_time()
            counts = steps[name](frame)
            cpu_end, end = time.thread_time(), time.perf_counter()
            after(name, frame)
            if counts:
                wall[name].append(end - start)
                cpu[name].append(cpu_end - cpu_start)
    records = [{"what": name, **percentiles(wall[name]), "cpu_us": 1e6 * float(np.median(cpu[name]))} for name in names]
    return [{**record, "ratio": record["cpu_us"] / records[0]["cpu_us"]} for record in records]


def core(motion: Motion) -> tuple[str, list[Record]]:
    """Stages of the tracker's step, and its initialisation."""
    run = Run(motion)
    records = profile(run.tracker, run.observations, motion)
    whole = records[-1]["p50_us"]
    for what, taken in initialisations(run).items():
        records.append({"what": what, "calls": 1.0, **percentiles(taken)})
    return "stages of one tracker step, COCO-17, 24 joints; times per frame, all calls of the stage together", [
        {**record, "ratio": record["p50_us"] / whole} for record in records
    ]


def initialisations(run: Run) -> dict[str, list[float]]:
    """Time in s of first frames and of re-initialisations, upright and lying (image rotated by 90 degrees)."""
    tracker = run.tracker
    times: dict[str, list[float]] = {}
    for frame in range(0, len(run.observations) - 1, max(1, len(run.observations) // 20)):
        upright, following = run.observations[frame : frame + 2]
        away = following.stamp + 2 * tracker.config.lost_after
        for who, points in (("upright", upright.points), ("lying", upright.points @ QUARTER_TURN)):
            tracker.reset()
            first = _timed(tracker, replace(upright, points=points))
            tracker.reset()
            tracker.track(upright)
            tracker.track(following)
            again = _timed(tracker, replace(upright, points=points, stamp=away))
            times.setdefault(f"initialisation from one frame, {who}", []).append(first)
            times.setdefault(f"the same, the camera's tilt known, {who}", []).append(again)
    return times


def _timed(tracker: Tracker, observation: Observation) -> float:
    """Time of a frame that initialises, s."""
    start = time.perf_counter()
    estimate = tracker.track(observation)
    taken = time.perf_counter() - start
    assert estimate.initialised
    return taken


def callback(motion: Motion) -> tuple[str, list[Record]]:
    """The node's callback and its stages."""
    carrier, records = measure_callback(Run(motion).observations)
    core_step = next(r["p50_us"] for r in records if r["what"].startswith("decode, undistort, track"))
    return f"one keypoint message, PointCloud2, {carrier}", [{**r, "ratio": r["p50_us"] / core_step} for r in records]


def people(motion: Motion) -> tuple[str, list[Record]]:
    """By number of people, each with a tracker and independent noise, processed one after the other as in the node."""

    def step_of(count: int) -> Step:
        runs = [Run(motion, seed=person) for person in range(count)]
        return lambda frame: step_together(runs, frame)

    steps = {f"{count} {'person' if count == 1 else 'people'}": step_of(count) for count in PEOPLE}
    frames = max(2, len(motion.state.translation) // 4)
    return f"all people of one frame, COCO-17, {frames} frames", interleaved(steps, frames)


def peers(motion: Motion) -> tuple[str, list[Record]]:
    """Robot inverse kinematics on the same motion."""
    run = Run(motion)
    truth = run.tracker.kinematics.pose(run.state).landmarks
    start = BodyState(run.state.rotations[0], run.state.translation[0])
    others = {name: _peer(name, run, start) for name in available()}
    errors: dict[str, list[float]] = {name: [] for name in ("tracker step", *others)}
    hips = [run.tracker.layout.index(f"{side}_hip") for side in ("left", "right")]

    def tracked(frame: int) -> bool:
        counts = run.step(frame)
        tracked_pose.append(run.tracker.published[-1].pose.landmarks)
        return counts

    def score(name: str, frame: int) -> None:
        found = tracked_pose[-1] if name == "tracker step" else others[name].landmarks()
        apart = (found - found[hips].mean(0)) - (truth[frame] - truth[frame][hips].mean(0))
        errors[name].append(1000 * float(np.linalg.norm(apart, axis=-1).mean()))

    tracked_pose: list[np.ndarray] = []
    steps: dict[str, Step] = {"tracker step": tracked}
    for name, peer in others.items():
        steps[name] = _step_of(peer, run, truth)
    missing = "" if "mink, daqp" in others else " (not all peers are installed: pip install pin pin-pink mink)"
    frames = motion.starts[1] if len(motion.starts) > 1 else len(truth)
    records = interleaved(steps, frames, score)
    for record in records:
        name = str(record["what"])
        record["error_mm"] = float(np.mean(errors[name]))
        record["given"] = "image" if name == "tracker step" else others[name].given
        record["certificate"] = "yes" if name == "tracker step" else "no"
    return f"robot inverse kinematics, COCO-17, {frames} frames; landmarks, hips on hips{missing}", records


def _peer(name: str, run: Run, start: BodyState) -> Any:
    kinematics, (tool, _, solver) = run.tracker.kinematics, name.partition(", ")
    if tool == "pink":
        return PinkTracker(kinematics, start, solver)
    return MinkTracker(kinematics, start, solver) if tool == "mink" else PinocchioLeastSquares(kinematics, start)


def _step_of(peer: Any, run: Run, truth: np.ndarray) -> Step:
    def step(frame: int) -> bool:
        if peer.given == TRUE_PLACES:
            peer.track(truth[frame])
        else:
            peer.track(run.observations[frame].points, FOCAL / NOISE_PX)
        return True

    return step


MEASURES: dict[str, Callable[[Motion], tuple[str, list[Record]]]] = {
    "core": core, "callback": callback, "people": people, "peers": peers,
}  # fmt: skip


if __name__ == "__main__":
    sys.exit(exit_code(main))
