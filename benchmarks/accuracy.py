"""Accuracy of the tracker and of other methods, on motion capture seen by a simulated camera.

    python benchmarks/accuracy.py --data DIR [--noise-px 2 --missing 0.1 --outliers 0.05 --fps 60 ...] [--json FILE]

Every method gets the same keypoints and initialises by itself. Of each clip it is given what a user could measure:
the person's bone lengths, or with --generic-skeleton the height alone; and the detector's noise in pixels.
--initialisation measures first frames alone, --gap a stretch without any landmark, --detections FILE real detector
output. Clips that the shipped prior was learned from do not count: they are left out, or with --all-clips and --clips
run, marked with * and kept out of the summary.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from pathlib import Path
from typing import Any, Callable, Sequence, TypeVar

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.detections import detection_jobs, run_detections
from benchmarks.experiment import METHODS, Job, run
from benchmarks.learn_prior import TRAINING
from benchmarks.mocap import Condition
from benchmarks.report import Record, data_folder, summarise, table, write_json
from benchmarks.special import initialise_frames, run_gap
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import LassokinError

T = TypeVar("T")
COLUMNS = {
    "mpjpe_mm": ".1f",
    "pa_mpjpe_mm": ".1f",
    "root_mm": ".0f",
    "accel_error": ".1f",
    "reprojection_px": ".1f",
    "over_100mm_percent": ".1f",
    "flips_percent": ".1f",
    "init_mpjpe_mm": ".0f",
    "init_ms": ".0f",
    "frame_ms_p50": ".2f",
    "frame_ms_p99": ".2f",
}
INITIALISATION = {"init_median_mm": ".1f", "init_p90_mm": ".1f", "front_back_percent": ".1f", "ms_p50": ".0f"}
GAP = {"before_mm": ".1f", "gap_end_mm": ".1f", "after_mm": ".1f", "after_no_gap_mm": ".1f", "rise_mm": ".1f"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    try:
        records, columns = measure(options)
    except LassokinError as error:
        print(f"accuracy.py: {error}", file=sys.stderr)
        return 2
    report(options, records, columns)
    write_json(options.json, records)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add, switch = result.add_argument, argparse.BooleanOptionalAction
    add("--data", type=Path, help="folder of clips (default: mocap/ in LASSOKIN_DATA or ../shared/data)")
    add("--detections", type=Path, nargs="+", metavar="FILE", help="real detector output (npz) instead of clips")
    add("--noise-px", type=float, default=2.0, help="Gaussian noise of a keypoint, px (2)")
    add("--missing", type=float, default=0.0, help="share of keypoints missing, in bursts of 5-30 frames (0)")
    add("--outliers", type=float, default=0.0, help="share of keypoints 30-150 px off at full confidence (0)")
    add("--fps", type=float, default=60.0, help="frame rate, by leaving out frames (60)")
    add("--landmarks", default="coco17", help="landmark layout (coco17)")
    add("--views", type=int, default=2, help="cameras per clip (2)")
    add("--seed", type=int, default=0, help="of cameras, noise and bone errors (0)")
    add("--methods", type=_names, default=["lasso"], help=f"comma-separated, of {','.join(METHODS)} (lasso)")
    add("--clips", type=_names, help="comma-separated names (default: all but the training clips)")
    add("--all-clips", action="store_true", help="run the training clips too")
    add("--exclude-training", action=switch, default=None, help="default: on, unless --clips or --all-clips is given")
    add("--generic-skeleton", action="store_true", help="give the person's height alone")
    add("--measured-bones", action="store_true", help="with --detections: bones as the reference has them")
    add("--bone-error", type=float, default=0.0, help="standard deviation of the given bones' relative error (0)")
    add("--symmetric", action=switch, default=True, help="the same bone error on both sides (default)")
    add("--score-from", type=float, default=0.0, metavar="S", help="score frames after S s, of clips that last (0)")
    add("--tracker-noise-px", type=float, help="noise_px the methods are told (default: --noise-px, 1 or more)")
    add("--set", type=_setting, action="append", default=[], metavar="NAME=VALUE", help="any setting of the tracker")
    add("--initialisation", action="store_true", help="initialise from single frames spread over the clips")
    add("--per-clip", type=int, default=6, help="with --initialisation: frames per clip and view (6)")
    add("--gap", type=float, metavar="S", help="no landmark at all for S s in the middle of each clip")
    add("--jobs", type=int, default=os.cpu_count(), help="processes (one per core)")
    add("--json", type=Path, metavar="FILE", help="write the records as a JSON list")
    return result


def measure(options: argparse.Namespace) -> tuple[list[Record], dict[str, str]]:
    """The records of what the options ask for, and their table's columns."""
    _check_methods(options.methods)
    if options.detections:
        jobs = detection_jobs(options.detections, options.methods, options.measured_bones, _settings(options))
        return in_parallel(run_detections, jobs, options.jobs), _without(COLUMNS, "root_mm")
    jobs = [
        Job(file, view, method, _condition(options), options.landmarks, options.seed, options.generic_skeleton,
            options.bone_error, options.symmetric, _settings(options), options.score_from)
        for file in clip_files(options) for view in range(options.views) for method in options.methods
    ]  # fmt: skip
    if options.initialisation:
        arguments = [(job, options.per_clip) for job in jobs]
        return _marked([r for group in in_parallel(initialise_frames, arguments, options.jobs) for r in group]), {}
    if options.gap:
        gaps = [r for r in in_parallel(run_gap, [(job, options.gap) for job in jobs], options.jobs) if r]
        return _marked(gaps), GAP
    return _marked(in_parallel(run, jobs, options.jobs)), COLUMNS


