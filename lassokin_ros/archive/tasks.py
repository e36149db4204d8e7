"""One recording of an archive as a task, its result, and the files that belong to it: exports, report, skeleton.

Process pool and cluster run the same tasks.
"""

from __future__ import annotations

import argparse
import copy
import io
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path

from lassokin_ros.common.atomic_files import files_of_people
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.settings import SKELETON_SUFFIXES
from lassokin_ros.replay.bag_writer import remove_leftovers
from lassokin_ros.replay.record import Figures, origin_of, record_of
from lassokin_ros.replay.replay import replay

PAGE, SKELETON = ".html", ".yaml"


class ArchiveFilesError(LassokinError):
    """An option names one file for many recordings."""


def check_files(options: argparse.Namespace) -> None:
    """Raise a LassokinError for an option that names one file for all recordings."""
    skeleton = options.save_skeleton
    for option, file, suffixes in (("report", options.report, (PAGE,)), ("save-skeleton", skeleton, SKELETON_SUFFIXES)):
        if file is not None and file.suffix.lower() in suffixes:
            raise ArchiveFilesError(
                f"--{option} '{file}' names one file for many recordings; name a folder for one file per recording"
            )
    if options.export:
        from lassokin_ros.replay.exports.exports import check_archive_exports

        check_archive_exports(options.export)


def all_exist(options: argparse.Namespace) -> bool:
    """Return True if all files that the options request exist beside the output of a recording."""
    there = [page_exists(options), _skeleton_exists(options)]
    if options.export:
        from lassokin_ros.replay.exports.exports import PERSONS, target_of

        several = _several(options)
        for target in map(target_of, options.export):
            there.append(_exists(target.path(options.output), target.suffix, several and target.suffix in PERSONS))
    return all(there)


def page_exists(options: argparse.Namespace) -> bool:
    """Return True if the report exists, or none is requested."""
    return options.report is None or options.report.exists()


def kept_page(options: argparse.Namespace) -> str:
    """Return the words for a page that exists and is kept, without the images of --image-topic; empty without them."""
    if options.force or options.image_topic is None or options.report is None or not options.report.exists():
        return ""
    return ": the page exists and is kept, with the images it has; add --force for those of --image-topic"


def replacement_options(options: argparse.Namespace) -> argparse.Namespace:
    """Return the options to redo a recording in place of its old output, including the old output's exports.

    Without --force, files outside the output that exist are kept: only the missing ones are requested.
    """
    from lassokin_ros.replay.exports.exports import INSIDE, PERSONS, TABLES

    options = copy.copy(options)
    if not options.force and page_exists(options):
        options.report = options.image_topic = None
    if not options.force and _skeleton_exists(options):
        options.save_skeleton = None
    options.force, options.export = True, list(options.export)
    for file in sorted(options.output.glob(f"{INSIDE}*")):
        suffix = max((s for s in (*TABLES, *PERSONS) if file.name.endswith(s)), key=len, default="")
        if suffix and Path(suffix) not in options.export:
            options.export.append(Path(suffix))
    return options


def _skeleton_exists(options: argparse.Namespace) -> bool:
    """Return True if the saved skeleton exists, or that of any of several people, or none is requested."""
    file = options.save_skeleton
    return file is None or _exists(file, file.suffix, _several(options))


def _several(options: argparse.Namespace) -> bool:
    _, node_config = offline_settings(options.params_file, options.p)
    return node_config.several_people


def _exists(file: Path, suffix: str, each: bool) -> bool:
    """Return True if the file exists. each: there is one file per person instead."""
    if each:
        return bool(files_of_people(file.parent, file.name.removesuffix(suffix), suffix))
    return file.exists()


TRACKED, DONE_BEFORE = "tracked", "done before"


class ArchiveError(LassokinError):
    """The archive as a whole cannot be processed."""


@dataclass(frozen=True)
class Task:
    """One recording: its name in the table and its command line options. Tasks are pickled and sent to workers."""

    name: str
    options: argparse.Namespace


@dataclass(frozen=True)
class Result:
    """The result of a task. figures: None without an output. frame_ms: median ms per frame, NaN if not measured."""

    name: str
    outcome: str
    figures: Figures | None = None
    frame_ms: float = float("nan")

    @property
    def succeeded(self) -> bool:
        """True if the output exists."""
        return self.figures is not None


Runner = Callable[[Sequence[Task]], Generator[Result, None, None]]
"""Runs all tasks in any order and yields each result at once. Closing it early leaves no partial output."""


def run_task(task: Task) -> Result:
    """Run one task. It does not raise for bad recordings. The same task may run twice, also concurrently."""
    options = task.options
    try:
        done = _done_before(task)
        if done is not None:
            return done
        remove_leftovers(options.output)
        kept = ""
        if options.output.exists():  # same settings, but a newly requested export or report is missing
            options, kept = replacement_options(options), kept_page(options)
        replayed = replay(options, io.StringIO())
    except LassokinError as error:
        # Another worker that was presumed dead may have finished the task.
        return _done_before(task, quiet=True) or Result(task.name, f"failed: {error}")
    return Result(task.name, TRACKED + kept, replayed.figures, replayed.frame_ms)


def _done_before(task: Task, quiet: bool = False) -> Result | None:
    """Return the result if the complete output exists for this input and these settings, with all its files.

    Return None if the output must be computed. Raises ArchiveError, unless `quiet`, if the existing output has another
    input or other settings.
    """
    options = task.options
    if options.force or not options.output.exists():
        return None
    record = record_of(options.output)
    if record is not None and record.origin == origin_of(options):
        nobody = record.figures.frames_out == 0  # nothing to export or to save, but a page that says so
        done = page_exists(options) if nobody else all_exist(options)
        outcome = DONE_BEFORE + kept_page(options)
        return Result(task.name, outcome, record.figures) if done else None
    if quiet:
        return None
    raise ArchiveError(f"'{options.output}' exists, from another input, version or settings; add --force to replace it")
