"""Accuracy of the tracker and of other methods, on motion capture seen by a simulated camera.

    python benchmarks/accuracy.py --data DIR [--noise-px 2 --missing 0.1 --outliers 0.05 --fps 60 ...] [--json FILE]

Every method gets the same keypoints and initialises by itself. Its inputs are what a user could measure: the person's
bone lengths (with --generic-skeleton only the height), and the detector's noise in px.

--initialisation measures first frames only, --gap a period without landmarks, --detections FILE|DIR real detector
output, with one table by person, --videos FILE|DIR the keypoints of videos without a reference.
--uncertainty and --failure-probability compare the tracker's own figures of its error with the error. --realistic
--test-people gives the figures that a user can expect; --validation-people those with which a design is chosen.

Clips that the shipped prior was trained with, and of people of the network's training, are left out, unless --clips
names them: a line then says so.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from functools import partial
from pathlib import Path
from typing import Any, Callable, Sequence, TypeVar

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.accuracy_run import failure_probability
from benchmarks.accuracy_run.experiment import FILE, METHODS, Job, run
from benchmarks.accuracy_run.options import depth_sensor, parsed, told, unheeded
from benchmarks.accuracy_run.people import person_of, seen_by_network, test_clips, validation_clips
from benchmarks.accuracy_run.special import initialise_frames, run_gap
from benchmarks.accuracy_run.table import detections_head, given_settings, head, report
from benchmarks.accuracy_run.uncertainty import COLUMNS as UNCERTAINTY
from benchmarks.accuracy_run.uncertainty import (
    ROTATION_COLUMNS,
    binned,
    by_joint,
    rotation_uncertainty_of,
    uncertainty_of,
)
from benchmarks.accuracy_run.videos import VideoJob, run_video, video_files, video_table
from benchmarks.common.report import Record, data_folder, exit_code, table, write_json
from benchmarks.data.detections import detection_jobs, run_detections
from benchmarks.data.recordings import recording_files
from benchmarks.data.simulated_camera import Condition, rate_of
from benchmarks.methods.baselines import FOLLOWERS
from lassokin_ros.core.errors import LassokinError
from training.pose_prior import SEEN

T = TypeVar("T")


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parsed(__doc__, arguments)
    if options.videos:
        return _of_videos(options)
    records = measure(options)
    if not options.detections:
        print(_other_rates(options) + _of_training(options), end="")
    elif unheeded(options):
        print(f"No effect with --detections: {', '.join(unheeded(options))}.")
    if options.uncertainty or options.failure_probability:
        print(detections_head(options) if options.detections else head(options))
        print(f"\n{table(records, _columns(options))}")
        print(records[-1].get("ranking", "") if records else "")
    else:
        report(options, records)
        ends = [record["ends_lost"] for record in records if "ends_lost" in record]
        if ends:
            print(f"\nruns that end without an estimate of their last frame: {sum(ends)} of {len(ends)}")
    write_json(options.json, records)
    return 0


def _of_videos(options: argparse.Namespace) -> int:
    """Track keypoints without a reference, and print what can be said of them."""
    _check_methods(options)
    if unknown := sorted(set(options.methods) - set(FOLLOWERS)):
        raise SystemExit(f"no {', '.join(unknown)} for --videos; expected some of: {', '.join(FOLLOWERS)}")
    settings = given_settings(options)
    jobs = [VideoJob(file, method, settings) for file in video_files(options.videos) for method in options.methods]
    records = in_parallel(run_video, jobs, options.jobs)
    print(video_table(records))
    write_json(options.json, records)
    return 0


def _columns(options: argparse.Namespace) -> dict[str, str]:
    """The columns of the table of the tracker's own figures."""
    if options.uncertainty:
        return ROTATION_COLUMNS if options.rotations else UNCERTAINTY
    return failure_probability.COLUMNS


def measure(options: argparse.Namespace) -> list[Record]:
    """The records of what the options ask for."""
    _check_methods(options)
    if options.rotations and (options.detections or not options.uncertainty):
        raise SystemExit("--rotations is for --uncertainty on clips; no recording holds rotations")
    if options.detections:
        return _of_recordings(options)
    o = options
    condition = Condition(
        o.noise_px, o.missing, o.outliers, o.fps, o.swaps, o.camera_roll, o.camera_pitch, o.lying,
        o.wander_px, o.offset_px, depth_sensor(o), tuple(o.hidden), o.landmark_mm,
        o.peoples_proportions, o.swapped, o.swap_s,
    )  # fmt: skip
    methods = ["lasso"] if o.uncertainty or o.failure_probability else o.methods
    jobs = [
        Job(file, view, method, condition, o.landmarks, seed, o.generic_skeleton, o.bone_error, o.symmetric,
            given_settings(o), o.score_from, told(o))
        for seed in range(o.seed, o.seed + o.seeds)
        for file in clip_files(options) for view in range(o.views) for method in methods
    ]  # fmt: skip

    def results(function: Callable[[Job], T]) -> list[T]:
        return in_parallel(function, jobs, o.jobs)

    if o.uncertainty and o.rotations:
        return by_joint(results(rotation_uncertainty_of))
    if o.uncertainty:
        return binned(results(uncertainty_of))
    if o.failure_probability:
        return failure_probability.binned(results(failure_probability.failure_probabilities_of))
    if o.initialisation:
        groups = results(partial(initialise_frames, count=o.per_clip))
        records = [record for group in groups for record in group]
    elif o.gap:
        records = [record for record in results(partial(run_gap, seconds=o.gap)) if record]
    else:
        records = [record for record in results(run) if record["frames"] or record["ends_lost"]]
    people = {job.file.stem: person_of(job.file) for job in jobs}
    return [{**record, "person": people[record["clip"]]} for record in records]