def in_parallel(function: Callable[[Any], T], jobs: Sequence[Any], processes: int) -> list[T]:
    """function(job) of every job in the jobs' order, whatever the number of processes."""
    if processes <= 1 or len(jobs) == 1:
        return [function(job) for job in jobs]
    with multiprocessing.get_context("fork").Pool(min(processes, len(jobs))) as pool:
        return pool.map(function, jobs, chunksize=1)


def clip_files(options: argparse.Namespace) -> list[Path]:
    """The clips to run; SystemExit with a clear word when there are none."""
    folder = options.data or data_folder() / "mocap"
    files = sorted(folder.glob("*.npz"))
    if not files:
        raise SystemExit(f"no clips (*.npz) in {folder}: give --data, or set LASSOKIN_DATA to the shared data's folder")
    if options.clips:
        unknown = sorted(set(options.clips) - {file.stem for file in files})
        if unknown:
            raise SystemExit(f"no clip {', '.join(unknown)} in {folder}; it has: {', '.join(f.stem for f in files)}")
        files = [file for file in files if file.stem in options.clips]
    exclude = options.exclude_training
    if exclude is None:
        exclude = not (options.clips or options.all_clips)
    return [file for file in files if not (exclude and file.stem in TRAINING)]


def report(options: argparse.Namespace, records: Sequence[Record], columns: dict[str, str]) -> None:
    """Print head, rows and summary."""
    print(head(options))
    if not records:
        print("nothing to measure: no clip is long enough")
        return
    if options.initialisation:
        print(table(_initialisation_rows(records), {"method": "<", "frames": "d", **INITIALISATION}))
        return
    shown = [{**r, "clip": r["clip"] + (" *" if r.get("training") else "")} for r in records]
    lead = {"clip": "<", "view": "d", "method": "<"} | ({} if options.gap else {"frames": "d"})
    print(table(shown, lead | columns))
    by = ("clip", "method") if options.detections else ("method",)
    counted = [r for r in records if not r.get("training")]
    training = [r for r in records if r.get("training")]
    for title, group in (("", counted), ("training clips, not to be reported:", training)):
        if group:
            print(f"\n{title}".rstrip())
            print(
                table(
                    summarise(group, by, list(columns)),
                    dict.fromkeys((*by, "statistic"), "<") | {"runs": "d"} | columns,
                )
            )


