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
from lassokin_ros.replay.exports.exports import INSIDE, PERSONS, TABLES, target_of
from lassokin_ros.replay.record import Figures, origin_of, record_of
from lassokin_ros.replay.replay import replay

PAGE, SKELETON = ".html", ".yaml"
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


def check_files(options: argparse.Namespace) -> None:
    """Raise a LassokinError for an option that names one file for all recordings."""
    skeleton = options.save_skeleton
    for option, file, suffixes in (("report", options.report, (PAGE,)), ("save-skeleton", skeleton, SKELETON_SUFFIXES)):
        if file is not None and file.suffix.lower() in suffixes:
            raise ArchiveError(
                f"--{option} '{file}' names one file for many recordings; name a folder for one file per recording"
            )
    for target in map(target_of, options.export):
        if target.folder is not None:
            raise ArchiveError(
                f"--export '{target.path(Path())}' names one file for many recordings; give the suffix alone, "
                f"--export {target.suffix}, for one file in each output folder"
            )


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
            options, kept = _to_replace(options), _kept_page(options)
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
        made = _made(options)
        nobody = record.figures.frames_out == 0  # nothing to export or to save, but a page that says so
        done = made["report"] if nobody else all(made.values())
        return Result(task.name, DONE_BEFORE + _kept_page(options), record.figures) if done else None
    if quiet:
        return None
    raise ArchiveError(f"'{options.output}' exists, from another input, version or settings; add --force to replace it")


def _made(options: argparse.Namespace) -> dict[str, bool]:
    """Return by option whether the files that it requests, if any, exist beside the output of a recording."""
    _, node_config = offline_settings(options.params_file, options.p)

    def there(file: Path, suffix: str, each: bool) -> bool:
        """each: there is one file per person instead."""
        stem = file.name.removesuffix(suffix)
        return bool(files_of_people(file.parent, stem, suffix)) if each else file.exists()

    page, skeleton, several = options.report, options.save_skeleton, node_config.several_people
    exports = [(one.path(options.output), one.suffix, several) for one in map(target_of, options.export)]
    return {
        "report": page is None or page.exists(),
        "save_skeleton": skeleton is None or there(skeleton, skeleton.suffix, several),
        "export": all(there(path, suffix, each and suffix in PERSONS) for path, suffix, each in exports),
    }


def _to_replace(options: argparse.Namespace) -> argparse.Namespace:
    """Return the options to redo a recording in place of its old output, including the old output's exports.

    Without --force, files outside the output that exist are kept: only the missing ones are requested.
    """
    options, made = copy.copy(options), _made(options)
    if not options.force and made["report"]:
        options.report = options.image_topic = None
    if not options.force and made["save_skeleton"]:
        options.save_skeleton = None
    options.force, options.export = True, list(options.export)
    for file in sorted(options.output.glob(f"{INSIDE}*")):
        suffix = max((s for s in (*TABLES, *PERSONS) if file.name.endswith(s)), key=len, default="")
        if suffix and Path(suffix) not in options.export:
            options.export.append(Path(suffix))
    return options


def _kept_page(options: argparse.Namespace) -> str:
    """Return the words for a page that exists and is kept, without the images of --image-topic; empty without them."""
    if options.force or options.image_topic is None or options.report is None or not options.report.exists():
        return ""
    return ": the page exists and is kept, with the images it has; add --force for those of --image-topic"
