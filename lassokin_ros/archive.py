"""An archive: `replay` over many recordings, each of which is done as if it were the only one.

A recording that cannot be read, or whose worker dies again and again, is a line in the table at the end. An output
that is complete and of the same input and settings is not made again (see `replay_record`), so that the command goes on
where it was interrupted.
"""

from __future__ import annotations

import argparse
import copy
import io
import os
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from lassokin_ros import archive_files
from lassokin_ros.bags import remove_leftovers
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.interruption import Interrupted
from lassokin_ros.output_places import check_places
from lassokin_ros.progress import Progress
from lassokin_ros.replay_record import Figures, origin_of, record_of
from lassokin_ros.summary_output import print_summary

FAILED = 2
"""Exit code when a recording has no output."""
RECORDING_FILES = (".mcap", ".db3")
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


def is_archive(options: argparse.Namespace) -> bool:
    """True for several recordings, a folder of them, and whatever is sent to a cluster."""
    return len(options.bags) > 1 or options.scheduler is not None or bool(_inside(options.bags[0]))


def replay_archive(options: argparse.Namespace) -> int:
    """Replay all of options.bags into the folder options.output and print the table; the exit code.

    Raises a LassokinError when the settings cannot be used or two outputs would have the same name.
    """
    archive_files.check(options)
    tasks = tasks_of(options)
    origin_of(tasks[0].options)  # settings that cannot be used are said once, before anything starts
    progress = Progress(len(tasks), "recordings")
    results: dict[str, Result] = {}
    try:
        with closing(_runner(options)(tasks)) as outcomes:
            for result in outcomes:
                results[result.name] = result
                progress.advance(note=f"{result.name}: {result.outcome}")
    except Interrupted:
        done = sum(result.succeeded for result in results.values())
        message = f"{done} of {len(tasks)} recordings are done; the same command goes on from there"
        raise Interrupted(message) from None
    finally:
        progress.close()
    print_summary(table([results[task.name] for task in tasks]))
    return 0 if all(result.succeeded for result in results.values()) else FAILED


def _runner(options: argparse.Namespace) -> Runner:
    if options.scheduler is not None:
        from lassokin_ros.archive_dask import on_cluster

        return on_cluster(options.scheduler)
    from lassokin_ros.archive_pool import in_processes

    return in_processes(options.jobs)


def tasks_of(options: argparse.Namespace) -> list[Task]:
    """One task for each recording, by name. Makes the outputs' folders. Raises ArchiveError, OutputError."""
    folder = (options.output or Path()).absolute()
    if (folder / "metadata.yaml").exists() or folder.is_file():
        raise ArchiveError(f"'{folder}' is no folder for several outputs; choose another one with --output")
    tasks: dict[Path, Task] = {}
    for argument in options.bags:
        for bag, name in _inside(argument) or [(argument, _name(argument.resolve()))]:
            output = folder / f"{name}_tracked"
            if output in tasks:
                raise ArchiveError(
                    f"'{tasks[output].options.bag}' and '{bag.absolute()}' would both be written to '{output}'; "
                    "give the folder in which both are, or rename one"
                )
            alone = copy.copy(options)
            alone.bag, alone.output, alone.bags = bag.absolute(), output, [bag.absolute()]
            alone.params_file = [file.absolute() for file in options.params_file]
            archive_files.give_own(alone, name)
            tasks[output] = Task(name, alone)
    check_places([task.options for task in tasks.values()])
    for needed in {place for task in tasks.values() for place in archive_files.folders(task.options)}:
        try:
            needed.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ArchiveError(f"'{needed}' cannot be made: {error.strerror}") from None
    return sorted(tasks.values(), key=lambda task: task.name)


def _inside(folder: Path) -> list[tuple[Path, str]]:
    """(recording, its path below the folder without a file's suffix); none when it is no folder of recordings.

    Hidden folders and outputs of `replay` are left out.
    """
    if not folder.is_dir() or (folder / "metadata.yaml").exists():
        return []
    found = []
    for here, folders, files in os.walk(folder):
        place = Path(here)
        if "metadata.yaml" in files:
            folders.clear()
            bags = [] if record_of(place) else [place]
        else:
            bags = [place / file for file in files if Path(file).suffix in RECORDING_FILES and file[0] != "."]
        folders[:] = [name for name in folders if name[0] != "."]
        found += [(bag, str(bag.parent.relative_to(folder) / _name(bag))) for bag in bags]
    return found


def _name(bag: Path) -> str:
    return bag.stem if bag.suffix in RECORDING_FILES and not bag.is_dir() else bag.name


def work(task: Task) -> Result:
    """Do one task; never raises for what a recording may hold. It may be done twice, or by two at once."""
    from lassokin_ros.replay import replay

    options = task.options
    try:
        done = _done_before(task)
        if done is not None:
            return done
        remove_leftovers(options.output)
        if options.output.exists():  # of these settings, but without an export, say, that was not wanted then
            options = archive_files.made_anew(options)
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
        return Result(task.name, DONE_BEFORE, record.figures) if nobody or archive_files.all_there(options) else None
    if quiet:
        return None
    raise ArchiveError(f"'{options.output}' exists and is of another input, version or settings; say --force")


def table(results: Sequence[Result]) -> str:
    """One line for each recording, and how many there are of each kind."""
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