def _of_recordings(options: argparse.Namespace) -> list[Record]:
    if options.gap or options.initialisation:
        raise SystemExit("--gap and --initialisation are for clips, not for --detections")
    own = options.uncertainty or options.failure_probability
    methods = ["lasso"] if own else options.methods
    files = recording_files(options.detections)
    recordings = detection_jobs(files, methods, options.measured_bones, given_settings(options))
    if options.uncertainty:
        return binned(in_parallel(uncertainty_of, recordings, options.jobs))
    if options.failure_probability:
        frames = in_parallel(failure_probability.failure_probabilities_of, recordings, options.jobs)
        return failure_probability.binned(frames)
    if not recordings:
        raise SystemExit("none of the --detections holds MediaPipe's own 3D, which mediapipe_world needs")
    return in_parallel(run_detections, recordings, options.jobs)


def in_parallel(function: Callable[[Any], T], jobs: Sequence[Any], processes: int) -> list[T]:
    """Call function(job) for every job; the results are in the jobs' order, for any number of processes."""
    if processes <= 1 or len(jobs) == 1:
        return [function(job) for job in jobs]
    with multiprocessing.get_context("fork").Pool(min(processes, len(jobs))) as pool:
        results = pool.map(partial(_without_exit, function), jobs, chunksize=1)
        pool.close()  # They end by themselves. rclpy, if imported here, would make the children ignore SIGTERM.
        pool.join()
        return results


def _without_exit(function: Callable[[Any], T], job: Any) -> T:
    """Call function(job). A SystemExit becomes another error: raised in a worker, it would block the pool for ever."""
    try:
        return function(job)
    except SystemExit as error:
        raise LassokinError(error) from None


def clip_files(options: argparse.Namespace) -> list[Path]:
    """The clips to run. Raises SystemExit with the reason if there are none."""
    if options.test_people:
        return test_clips(options.data or data_folder())
    if options.validation_people:
        return validation_clips(options.data or data_folder())
    folder = options.data or data_folder() / "mocap"
    files = sorted(folder.glob("*.npz"))
    if not files:
        raise SystemExit(f"no clips (*.npz) in {folder}: give --data, or set LASSOKIN_DATA to the shared data's folder")
    if options.clips:
        unknown = sorted(set(options.clips) - {file.stem for file in files})
        if unknown:
            raise SystemExit(f"no clip {', '.join(unknown)} in {folder}; it has: {', '.join(f.stem for f in files)}")
        return [file for file in files if file.stem in options.clips]
    return [file for file in files if not _trained_with(options, file)]


def _of_training(options: argparse.Namespace) -> str:
    trained = [file.stem for file in clip_files(options) if options.clips and _trained_with(options, file)]
    return f"Of a training, so these errors are not those of strangers: {', '.join(trained)}.\n" if trained else ""


def _trained_with(options: argparse.Namespace, file: Path) -> bool:
    """Whether the clip, or for the network its person, was part of a training."""
    by_network = dict(options.set).get("depth_prior", True) and seen_by_network(file)
    return by_network or file.stem in SEEN


def _other_rates(options: argparse.Namespace) -> str:
    """A line that lists the clips whose frame rate differs from --fps, with the rate used; empty if there are none."""
    rates = {file.stem: rate_of(file, options.fps) for file in clip_files(options)}
    others = [f"{name} {fps:.3g}" for name, fps in rates.items() if abs(fps - options.fps) > 0.01 * options.fps]
    return f"Not at {options.fps:g} Hz, but at: {', '.join(others)}.\n" if others else ""


def _check_methods(options: argparse.Namespace) -> None:
    unknown = [method for method in options.methods if method not in METHODS]
    if unknown or not options.methods:
        raise SystemExit(f"no method {', '.join(unknown)}; expected some of: {', '.join(METHODS)}")
    if "mediapipe_world" in options.methods and not options.detections:
        raise SystemExit("mediapipe_world is for --detections; no clip holds MediaPipe's own 3D")
    if options.initialisation and FILE in options.methods:
        raise SystemExit("--initialisation is for methods that go frame by frame; file looks ahead")


if __name__ == "__main__":
    sys.exit(exit_code(main))
