"""Mutation testing: how many small faults, each put into the code alone, do the tests of the changed module notice?

    make mutants                                   # 40 mutants of each usual room
    make mutants SAMPLE=100 SEED=7 ROOMS="core/lasso core/body"

A mutant is killed where a test fails or does not end; one that survives is printed with its change. The mutants are
drawn by the seed among all that cosmic-ray's operators can make: every place with the same probability.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(REPOSITORY))

from benchmarks.common.report import Record, table, write_json
from benchmarks.mutation.trial import Copy, Trial, difference, tests_of

ROOMS = {
    "core/lasso": "lassokin_ros/core/lasso",
    "core/body": "lassokin_ros/core/body",
    "core": "lassokin_ros/core",
    "pipeline": "lassokin_ros/pipeline",
    "pipeline/input_checks": "lassokin_ros/pipeline/input_checks",
    "pipeline/concerns": "lassokin_ros/pipeline/concerns",
    "msg_adapters": "msg_adapters",
    "node": "lassokin_ros/node",
    "replay": "lassokin_ros/replay",
}
USUAL = ("core/lasso", "core/body", "pipeline", "msg_adapters")
"""Rooms without --rooms. The tests of the others take longer."""
COLUMNS = {"room": "<16", "sampled": "d", "killed": "d", "timed_out": "d", "survived": "d", "score": "6.1%"}


def try_room(copy: Copy, room: str, mutants: Any) -> Iterator[Record]:
    """One record per mutant: room, path, line, operator, outcome (killed, timed out, survived), change."""
    usual: dict[tuple[str, ...], Trial] = {}
    for mutant in mutants:
        tests = tuple(tests_of(mutant.path, copy.repository))
        if tests not in usual:
            usual[tests] = copy.test(tests)
            if usual[tests].code != 0:
                code = usual[tests].code
                raise SystemExit(f"{' '.join(tests)} fail without a mutant (exit code {code}); mend them first")
        fast_first = sorted(tests, key=lambda file: usual[tests].seconds.get(file, 0.0))
        with copy.changed(mutant.path, mutant.code):
            trial = copy.test(fast_first, usual[tests])
        outcome = {0: "survived", None: "timed out"}.get(trial.code, "killed")
        original = mutant.path.read_text(encoding="utf-8")
        yield {
            "room": room,
            "path": str(mutant.path.relative_to(copy.repository)),
            "line": mutant.line,
            "operator": mutant.operator,
            "outcome": outcome,
            "seconds": trial.wall_s,
            "change": difference(original, mutant.code),
        }


def scores(records: list[Record]) -> list[Record]:
    """One row per room: number of mutants drawn, killed (including time-outs) and survived, and the share that was
    killed.
    """
    rows = []
    for room in dict.fromkeys(record["room"] for record in records):
        outcomes = [record["outcome"] for record in records if record["room"] == room]
        survived = outcomes.count("survived")
        row = {"room": room, "sampled": len(outcomes), "killed": len(outcomes) - survived, "survived": survived}
        rows.append({**row, "timed_out": outcomes.count("timed out"), "score": 1 - survived / len(outcomes)})
    return rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=list(USUAL), metavar="ROOM")
    parser.add_argument("--sample", type=int, default=40, help="mutants of each room")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    from benchmarks.mutation.mutants import sample

    os.environ.setdefault("LASSOKIN_FUZZ_CASES", "200")
    records: list[Record] = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = Copy(REPOSITORY, Path(folder))
        for room in options.rooms:
            paths = sorted((REPOSITORY / ROOMS[room]).rglob("*.py"))
            drawn = sample(paths, options.sample, random.Random(f"{options.seed} {room}"))
            for record in try_room(copy, room, drawn):
                records.append(record)
                print(f"{record['outcome']:<9} {record['path']}:{record['line']} {record['operator']}", flush=True)
                if record["outcome"] == "survived":
                    print(record["change"], flush=True)
                write_json(options.json, records)
    print(table(scores(records), COLUMNS))


if __name__ == "__main__":
    main()
