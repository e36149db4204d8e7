"""How well the report's marks tell a wrong pose, on recordings with a 3D reference; and what two passes change.

    python benchmarks/accuracy_run/doubt.py ../shared/data/detections/*.npz             # as a live camera
    python benchmarks/accuracy_run/doubt.py --two-pass ../shared/data/detections/*.npz  # as `track` does

One line per camera: mean joint error relative to the hips, median second difference of the wrists and of the ankles
from frame to frame relative to the pelvis, share of the frames over 150 mm, share of the marked frames, and whether the
page says a doubt.
A recording is bad if more than 5 % of its frames are over 150 mm. Only the height is given.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

from benchmarks.common.report import Record, table
from benchmarks.data.detections import JOINTS, DetectionJob, Recording, detection_jobs, prepared
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.recording import WHOLE_FILE, published, track_recording
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.doubt.doubt import (
    Doubt,
    signs_of,
)
from lassokin_ros.doubt.monitor import DoubtMonitor
from lassokin_ros.replay.report.findings import MOST_MARKED
from lassokin_ros.replay.spans import marked, wrong_spans

ENDS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")
"""The joints whose shake is measured, relative to the pelvis."""
GOOD_MM, WRONG_MM, BAD_SHARE = 60.0, 150.0, 0.05
COLUMNS = {"recording": "<42", "frames": "5d", "mpjpe_mm": "6.1f", "wrist_shake_mm": "6.1f", "ankle_shake_mm": "6.1f"}
COLUMNS |= {"over_150": "6.1%", "marked": "6.1%", "says": "<6"}


@dataclass(frozen=True)
class Row:
    """A tracked frame. error: mm. ends: (4, 3) m, see `ENDS`."""

    time: float
    doubt: Doubt
    error: float
    ends: np.ndarray


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table and the totals."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE")
    parser.add_argument("--two-pass", action="store_true", help="as a file, see lassokin_ros.core.recording")
    options = parser.parse_args(arguments)
    jobs = detection_jobs(options.files, ["lasso"], False, {})
    records = [record(job, options.two_pass) for job in jobs]
    print(table(records, COLUMNS))
    print("\n".join(totals(records)))


def record(job: DetectionJob, two_pass: bool) -> Record:
    """Track one camera and mark its frames."""
    recording, config, skeleton = prepared(job)
    tracker, instants = Tracker(config, skeleton), [[one] for one in recording.observations]
    estimates = (
        track_recording(replace(config, **WHOLE_FILE), instants, skeleton) if two_pass else published(tracker, instants)
    )
    rows = _rows(estimates, tracker, recording)
    times, error = np.array([row.time for row in rows]), np.array([row.error for row in rows])
    spans = wrong_spans(times, [row.doubt for row in rows])
    marks = marked(times, spans)
    doubt = any(span.certain_sign for span in spans) or marks.mean() > MOST_MARKED
    shake = 1000 * np.linalg.norm(np.diff([row.ends for row in rows], n=2, axis=0), axis=-1)
    return {
        "recording": f"{recording.name}:{job.camera}",
        "frames": len(rows),
        "mpjpe_mm": float(np.nanmean(error)),
        "wrist_shake_mm": float(np.median(shake[:, :2])),
        "ankle_shake_mm": float(np.median(shake[:, 2:])),
        "over_150": float(np.mean(error[np.isfinite(error)] > WRONG_MM)),
        "marked": float(marks.mean()),
        "says": "doubt" if doubt else "",
        "error": error,
        "marks": marks,
    }


def _rows(estimates: Iterable[Estimate], tracker: Tracker, recording: Recording) -> list[Row]:
    """Follow the doubts of the estimates. tracker: any, of this layout and height."""
    monitor = DoubtMonitor(tracker.layout.names, tracker.skeleton.joint_names)
    frame_of = {observation.stamp: frame for frame, observation in enumerate(recording.observations)}
    rows = []
    for estimate in estimates:
        if estimate.pose is None or estimate.visible is None:
            continue
        frame, joints = frame_of[estimate.stamp], estimate.pose.positions
        height = tracker.skeleton.height
        doubt = monitor.update(signs_of(estimate, recording.points[frame], recording.focal, height))
        ends = joints[[tracker.skeleton.index(name) for name in ENDS]] - joints[0]
        error = _error(estimate.pose.landmarks, recording.reference[frame], tracker.layout)
        rows.append(Row(estimate.stamp, doubt, error, ends))
    return rows


def _error(found: np.ndarray, truth: np.ndarray, layout: Layout) -> float:
    """Return the mean error of the joints that the reference has, mm, relative to the hips or the shoulders; or NaN."""
    pairs = [[layout.index(f"{side}_{part}") for side in ("left", "right")] for part in ("hip", "shoulder")]
    root = next((pair for pair in pairs if np.isfinite(truth[pair]).all()), None)
    if root is None:
        return float("nan")
    index = [layout.index(name) for name in JOINTS.values()]
    off = (found[index] - found[root].mean(axis=0)) - (truth[index] - truth[root].mean(axis=0))
    return 1000 * float(np.nanmean(np.linalg.norm(off, axis=-1)))


def _share(marks: np.ndarray) -> str:
    return f"{marks.mean():.0%}" if len(marks) else "there are none"


def totals(records: Sequence[Record]) -> list[str]:
    """Return the lines below the table."""
    error, marks = (np.concatenate([one[key] for one in records]) for key in ("error", "marks"))
    bad = [one for one in records if one["over_150"] > BAD_SHARE]
    good = [one for one in records if one["over_150"] <= BAD_SHARE]
    means = [float(np.mean([one[key] for one in records])) for key in ("mpjpe_mm", "wrist_shake_mm", "ankle_shake_mm")]
    return [
        f"mean of the recordings: {means[0]:.1f} mm, wrists {means[1]:.1f} mm, ankles {means[2]:.1f} mm",
        f"frames over {WRONG_MM:.0f} mm: {np.count_nonzero(error > WRONG_MM)} of {len(error)}",
        f"frames over {WRONG_MM:.0f} mm that are marked: {_share(marks[error > WRONG_MM])}",
        f"frames under {GOOD_MM:.0f} mm that are not marked: {1 - marks[error < GOOD_MM].mean():.1%}",
        f"bad recordings without a doubt: {sum(not one['says'] for one in bad)} of {len(bad)}",
        f"good recordings with a doubt: {sum(bool(one['says']) for one in good)} of {len(good)}",
    ]


if __name__ == "__main__":
    main()
