"""One recording of an archive as a task, and what became of it. Process pool and cluster both run these tasks."""

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
    """The archive as a whole cannot be worked on."""


@dataclass(frozen=True)
class Task:
    """One recording: what it is called in the table, and the command line that it alone would have. It travels."""

    name: str
    options: argparse.Namespace


@dataclass(frozen=True)
class Result:
    """What became of a task. frame_ms: median ms per frame; NaN and None where there is nothing."""

    name: str
    outcome: str
    figures: Figures | None = None
    frame_ms: float = float("nan")

    @property
    def succeeded(self) -> bool:
        """True when the output is there."""
        return self.figures is not None


Runner = Callable[[Sequence[Task]], Generator[Result, None, None]]
"""Does all tasks, in any order, and tells at once what became of each. Closed early, it leaves nothing half done."""


def work(task: Task) -> Result:
    """Do one task; never raises for what a recording may hold. It may be done twice, or by two at once."""
    options = task.options
    try:
        done = _done_before(task)
        if done is not None:
            return done
        remove_leftovers(options.output)
        if options.output.exists():  # of these settings, but without an export, say, that was not wanted then
            options = output_files.made_anew(options)
        replayed = replay(options, io.StringIO())
    except LassokinError as error:
        # Another worker, taken for dead, may have finished it meanwhile.
        return _done_before(task, quiet=True) or Result(task.name, f"failed: {error}")
    return Result(task.name, TRACKED, replayed.figures, replayed.frame_ms)


def _done_before(task: Task, quiet: bool = False) -> Result | None:
    """The result when the output is there already, of this input and these settings, with all that belongs to it.

    None when it is to be made, or made again. Raises ArchiveError for one of another input or other settings, unless
    `quiet`.
    """
    options = task.options
    if options.force or not options.output.exists():
        return None
    record = record_of(options.output)
    if record is not None and record.origin == origin_of(options):
        nobody = record.figures.frames_out == 0  # there is nothing to export
        return Result(task.name, DONE_BEFORE, record.figures) if nobody or output_files.all_there(options) else None
    if quiet:
        return None
    raise ArchiveError(f"'{options.output}' exists and is of another input, version or settings; say --force")
