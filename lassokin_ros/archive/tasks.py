"""One recording of an archive as a task, and its result. Process pool and cluster run the same tasks."""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

from lassokin_ros.archive import output_files
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.replay.bags import remove_leftovers
from lassokin_ros.replay.record import Figures, origin_of, record_of
from lassokin_ros.replay.replay import replay

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
            options, kept = output_files.replacement_options(options), output_files.kept_page(options)
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
        done = output_files.page_exists(options) if nobody else output_files.all_exist(options)
        outcome = DONE_BEFORE + output_files.kept_page(options)
        return Result(task.name, outcome, record.figures) if done else None
    if quiet:
        return None
    raise ArchiveError(f"'{options.output}' exists, from another input, version or settings; add --force to replace it")
