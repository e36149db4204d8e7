"""Compare this revision's times with those of another revision of this repository, as ratios from one interleaved run.

    python benchmarks/against.py REV [--rounds 40] [--parts step,callback,first,people,joints] [--json FILE]

REV is checked out into a temporary folder (`git archive`; any revision from 842c7c2 on). Each revision runs in a child
process of its own and is asked in turn for the same frames, round by round, so that a busy machine slows both alike.
All times are CPU times of one thread. A ratio is the median of the ratios of the rounds, below 1 where this revision is
faster; its spread are their quartiles. The ratio of a p99 is that of all frames together, its spread the quartiles
over resampled rounds. What is timed here is the working folder, with what is not committed.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack, closing
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.common.report import Record, data_folder, table, write_json  # isort: skip  (threads, before numpy)
import numpy as np

from benchmarks.common import option_types
from benchmarks.common.refusals import exit_code
from benchmarks.data.motion import FOCAL, FPS, HEIGHT, Motion, load_motion, observe, on_skeleton
from benchmarks.timing.revision import RevisionProcess, checked_out
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton

ROOT = Path(__file__).resolve().parents[1]
BODIES = ROOT / "benchmarks" / "bodies"
PEOPLE = 16
RESAMPLED = 300
NAMES = {
    "step": ("step of the core",),
    "callback": ("callback, nobody subscribes", "callback, all outputs subscribed",
                 "beyond the step, nobody subscribes", "beyond the step, all outputs subscribed"),
    "upright": ("first frame, upright",),
    "lying": ("first frame, lying",),
    "people": (f"{PEOPLE} people in one batch",),
    "joints": ("step with 55 joints, 65 landmarks",),
}  # fmt: skip
"""What a request to the child times -> names of the figures."""
PARTS = {"step": ("step",), "callback": ("callback",), "first": ("upright", "lying"), "people": ("people",),
         "joints": ("joints",)}  # fmt: skip
PER_ROUND = {"step": 50, "callback": 40, "upright": 1, "lying": 1, "people": 6, "joints": 20}
"""Frames of a round."""
WITH_P99 = ("step", "callback")
MULTIPLES = {"people": f"{PEOPLE} people, in steps of one", "joints": "55 joints, in steps of 24"}
COLUMNS = {"what": "<", "then_us": ".0f", "now_us": ".0f", "then_steps": ".1f", "now_steps": ".1f", "ratio": ".2f",
           "from": ".2f", "to": ".2f", "apart_mm": ".3f"}  # fmt: skip
"""Times of REV and of this revision, or multiples of their steps; the ratio and its spread; distance of the joints."""
Rounds = list[list[float]]
"""Times of each round's frames, s."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    figures = [figure for part in options.parts for figure in PARTS[part]]
    if "callback" in figures and find_spec("rclpy") is None:
        print("callback: left out, rclpy is not installed")
        figures.remove("callback")
    motion = load_motion(options.data or data_folder() / "mocap", options.rounds * max(PER_ROUND.values()))
    with ExitStack() as leave:
        folder = Path(leave.enter_context(tempfile.TemporaryDirectory(prefix="lassokin_against_")))
        frames = write_frames(folder / "frames.npz", motion)
        other = leave.enter_context(checked_out(ROOT, options.revision))
        domain = 30 + 2 * (os.getpid() % 30)
        children = [
            leave.enter_context(closing(RevisionProcess(root, frames, BODIES, domain + number)))
            for number, root in enumerate((other, ROOT))
        ]
        count = len(motion.state.translation)
        print(f"{options.revision} and this revision in turn, {options.rounds} rounds, {motion.source}; CPU time.")
        records = compare(children, figures, options.rounds, count)
    print(table(records, COLUMNS))
    write_json(options.json, records)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument("revision", metavar="REV", help="commit, tag or branch to compare with")
    result.add_argument("--data", type=Path, help="folder of clips (default: mocap/ of the shared data)")
    result.add_argument("--rounds", type=option_types.count, default=40, help="turns of either revision (40)")
    parts = option_types.some_of(PARTS)
    result.add_argument("--parts", type=parts, default=list(PARTS), help=f"comma-separated, of {','.join(PARTS)} (all)")
    result.add_argument("--json", type=option_types.output_file, metavar="FILE", help="write the records, a JSON list")
    return result


