"""Output of benchmarks/accuracy.py: a head with runs and inputs, rows, and a summary."""

from __future__ import annotations

import argparse
from typing import Any, Mapping, Sequence

import numpy as np

from benchmarks.accuracy_run import anatomy
from benchmarks.accuracy_run.options import given
from benchmarks.common.report import Record, summarise, table
from benchmarks.data.recordings import counts_apart, recording_files, recording_group
from training.pose_prior import TRAINING

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
_POSITIONS = ("mpjpe_mm", "pa_mpjpe_mm", "root_mm", "over_100mm_percent")
BY_PERSON = {key: COLUMNS[key] for key in _POSITIONS} | anatomy.COLUMNS
"""Columns of the tables by person."""
LEARNED = {"lengths_given": ".3f", "lengths_learned": ".3f"}
"""Root mean square of seven log-lengths about the person's own, at the same size: at the start and at the end."""
HEIGHT = {"height_percent": ".1f"}
"""Error of the measured height, of the clip's."""
FLOOR = {"penetration_mm": ".1f"}
"""How far ankles are below the floor."""
GAP = {"before_mm": ".1f", "gap_end_mm": ".1f", "after_mm": ".1f", "after_no_gap_mm": ".1f", "rise_mm": ".1f"}
INITIALISATION = {"init_median_mm": ".1f", "init_p90_mm": ".1f", "front_back_percent": ".1f", "ms_p50": ".0f"}

PRIOR_SHIPPED = f"Prior learned from these and other takes of them, which are left out: {' '.join(TRAINING)}"


def report(options: argparse.Namespace, records: Sequence[Record]) -> None:
    """Print head, rows and summary."""
    print(detections_head(options) if options.detections else head(options))
    if not records:
        print("nothing to measure: no clip is long enough")
        return
    if options.detections:
        print(recordings_table(records))
        print(f"\n{joint_table(records)}" if options.joints else "", end="")
        return
    columns = GAP if options.gap else COLUMNS | (HEIGHT if options.unknown_height else {})
    if options.mount and not options.gap:
        columns |= FLOOR
    if options.initialisation:
        print(table(initialisation_rows(records), {"method": "<", "frames": "d", "found": "d", **INITIALISATION}))
        return
    seed = {"seed": "d"} if options.seeds > 1 else {}
    lead = {"clip": "<", "view": "d"} | seed | {"method": "<"} | ({} if options.gap else {"frames": "d"})
    print(f"{table(records, lead | columns)}\n")
    lead = {"method": "<", "statistic": "<", "runs": "d"}
    print(table(summarise(records, ["method"], list(columns)), lead | columns))
    if not options.gap:
        print(f"\n{table(summarise(records, ['method'], anatomy.FIGURES), lead | anatomy.COLUMNS)}")
    if options.test_people or options.validation_people:
        print(f"\n{person_table(records, GAP if options.gap else BY_PERSON)}")
    if options.joints and not options.gap:
        print(f"\n{joint_table(records)}")


def recordings_table(records: Sequence[Record]) -> str:
    """Real recordings in one table, by person: each camera, then the mean of each group (`recording_group`)."""
    columns = BY_PERSON | LEARNED | {key: COLUMNS[key] for key in ("accel_error", "reprojection_px", "flips_percent")}
    rows: list[Record] = []
    for method in dict.fromkeys(r["method"] for r in records):
        runs = [r for r in records if r["method"] == method]
        people = list(dict.fromkeys(r["person"] for r in runs))
        rows += [r for person in people for r in runs if r["person"] == person]
        means = [row for person in people for row in _group_means([r for r in runs if r["person"] == person], columns)]
        rows += means
        counted = [row for row in means if not counts_apart(row["person"])]
        apart = [row for row in means if counts_apart(row["person"])]
        for group in filter(None, (counted, apart)):
            of = len({row["person"] for row in group})
            row = {"person": "mean", "clip": f"{len(group)} groups of {of} people", "view": "all", "method": method}
            rows.append({**mean_of(group, columns), **row})
    return table(rows, {"person": "<", "clip": "<", "view": "d", "method": "<", "frames": "d"} | columns)


def _group_means(records: Sequence[Record], columns: Mapping[str, str]) -> list[Record]:
    """The mean over the cameras and recordings of each group of one person."""
    rows = []
    for name in dict.fromkeys(recording_group(r["clip"]) for r in records):
        group = [r for r in records if recording_group(r["clip"]) == name]
        described = {key: group[0][key] for key in ("person", "method")}
        rows.append({**mean_of(group, columns), **described, "clip": name, "view": "mean"})
    return rows


def mean_of(records: Sequence[Record], columns: Mapping[str, str]) -> Record:
    """The mean of each figure over records, NaN left out, and the sum of their frames."""
    values = {key: np.array([r[key] for r in records], dtype=float) for key in columns}
    known = {key: float(np.nanmean(v)) if np.isfinite(v).any() else float("nan") for key, v in values.items()}
    return {**known, "frames": sum(r.get("frames", 0) for r in records)}


