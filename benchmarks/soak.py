"""Soak test: hours of motion through the core, or minutes of the real node on real DDS.

    python benchmarks/soak.py [--hours 1]                                   # of motion at 60 Hz, as fast as the machine
    python benchmarks/soak.py --live [--minutes 10] [--people 4] [--hz 120] # the process `tracker`, fed over DDS
    python benchmarks/soak.py --live --minutes 6 --people 1 --hz 30         # 10,000 frames: memory, share of a core
    python benchmarks/soak.py --live --minutes 1 --people 1 --hz 30 --clock 1000  # in simulated time, as Gazebo's
    python benchmarks/soak.py --live --minutes 1 --people 1 --hz 30 --depth       # with depth images of 848 x 480 px
    python benchmarks/soak.py --live --address-space 1500 --descriptors 64        # under limits, as of a container

The table contains memory, file descriptors and latencies at the beginning and at the end, every counter, and the number
of messages that were lost without being counted. The exit code is 1 if a limit is exceeded. --json FILE writes the
figures. Linux only.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.common.report import Record, table, write_json  # isort: skip  (one thread, before numpy comes)
import numpy as np

from benchmarks.common.option_types import command_line, count
from benchmarks.data.people_in_view import HEIGHT, LANDMARKS, view
from benchmarks.timing.usage import Limits, Usage, latency_rows, row, usage_rows
from lassokin_ros.common.progress import Progress
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.demo.synthetic import WEBCAM
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Seen, Sight

HZ, CHUNK = 60.0, 1200
LARGEST_DEVIATION = 1e-9
COLUMNS = {"what": "<", "begin": "", "end": "", "holds": ""}


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; the exit code."""
    options = parser().parse_args(arguments)
    limits = Limits(options.address_space, options.descriptors)
    if options.depth and options.people != 1:
        parser().error("--depth has images of one person: add --people 1")
    if options.live:
        from benchmarks.timing.live_load import soak_live

        records = soak_live(options.minutes * 60, options.people, options.hz, options.clock, options.depth, limits)
    else:
        limits.apply()
        records = soak_core(round(options.hours * 3600 * HZ))
    print(table(records, COLUMNS))
    write_json(options.json, records)
    return int(any(record["holds"] == "NO" for record in records))


def parser() -> argparse.ArgumentParser:
    """Its options."""
    result = command_line(__doc__)
    result.add_argument("--hours", type=float, default=1.0, help="of motion through the core")
    result.add_argument("--live", action="store_true", help="the real node on real DDS instead")
    result.add_argument("--minutes", type=float, default=10.0, help="of the live run")
    result.add_argument("--people", type=int, default=4)
    result.add_argument("--hz", type=float, default=120.0, help="of the live run's keypoints")
    result.add_argument("--clock", type=float, default=0.0, metavar="HZ", help="of the live run's /clock (0: none)")
    result.add_argument("--depth", action="store_true", help="a depth image with each keypoint message (--people 1)")
    result.add_argument("--address-space", type=count, default=0, metavar="MB", help="limit of it (RLIMIT_AS)")
    result.add_argument("--descriptors", type=count, default=0, help="limit of open files (RLIMIT_NOFILE)")
    return result


def soak_core(frames: int) -> list[Record]:
    """Track one person frame by frame, and check the state after each."""
    body, lens = TrackedPerson(TrackerConfig(height=HEIGHT, landmarks=LANDMARKS)), WEBCAM.lens
    counts: Counter[str] = Counter()
    times, deviation, begin = np.zeros(frames, np.float32), 0.0, None
    progress = Progress(frames, "frames", plain_lines=10)
    for first in range(0, frames, CHUNK):
        seen = view(first, min(CHUNK, frames - first), HZ, 1)
        for number, (pixels, confidence) in enumerate(zip(seen.pixels[:, 0], seen.confidence[:, 0]), first):
            found = Seen(lens.normalise(pixels), confidence)
            start = time.perf_counter()
            (frame,) = body.track([Sight(round(number * 1e9 / HZ), found, lens)], "")
            times[number] = time.perf_counter() - start
            counts[frame.rejection or "accepted"] += 1
            if frame.accepted:
                deviation = max(deviation, _deviation(frame.estimate.state.rotations, frame.positions))
                counts["initialised"] += frame.estimate.initialised
        begin = begin or Usage.of()
        progress.advance(min(CHUNK, frames - first))
    progress.close()
    assert begin is not None
    return [
        *usage_rows(begin, Usage.of()),
        *latency_rows("step", 1e3 * times),
        row("frames", "", frames),
        *(row(f"frames, {key}", "", number) for key, number in sorted(counts.items())),
        row("largest element of R^T R - 1", "", f"{deviation:.1e}", deviation < LARGEST_DEVIATION),
    ]


def _deviation(rotations: np.ndarray, positions: np.ndarray) -> float:
    """Deviation of rotations (n, 3, 3) from orthonormality; infinite if a number is not finite."""
    if not (np.isfinite(positions).all() and np.isfinite(rotations).all()):
        return float("inf")
    return float(np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max())


if __name__ == "__main__":
    sys.exit(main())
