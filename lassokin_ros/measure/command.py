"""The command `lassokin measure`: the two sides of a gait, depth and angles of squats, repetitions of exercises."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lassokin_ros.common.atomic_files import AtomicFiles, refuse_existing, refuse_shared
from lassokin_ros.common.command_line import USAGE_ERROR, print_summary
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.measure import report
from lassokin_ros.measure.exercises import JOINT, measure_repetitions, measure_squats
from lassokin_ros.measure.gait import measure_gait
from lassokin_ros.measure.poses import UNSMOOTHED, MeasureError, NotTracked, Poses, poses_of

PROGRAM = "lassokin measure"
GAIT, SQUAT = "gait", "squat"
SMOOTHED = (
    "the motion is smoothed with later frames, so that the knee range is too small; for an unsmoothed one export it "
    "with -p smoothing:=0.02 -p smoothing_lag:=0.0"
)
"""Line below the measures of such a gait."""
SMOOTHING_S = UNSMOOTHED["smoothing"]
ENDINGS = {"--plot": ".svg", "--page": ".html"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0, or 2 with one line on stderr."""
    options, track = _parser().parse_known_args(arguments)
    options.track = track
    try:
        print_summary("\n".join(measure(options)))
    except LassokinError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return USAGE_ERROR
    except NotTracked as failure:
        return int(failure.args[0])
    return 0


def measure(options: argparse.Namespace) -> list[str]:
    """Measure the motions, write the requested files and return the lines of the table.

    Raises a LassokinError, or NotTracked.
    """
    outputs = (("--plot", options.plot), ("--json", options.json), ("--page", options.page))
    wanted = [(what, path) for what, path in outputs if path is not None]
    refuse_shared([("the motion", Path(source)) for source in options.sources], wanted, MeasureError)
    for what, path in wanted:
        refuse_existing(path, options.force, MeasureError)
        if what in ENDINGS and path.suffix.lower() != ENDINGS[what]:
            raise MeasureError(f"{what} '{path}': expected a name that ends in {ENDINGS[what]}")
    if options.what != GAIT and (len(options.sources) > 1 or options.page is not None):
        raise MeasureError(f"several motions and --page are for {GAIT}; expected one motion, and --plot or --json")
    passes = [poses_of(source, options.person, options.track) for source in options.sources]
    names = [Path(source).name for source in options.sources]
    title = ", ".join(names).encode(errors="backslashreplace").decode()  # a name may hold bytes that are not UTF-8
    lines, data, texts = _measured(options, passes, title)
    with AtomicFiles(options.force, MeasureError) as files:
        for what, path in wanted:
            files.write_text(path, json.dumps(data, indent=1) + "\n" if what == "--json" else texts[what])
    return lines


def _measured(options: argparse.Namespace, passes: list[Poses], title: str) -> tuple[list[str], Any, dict[str, str]]:
    """Return the lines of the table, the figures, and the texts of the files by option."""
    poses, unseen = passes[0], [line for one in passes for line in one.unseen()]
    if options.what == GAIT:
        gait = measure_gait(*passes)
        lines = report.gait_lines(gait)
        remarks = report.trust_lines(gait, passes) + [SMOOTHED] * any(one.smoothing > SMOOTHING_S for one in passes)
        page = report.gait_page(gait, title, remarks + unseen)
        texts = {"--plot": report.gait_plot(gait, title), "--page": page}
        return lines + remarks + unseen, report.as_json(gait), texts
    if options.what == SQUAT:
        squats = measure_squats(poses)
        plot = report.squat_plot(squats, poses, title)
        return report.squat_lines(squats) + unseen, report.as_json(squats), {"--plot": plot}
    found = measure_repetitions(poses, options.what)
    plot = report.repetition_plot(found, poses, options.what, title)
    return report.repetition_lines(found, options.what) + unseen, report.as_json(found), {"--plot": plot}


def _parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(
        prog=PROGRAM,
        allow_abbrev=False,
        description="Measure a gait, squats or other exercises in a video, or in an exported motion. Other options are "
        "those of lassokin track, such as --height and --fov.",
    )
    result.add_argument("what", choices=(GAIT, SQUAT, *JOINT))
    result.add_argument(
        "sources",
        nargs="+",
        metavar="VIDEO|NPZ",
        help="a video or keypoints, as of lassokin track, or a .npz of --export; passes of a walk count together",
    )
    result.add_argument("--person", metavar="ID", help="whose motion, if the file has several people: p1")
    result.add_argument("--plot", type=Path, metavar="SVG", help="write a plot of the knees or elbows")
    result.add_argument("--page", type=Path, metavar="HTML", help="write a page about a gait, to be printed")
    result.add_argument("--json", type=Path, metavar="JSON", help="write the figures")
    result.add_argument("--force", action="store_true", help="replace files that exist")
    return result


if __name__ == "__main__":
    sys.exit(main())