def head(options: argparse.Namespace) -> str:
    """What was run, in words."""
    if options.detections:
        given = (
            "height and bones of the reference"
            if options.measured_bones
            else "height alone (from the reference's limbs)"
        )
        return (
            f"Real detections: {', '.join(f.name for f in options.detections)}; one camera at a time against the 3D "
            f"reference.\nGiven: {given}; settings {_settings(options) or 'default'}. Limb joints that both have, aligned at "
            "the middle of the hips (no hips in view: of the shoulders).\nThe reference is the detectors' points "
            "triangulated: a bias of 2-4 cm is its own.\n"
        )
    given = "the height alone" if options.generic_skeleton else "bone lengths and trunk at rest"
    if options.bone_error:
        kind = "the same left and right" if options.symmetric else "each by itself"
        given += f" wrong by {options.bone_error:.1%} at random ({kind})"
    noise = options.tracker_noise_px or max(1.0, options.noise_px)
    lines = [
        f"{options.fps:g} Hz, noise {options.noise_px:g} px, {options.missing:.0%} missing, {options.outliers:.0%} outliers, "
        f"{options.landmarks}; {options.views} views per clip, seed {options.seed}.",
        f"Given of each clip: {given}; noise {noise:g} px. Settings {dict(options.set) or 'default'}. "
        "Automatic initialisation.",
        f"Prior learned from (never in a summary): {' '.join(TRAINING)}",
        f"Times with {options.jobs} processes at once, one thread each.",
    ]
    if options.score_from:
        lines.append(f"Scored from {options.score_from:g} s on.")
    return "\n".join(lines) + "\n"


def _initialisation_rows(records: Sequence[Record]) -> list[Record]:
    import numpy as np

    rows = []
    for method in dict.fromkeys(r["method"] for r in records):
        group = [r for r in records if r["method"] == method and not r["training"]] or list(records)
        error = np.array([r["init_mpjpe_mm"] for r in group])
        rows.append({
            "method": method,
            "frames": len(group),
            "init_median_mm": float(np.nanmedian(error)),
            "init_p90_mm": float(np.nanpercentile(error, 90)),
            "front_back_percent": 100 * float(np.mean([r["yaw_error_deg"] > 90 for r in group])),
            "ms_p50": float(np.median([r["init_ms"] for r in group])),
        })  # fmt: skip
    return rows


def _marked(records: list[Record]) -> list[Record]:
    return [{**record, "training": record["clip"] in TRAINING} for record in records]


def _without(columns: dict[str, str], name: str) -> dict[str, str]:
    return {key: form for key, form in columns.items() if key != name}


def _condition(options: argparse.Namespace) -> Condition:
    return Condition(options.noise_px, options.missing, options.outliers, options.fps)


def _settings(options: argparse.Namespace) -> dict[str, Any]:
    told = {} if options.tracker_noise_px is None else {"noise_px": options.tracker_noise_px}
    return {**told, **dict(options.set)}


def _names(text: str) -> list[str]:
    return [name for name in text.replace(",", " ").split() if name]


def _setting(text: str) -> tuple[str, Any]:
    name, _, value = text.partition("=")
    if not hasattr(TrackerConfig(), name):
        raise argparse.ArgumentTypeError(f"the tracker has no setting '{name}'")
    kind = type(getattr(TrackerConfig(), name))
    return name, value.lower() in ("true", "1", "yes", "on") if kind is bool else kind(value)


def _check_methods(methods: Sequence[str]) -> None:
    unknown = [method for method in methods if method not in METHODS]
    if unknown:
        raise SystemExit(f"no method {', '.join(unknown)}; expected some of: {', '.join(METHODS)}")


if __name__ == "__main__":
    sys.exit(main())
