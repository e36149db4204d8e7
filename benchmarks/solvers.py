"""The frame's lasso by every formulation and solver: time, and how optimal the answer is.

    python benchmarks/solvers.py [--problems 200] [--methods default,primal] [--json FILE]

Problems are recorded from tracking clips at 2 px: those of the paper's plain lasso (image rows, one alpha) and those
of the default session (with the prior's rows, alpha per degree of freedom). The methods run in turn, each with a few
problems in a row, as a tracker solves them. A busy moment of the machine therefore affects all of them, and few
problems are solved with caches that another method has filled; the first problem of each turn is also listed alone
(first_us). One thread. Each answer is certified on the problem as given, after entries below the solver's tolerance are
set to 0 (with the cut that gives the best certificate).

kkt: KKT residual in units of alpha; gap: relative duality gap; certified: share of answers with kkt <= 1e-6, the
limit of the tracker; failed: share with kkt > 1e-2, or without an answer.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path
from typing import Sequence

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import benchmarks.accuracy_run.experiment as experiment  # isort: skip  (first: sets one thread before numpy)
import numpy as np

from benchmarks.common import option_types
from benchmarks.common.report import Record, data_folder, exit_code, table, write_json
from benchmarks.timing import formulations
from benchmarks.timing.formulations import KINDS, Answer, Method, Recorded, record
from lassokin_ros.core.lasso.certificate import Certificate, certify
from lassokin_ros.core.lasso.solver import KKT_TOLERANCE

CLIPS = ("01_01", "02_05", "49_18", "exp_soccer_1", "gs_charleston2", "13_31")
CUTS = (0.0, 1e-8, 1e-6, 1e-4)
FAILED = 1e-2
IN_A_ROW = 10
"""Number of problems that a method solves before the next method runs."""
COLUMNS = {
    "method": "<",
    "p50_us": ".0f",
    "p5_us": ".0f",
    "p99_us": ".0f",
    "first_us": ".0f",
    "ratio": ".2f",
    "kkt_p50": ".1e",
    "kkt_p99": ".1e",
    "gap_p99": ".1e",
    "certified_percent": ".1f",
    "failed_percent": ".1f",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    formulations.TOLERANCE = options.tolerance
    every = formulations.methods()
    unknown = [part for part in options.methods or () if not any(part in name for name in every)]
    if unknown:
        raise SystemExit(f"no method's name has {', '.join(unknown)}; expected parts of: {'; '.join(every)}")
    chosen = {name: method for name, method in every.items() if _wanted(name, options.methods)}
    folder = options.data or data_folder() / "mocap"
    clips = options.clips
    files = [folder / f"{name}.npz" for name in clips]
    lacking = [file.stem for file in files if not file.is_file()]
    if lacking or not files:
        there = ", ".join(file.stem for file in sorted(folder.glob("*.npz"))) or "no clips (*.npz)"
        raise SystemExit(f"no clip {', '.join(lacking)} in {folder}; it has: {there} (--clips, --data, LASSOKIN_DATA)")
    jobs = [experiment.Job(file, 0, "lasso", landmarks=options.landmarks, seed=options.seed) for file in files]
    records: list[Record] = []
    print(f"{options.landmarks}, 60 Hz, 2 px; lassos of {', '.join(clips)}; one thread; turns of {IN_A_ROW} problems.")
    for kind in options.kinds:
        problems = record(kind, jobs, options.problems)
        if not problems:
            raise SystemExit(f"no lasso came up in {', '.join(clips)}; expected clips of 2 frames or more")
        rows, columns = problems[0].problem.A.shape
        measured = measure(kind, problems, chosen)
        print(f"\n{kind}: {len(problems)} problems, A {rows} x {columns}")
        print(table(measured, COLUMNS))
        records += measured
    write_json(options.json, records)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = option_types.command_line(__doc__, "seed")
    result.add_argument(
        "--data", type=Path, help="folder of clips (default: mocap/ in LASSOKIN_DATA or ../shared/data)"
    )
    result.add_argument("--clips", type=option_types.names, default=list(CLIPS), help="comma-separated names")
    result.add_argument("--problems", type=option_types.count, default=200, help="per kind (200)")
    kinds = option_types.some_of(KINDS)
    result.add_argument("--kinds", type=kinds, default=list(KINDS), help=f"comma-separated, of {','.join(KINDS)} (all)")
    result.add_argument("--methods", type=_parts, help="comma-separated parts of names, beside the default (all)")
    result.add_argument(
        "--tolerance", type=option_types.positive, default=1e-10, help="asked of the peers (1e-10: most are certified)"
    )
    result.add_argument("--landmarks", default="coco17")
    return result


def _parts(text: str) -> list[str]:
    """Parts of method names, which contain blanks, separated by commas."""
    return [part.strip() for part in text.split(",") if part.strip()]


def _wanted(name: str, parts: Sequence[str] | None) -> bool:
    return parts is None or name.startswith("default (") or any(part in name for part in parts)


def measure(kind: str, problems: Sequence[Recorded], chosen: dict[str, Method]) -> list[Record]:
    """One record per method over all problems. The order of the methods changes from turn to turn."""
    names = list(chosen)
    microseconds = {name: np.full(len(problems), np.nan) for name in names}
    certificates: dict[str, list[Certificate | None]] = {name: [] for name in names}
    for name in names:
        _run(chosen[name], problems[0])  # objects that are created on first use are not timed
    for turn, first in enumerate(range(0, len(problems), IN_A_ROW)):
        for name in names[turn % len(names) :] + names[: turn % len(names)]:
            for i, recorded in enumerate(problems[first : first + IN_A_ROW], first):
                unsolved = recorded.anew()
                start = time.perf_counter_ns()
                answer = _run(chosen[name], unsolved)
                microseconds[name][i] = (time.perf_counter_ns() - start) / 1000
                certificates[name].append(certified(recorded, answer))
    base = np.median(microseconds[names[0]])
    return [{"kind": kind, **_record(name, microseconds[name], certificates[name], base)} for name in names]


def _run(method: Method, recorded: Recorded) -> Answer | None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return method(recorded)
        except Exception:  # an error of another solver is a result; it is counted
            return None


def certified(recorded: Recorded, answer: Answer | None) -> Certificate | None:
    """The certificate of an answer after the best cut; None if there is no finite answer."""
    if answer is None or not all(np.isfinite(part).all() for part in answer):
        return None
    p, (omega, x) = recorded.problem, answer
    size = np.abs(omega)
    cuts = (np.where(size <= cut * size.max(), 0.0, omega) for cut in CUTS)
    return min((certify(p.A, p.B, p.z, p.alpha, cut, x) for cut in cuts), key=lambda c: c.kkt_residual)


def _record(name: str, microseconds: np.ndarray, certificates: Sequence[Certificate | None], base: float) -> Record:
    kkt = np.array([np.inf if c is None else c.kkt_residual for c in certificates])
    gap = np.array([np.inf if c is None else abs(c.relative_gap) for c in certificates])
    return {
        "method": name,
        "problems": len(kkt),
        "p50_us": float(np.median(microseconds)),
        "p5_us": float(np.percentile(microseconds, 5)),
        "p99_us": float(np.percentile(microseconds, 99)),
        "first_us": float(np.median(microseconds[::IN_A_ROW])),
        "ratio": float(np.median(microseconds) / base),
        "kkt_p50": float(np.percentile(kkt, 50, method="lower")),
        "kkt_p99": float(np.percentile(kkt, 99, method="lower")),
        "gap_p99": float(np.percentile(gap, 99, method="lower")),
        "certified_percent": 100 * float(np.mean(kkt <= KKT_TOLERANCE)),
        "failed_percent": 100 * float(np.mean(~(kkt <= FAILED))),
    }


if __name__ == "__main__":
    sys.exit(exit_code(main))