def write_frames(file: Path, motion: Motion) -> Path:
    """The keypoints that both revisions track: coco (people, f, 17, 2), hands (1, f, 65, 2), stamps, starts, focal."""

    def seen(skeleton: str, landmarks: str, people: int) -> np.ndarray:
        body = Skeleton.load(skeleton, HEIGHT)
        kinematics, state = Kinematics(body, Layout.load(landmarks, body)), on_skeleton(motion, body)
        return np.array([[o.points for o in observe(state, kinematics, seed=person)] for person in range(people)])

    np.savez(
        file,
        coco=seen("anthropometric", "coco17", PEOPLE),
        hands=seen(str(BODIES / "hands55.yaml"), str(BODIES / "body25_hands.yaml"), 1),
        stamps=np.arange(len(motion.state.translation)) / FPS,
        starts=np.array(motion.starts),
        focal=FOCAL,
    )
    return file


def compare(children: Sequence[RevisionProcess], figures: Sequence[str], rounds: int, frames: int) -> list[Record]:
    """One record per figure; children: the other revision's process, this one's."""
    times: dict[str, tuple[Rounds, Rounds]] = {name: ([], []) for figure in figures for name in NAMES[figure]}
    apart: dict[str, list[float]] = {figure: [] for figure in figures}
    for turn in range(rounds):
        for figure in figures:
            first, count = turn * PER_ROUND[figure], PER_ROUND[figure]
            if figure in ("upright", "lying"):
                first = turn * (frames // rounds)
            count = min(count, frames - first)
            if count <= 0:
                continue
            answers: list[Record] = [{}, {}]
            for number in (0, 1) if turn % 2 == 0 else (1, 0):
                answers[number] = children[number].ask(figure, first, count)
            for number, answer in enumerate(answers):
                for name, seconds in zip(NAMES[figure], answer["seconds"], strict=True):
                    times[name][number].append(seconds)
            apart[figure].append(_apart_mm(*(answer["joints"] for answer in answers)))
    records = []
    for figure in figures:
        for name in NAMES[figure]:
            distance = float(np.nanmedian(apart[figure])) if np.isfinite(apart[figure]).any() else float("nan")
            records.append({"what": f"{name}, p50", **_ratio_of_medians(*times[name]), "apart_mm": distance})
            if figure in WITH_P99:
                records.append({"what": f"{name}, p99", **_ratio_of_tails(*times[name])})
    step = times.get(NAMES["step"][0])
    return records + [
        {"what": what, **_multiples(step, times[NAMES[figure][0]])}
        for figure, what in MULTIPLES.items() if step is not None and figure in figures
    ]  # fmt: skip


def _apart_mm(then: Sequence[Sequence[float]] | None, now: Sequence[Sequence[float]] | None) -> float:
    """Mean distance of the joints of both revisions, NaN where either has none."""
    if then is None or now is None:
        return float("nan")
    return 1e3 * float(np.linalg.norm(np.array(then) - np.array(now), axis=-1).mean())


def _medians(rounds: Rounds) -> np.ndarray:
    """(rounds,) median time of each round's frames, NaN where all of them initialised."""
    return np.array([np.median(seconds) if seconds else np.nan for seconds in rounds])


def _ratio_of_medians(then: Rounds, now: Rounds) -> Record:
    return _record(then, now, 50, _medians(now) / _medians(then))


def _ratio_of_tails(then: Rounds, now: Rounds) -> Record:
    """Of the p99 of all frames; the spread by drawing rounds again, the same ones of both revisions."""
    random = np.random.default_rng(0)
    drawn = random.integers(len(then), size=(RESAMPLED, len(then)))
    tails = ([_percentile([rounds[i] for i in rows], 99) for rows in drawn] for rounds in (then, now))
    before, after = map(np.array, tails)
    return {**_record(then, now, 99, after / before), "ratio": _percentile(now, 99) / _percentile(then, 99)}


def _multiples(step: tuple[Rounds, Rounds], several: tuple[Rounds, Rounds]) -> Record:
    """How many steps of one person (of 24 joints) a step takes: of either revision, and the ratio of both."""
    multiples = [_medians(more) / _medians(one)[: len(more)] for one, more in zip(step, several)]
    then, now = (float(np.nanmedian(multiple)) for multiple in multiples)
    low, middle, high = np.nanpercentile(multiples[1] / multiples[0], [25, 50, 75])
    return {"then_steps": then, "now_steps": now, "ratio": float(middle), "from": float(low), "to": float(high)}


def _record(then: Rounds, now: Rounds, percentile: float, ratios: np.ndarray) -> Record:
    low, middle, high = np.nanpercentile(ratios, [25, 50, 75])
    times = {"then_us": 1e6 * _percentile(then, percentile), "now_us": 1e6 * _percentile(now, percentile)}
    return {**times, "ratio": float(middle), "from": float(low), "to": float(high), "rounds": len(ratios)}


def _percentile(rounds: Rounds, percentile: float) -> float:
    return float(np.percentile(np.concatenate([np.asarray(seconds, dtype=float) for seconds in rounds]), percentile))


if __name__ == "__main__":
    sys.exit(exit_code(main))
