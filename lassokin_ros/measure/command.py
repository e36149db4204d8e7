"""The command `lassokin measure`: cadence, stride, speed and knees of a gait, or depth and angles of squats."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from lassokin_ros.common.atomic_files import AtomicFiles, refuse_existing
from lassokin_ros.common.distinct_paths import refuse_shared
from lassokin_ros.common.exit_codes import USAGE_ERROR
from lassokin_ros.common.summary_output import print_summary
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.measure import report
from lassokin_ros.measure.gait import measure_gait
from lassokin_ros.measure.poses import MeasureError, read_poses
from lassokin_ros.measure.squat import measure_squats

PROGRAM = "lassokin measure"
GAIT, SQUAT = "gait", "squat"
SMOOTHED = (
    "the motion is smoothed with later frames, so that the knee range is too small; for an unsmoothed one export it "
    "with -p smoothing:=0.02 -p smoothing_lag:=0.0"
)
"""Line below the measures of such a gait."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0, or 2 with one line on stderr."""
    options = _parser().parse_args(arguments)
    try:
        print_summary("\n".join(measure(options)))
    except LassokinError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return USAGE_ERROR
    return 0


def measure(options: argparse.Namespace) -> list[str]:
    """Measure the motion, write the requested files and return the lines of the table. Raises MeasureError."""
    wanted = [(what, path) for what, path in (("--plot", options.plot), ("--json", options.json)) if path is not None]
    refuse_shared([("the motion", options.motion)], wanted, MeasureError)
    for _, path in wanted:
        refuse_existing(path, options.force, MeasureError)
    if options.plot is not None and options.plot.suffix.lower() != ".svg":
        raise MeasureError(f"--plot '{options.plot}': expected a name that ends in .svg")
    poses = read_poses(options.motion, options.person)
    title = options.motion.name.encode(errors="backslashreplace").decode()  # a name may hold bytes that are not UTF-8
    if options.what == GAIT:
        gait = measure_gait(poses)
        lines, data, plot = report.gait_lines(gait), report.as_json(gait), report.gait_plot(gait, title)
        lines += [SMOOTHED] * (poses.smoothing > 0)
    else:
        squats = measure_squats(poses)
        lines, data, plot = report.squat_lines(squats), report.as_json(squats), report.squat_plot(squats, poses, title)
    lines += poses.unseen()
    with AtomicFiles(options.force, MeasureError) as files:
        if options.plot is not None:
            files.write_text(options.plot, plot)
        if options.json is not None:
            files.write_text(options.json, json.dumps(data, indent=1) + "\n")
    return lines


def _parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(prog=PROGRAM, description="Measure a gait or squats in an exported motion.")
    result.add_argument("what", choices=(GAIT, SQUAT))
    result.add_argument("motion", type=Path, metavar="NPZ", help="a .npz that --export of track or replay wrote")
    result.add_argument("--person", metavar="ID", help="whose motion, if the file has several people: p1")
    result.add_argument("--plot", type=Path, metavar="SVG", help="write a plot of the knees")
    result.add_argument("--json", type=Path, metavar="JSON", help="write the figures")
    result.add_argument("--force", action="store_true", help="replace files that exist")
    return result


if __name__ == "__main__":
    sys.exit(main())