def person_table(records: Sequence[Record], columns: Mapping[str, str]) -> str:
    """The mean over each person's runs, by method, and the mean over the people, which many short clips do not sway."""
    rows = []
    for method in dict.fromkeys(r["method"] for r in records):
        runs = [r for r in records if r["method"] == method]
        people = [r for r in summarise(runs, ["person"], list(columns)) if r["statistic"] == "mean"]
        mean = mean_of(people, columns)
        rows += [{**row, "method": method} for row in people]
        rows.append({"method": method, "person": "mean of people", "runs": len(runs), **mean})
    return table(rows, {"method": "<", "person": "<", "runs": "d"} | columns)


def joint_table(records: Sequence[Record]) -> str:
    """Each joint's error and its part along the optical axis, mean over the runs, by method; worst joint first."""
    rows = []
    for method in dict.fromkeys(r["method"] for r in records):
        runs = [r["joints_mm"] for r in records if r["method"] == method and "joints_mm" in r]
        joints = dict.fromkeys(joint for run in runs for joint in run)
        means = {joint: np.mean([run[joint] for run in runs if joint in run], axis=0) for joint in joints}
        for joint, (distance, depth) in sorted(means.items(), key=lambda item: -item[1][0]):
            rows.append({"method": method, "joint": joint, "error_mm": distance, "depth_mm": depth})
    return table(rows, {"method": "<", "joint": "<", "error_mm": ".0f", "depth_mm": ".0f"})


def head(options: argparse.Namespace) -> str:
    """The run on clips, in words, and the options that differ from their defaults (see --help)."""
    skeleton = "the height alone" if options.generic_skeleton else "bone lengths and trunk at rest"
    if options.unknown_height:
        skeleton = "nothing (height 0)"
    noise = options.tracker_noise_px or max(1.0, options.noise_px)
    chosen = " ".join(_typed(name, value) for name, value in given(options).items())
    return (
        f"{options.fps:g} Hz, noise {options.noise_px:g} px, {options.landmarks}; {options.views} views per clip, "
        f"{_seeds(options)}. Options: {chosen or 'default'}.\n"
        f"Given of each clip: {skeleton}; noise {noise:g} px. Automatic initialisation.\n{PRIOR_SHIPPED}\n"
        f"Times with {options.jobs} processes at once, one thread each.\n"
    )


def _typed(name: str, value: Any) -> str:
    """An option as it is typed."""
    listed = ",".join(map(str, value)) if isinstance(value, (list, tuple)) else value
    return name if value is True else f"{name} {listed}"


def _seeds(options: argparse.Namespace) -> str:
    last = options.seed + options.seeds - 1
    return f"seed {options.seed}" if last == options.seed else f"seeds {options.seed} to {last}"


def detections_head(options: argparse.Namespace) -> str:
    """The run on real detections, in words."""
    height = "the height at which the built-in proportions give the reference's limbs and trunk their length"
    known = height + (", and the reference's bones" if options.measured_bones else " alone")
    return (
        f"Real detections: {', '.join(f.name for f in recording_files(options.detections))}; one camera at a time.\n"
        f"Given: {known}. Settings {given_settings(options) or 'default'}. Automatic initialisation.\n"
        "Limb joints against the multi-camera 3D reference, aligned at the middle of the hips (no hips in view: of the "
        "shoulders).\nThe reference is the detector's own points triangulated; 2-4 cm of bias are its own.\n"
    )


def initialisation_rows(records: Sequence[Record]) -> list[Record]:
    """One row per method. Figures are for the frames with an estimate."""
    rows = []
    for method in dict.fromkeys(r["method"] for r in records):
        group = [r for r in records if r["method"] == method]
        found = [r for r in group if np.isfinite(r["init_mpjpe_mm"])]
        error = np.array([r["init_mpjpe_mm"] for r in found] or [np.nan])
        rows.append({
            "method": method,
            "frames": len(group),
            "found": len(found),
            "init_median_mm": float(np.median(error)),
            "init_p90_mm": float(np.percentile(error, 90)),
            "front_back_percent": 100 * float(np.mean([r["yaw_error_deg"] > 90 for r in found] or [np.nan])),
            "ms_p50": float(np.median([r["init_ms"] for r in found] or [np.nan])),
        })  # fmt: skip
    return rows


def given_settings(options: argparse.Namespace) -> dict[str, Any]:
    """Settings of the tracker that the command line gives."""
    noise = {} if options.tracker_noise_px is None else {"noise_px": options.tracker_noise_px}
    height = {"height": 0.0} if options.unknown_height else {}
    return {**noise, **height, **dict(options.set)}
