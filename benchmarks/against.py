"""Processor time of this revision against another revision of this repository, in one interleaved run.

    python benchmarks/against.py REV [--rounds 12] [--figures step,people16] [--json FILE]

The two revisions take turns on the same frames, so that a slow or busy machine hits both alike. Each figure is the
median over the rounds of the ratio this / other, with the quartiles of the rounds, and the medians in ms of both.
"mean" is the same for the means of the rounds, which contain the work of some frames only. "p99" is the ratio of the
99th percentiles of all frames. Below 1: this revision is faster.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.common.report import Record, data_folder, exit_code, table, write_json  # isort: skip  (before numpy)
import numpy as np

from benchmarks.common import option_types
from benchmarks.common.revision import ROOT, check_out
from benchmarks.data.motion import FOCAL, FPS, HEIGHT, load_motion, observe, on_skeleton
from benchmarks.same_output import write_recording
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton

DRIVER = ROOT / "benchmarks" / "timing" / "revision_driver.py"
BODY = ROOT / "benchmarks" / "bodies" / "hands55.yaml"
LAYOUT = ROOT / "benchmarks" / "bodies" / "body25_hands.yaml"
PEOPLE, FRAMES = 16, 600
COUNTS = {
    "step": 60,
    "people16": 8,
    "joints55": 30,
    "first_upright": 3,
    "first_lying": 2,
    "callback_idle": 30,
    "callback_all": 30,
    "replay": 1,
}
"""Frames of each figure in one round: a step, all of 16 people, a body of 55 joints; a first frame, upright or lying;
the node's callback without the core's step, with no subscriber and with one for each output. For `replay` the number of
replays of a recording of REPLAYED_S; its time is that of one frame, and includes the start of the tracker."""
REPLAYED_S = 20.0
COLUMNS = {"what": "<", "this_ms": ".3f", "other_ms": ".3f", "ratio": ".2f", "quartiles": "<", "mean_ratio": ".2f",
           "p99_ratio": ".2f"}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "revision"
        commit = check_out(options.revision, other)
        data = Path(folder) / "frames.npz"
        np.savez(data, **frames())
        recording = Path(folder) / "recording"
        if "replay" in options.figures:
            write_recording(recording, 1, REPLAYED_S)
        with Child(ROOT, data, recording) as mine, Child(other, data, recording) as theirs:
            print(f"this tree against {commit}; {options.rounds} rounds, taking turns; processor time of one thread.")
            records = compare(mine, theirs, options.figures, options.rounds)
    print(table(records, COLUMNS))
    write_json(options.json, records)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = option_types.command_line(__doc__)
    result.add_argument("revision", metavar="REV", help="commit, branch or tag to compare with")
    result.add_argument("--rounds", type=option_types.count, default=12, help="(12)")
    chosen = option_types.some_of(tuple(COUNTS))
    result.add_argument("--figures", type=chosen, default=list(COUNTS), help="comma-separated (all)")
    return result


def frames() -> dict[str, Any]:
    """The keypoints of all figures: 16 people with noise of their own, and one with hands."""
    motion = load_motion(data_folder() / "mocap", FRAMES)
    skeleton = Skeleton.load("anthropometric", HEIGHT)
    kinematics = Kinematics(skeleton, Layout.load("coco17", skeleton))
    people = [[o.points for o in observe(motion.state, kinematics, seed=person)] for person in range(PEOPLE)]
    hands = Skeleton.load(str(BODY), HEIGHT)
    with_hands = Kinematics(hands, Layout.load(str(LAYOUT), hands))
    points = np.array(people)
    return {
        "focal": FOCAL,
        "fps": FPS,
        "height": HEIGHT,
        "points": points,
        "pixels": points[0] * FOCAL + [640.0, 360.0],
        "hand_points": np.array([o.points for o in observe(on_skeleton(motion, hands), with_hands)]),
    }


class Child:
    """A process that runs one revision's figures. Use it in a `with` statement."""

    def __init__(self, tree: Path, data: Path, recording: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, str(DRIVER), str(data), str(BODY), str(LAYOUT), str(recording)],
            cwd=tree, env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        self._answer()

    def run(self, figure: str, count: int) -> np.ndarray:
        """(count,) s of the processor."""
        assert self._process.stdin is not None
        print(json.dumps({"figure": figure, "count": count}), file=self._process.stdin, flush=True)
        return np.array(self._answer())

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit("the process of a revision has ended; its error message is printed above")
        return json.loads(line)

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()


def compare(mine: Child, theirs: Child, figures: Sequence[str], rounds: int) -> list[Record]:
    """One record per figure."""
    records = []
    for figure in figures:
        taken: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
        for child in (mine, theirs):
            child.run(figure, max(COUNTS[figure] // 3, 1))  # the first frames initialise
        for number in range(rounds):
            for side in (0, 1) if number % 2 else (1, 0):
                taken[side].append((mine, theirs)[side].run(figure, COUNTS[figure]))
        medians = np.median(np.array(taken), axis=-1)
        ratios = medians[0] / medians[1]
        low, high = np.percentile(ratios, [25, 75])
        means = np.array(taken).mean(axis=-1)
        p99 = [float(np.percentile(np.concatenate(side), 99)) for side in taken]
        records.append({
            "what": figure,
            "this_ms": 1e3 * float(np.median(medians[0])), "other_ms": 1e3 * float(np.median(medians[1])),
            "ratio": float(np.median(ratios)), "quartiles": f"{low:.2f} to {high:.2f}",
            "mean_ratio": float(np.median(means[0] / means[1])), "p99_ratio": p99[0] / p99[1],
        })  # fmt: skip
    return records


if __name__ == "__main__":
    sys.exit(exit_code(main))
