"""Replay an archive of recordings. The result of each recording is the same as that of a separate replay.

A recording that cannot be read, or whose worker process dies repeatedly, becomes a line of the final table. A complete
output with the same input and settings is not computed again (see `replay.record`), so an interrupted command can be
continued by running it again.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from lassokin_ros.archive.runners import in_processes, on_cluster
from lassokin_ros.archive.tasks import DONE_BEFORE, PAGE, SKELETON, TRACKED, ArchiveError, Result, Task, check_files
from lassokin_ros.common.command_line import print_summary
from lassokin_ros.common.interruption import Interrupted
from lassokin_ros.common.progress import Progress
from lassokin_ros.core.yaml_files import user_path
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.replay.output_paths import check_output_paths
from lassokin_ros.replay.record import origin_of, record_of
from lassokin_ros.replay.recording_files import SUFFIXES, recording_name

FAILED = 2
"""Exit code if a recording has no output."""


def is_archive(options: argparse.Namespace) -> bool:
    """Return True for several recordings, for a folder of recordings, and with --scheduler."""
    return len(options.bags) > 1 or options.scheduler is not None or bool(_inside(options.bags[0]))


def replay_archive(options: argparse.Namespace) -> int:
    """Replay options.bags into the folder options.output, print the table and return the exit code.

    Raises a LassokinError if the settings cannot be used or if two outputs would have the same name.
    """
    check_files(options)
    tasks = tasks_of(options)
    origin_of(tasks[0].options)  # raises once for unusable settings, before any work starts
    runner = in_processes(options.jobs) if options.scheduler is None else on_cluster(options.scheduler)
    progress = Progress(len(tasks), "recordings")
    results: dict[str, Result] = {}
    try:
        with closing(runner(tasks)) as outcomes:
            for result in outcomes:
                results[result.name] = result
                progress.advance(note=f"{result.name}: {result.outcome}")
    except Interrupted:
        done = sum(result.succeeded for result in results.values())
        message = f"{done} of {len(tasks)} recordings are done; run the same command again to continue"
        raise Interrupted(message) from None
    finally:
        progress.close()
    print_summary(table([results[task.name] for task in tasks]))
    return 0 if all(result.succeeded for result in results.values()) else FAILED


def tasks_of(options: argparse.Namespace) -> list[Task]:
    """Return one task per recording, by name, and create the output folders. Raises ArchiveError, OutputError."""
    folder = (options.output or Path()).absolute()
    if (folder / "metadata.yaml").exists() or folder.is_file():
        raise ArchiveError(f"'{folder}' cannot hold several outputs; choose another folder with --output")
    tasks: dict[Path, Task] = {}
    for argument in options.bags:
        for bag, name in _inside(argument) or [(argument, recording_name(argument.resolve()))]:
            output = folder / f"{name}_tracked"
            if output in tasks:
                raise ArchiveError(
                    f"'{tasks[output].options.bag}' and '{bag.absolute()}' would both be written to '{output}'; "
                    "pass a common parent folder, or rename one recording"
                )
            alone = copy.copy(options)
            alone.bag, alone.output, alone.bags = bag.absolute(), output, [bag.absolute()]
            alone.params_file = [file.absolute() for file in options.params_file]
            alone.p = [*options.p, *_own_files(options)]
            for option, suffix in (("camera_info", None), ("report", PAGE), ("save_skeleton", SKELETON)):
                if (given := getattr(options, option)) is not None:
                    own = given.absolute() / f"{name}{suffix}" if suffix else given.absolute()
                    setattr(alone, option, own)
            tasks[output] = Task(name, alone)
    check_output_paths([task.options for task in tasks.values()])
    written = [(one.output, one.report, one.save_skeleton) for one in (task.options for task in tasks.values())]
    for needed in {path.parent for paths in written for path in paths if path is not None}:
        try:
            needed.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ArchiveError(f"'{needed}' cannot be created: {error.strerror}") from None
    return sorted(tasks.values(), key=lambda task: task.name)


def _inside(folder: Path) -> list[tuple[Path, str]]:
    """Return (recording, path relative to the folder without suffix); empty if it is not a folder of recordings.

    Hidden folders and outputs of `replay` are skipped. Links to folders elsewhere are followed; what they point to
    inside the folder is found there.
    """
    if not folder.is_dir() or (folder / "metadata.yaml").exists():
        return []
    found, root = [], Path(os.path.realpath(folder))
    visited = {root}

    def is_new(place: Path) -> bool:
        real = Path(os.path.realpath(place))
        if place.name[0] == "." or real in visited or place.is_symlink() and root in real.parents:
            return False
        visited.add(real)
        return True

    for here, inside, files in os.walk(folder, followlinks=True):
        place = Path(here)
        if "metadata.yaml" in files:
            inside.clear()
            bags = [] if record_of(place) else [place]
        else:
            bags = [place / file for file in files if Path(file).suffix in SUFFIXES and file[0] != "."]
        inside[:] = [name for name in sorted(inside) if is_new(place / name)]
        found += [(bag, str(bag.parent.relative_to(folder) / recording_name(bag))) for bag in bags]
    return found


def _own_files(options: argparse.Namespace) -> list[str]:
    """Return assignments with the full paths of the files that settings name: a worker has another current folder."""
    tracker, _ = offline_settings(options.params_file, options.p)
    files = {"skeleton": user_path(tracker.skeleton), "landmarks": user_path(tracker.landmarks)}
    return [f"{name}:={json.dumps(str(file.absolute()))}" for name, file in files.items() if file.is_file()]


def table(results: Sequence[Result]) -> str:
    """Return the table: one line per recording, and the number of each outcome."""
    head = ("recording", "frames in", "out", "lost", "reprojection px", "ms/frame", "result")
    rows = [head, *map(_row, results)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(head) - 1)]
    lines = []
    for row in rows:
        numbers = (f"{text:>{width}}" for text, width in zip(row[1:-1], widths[1:]))
        lines.append("  ".join([f"{row[0]:<{widths[0]}}", *numbers, row[-1]]))
    kinds = [result.outcome.partition(":")[0] for result in results]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys([TRACKED, DONE_BEFORE, *kinds]))
    return "\n".join([*lines, f"{len(results)} recordings: {counts}"])


def _row(result: Result) -> tuple[str, ...]:
    figures = result.figures
    if figures is None:
        return (result.name, *["-"] * 5, result.outcome)
    error = "-" if figures.reprojection_px is None else f"{figures.reprojection_px:.2f}"
    time = "-" if result.frame_ms != result.frame_ms else f"{result.frame_ms:.2f}"
    counts = map(str, (figures.frames_in, figures.frames_out, figures.lost))
    return (result.name, *counts, error, time, result.outcome)
