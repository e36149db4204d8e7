"""`replay --export`: which formats there are, where the files go, and when they are written."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

from lassokin_ros.common.atomic_files import AtomicFiles, files_of_people, refuse_existing
from lassokin_ros.replay.exports.amass import write_amass
from lassokin_ros.replay.exports.bvh import write_bvh
from lassokin_ros.replay.exports.csv_table import write_csv
from lassokin_ros.replay.exports.errors import ExportError
from lassokin_ros.replay.exports.npz import write_npz
from lassokin_ros.replay.motion import Motion, MotionRecorder

TABLES: dict[str, Callable[[Sequence[Motion], BinaryIO], None]] = {".csv": write_csv, ".npz": write_npz}
"""Suffix -> writer of all people into one file."""
PERSONS: dict[str, Callable[[Motion, BinaryIO], None]] = {".bvh": write_bvh, ".amass.npz": write_amass}
"""Suffix -> writer of one person."""
INSIDE = "motion"
"""What a file is called that goes into the output's folder."""


_INSIDE = re.compile(rf"{INSIDE}(_p\d+)?({'|'.join(map(re.escape, [*TABLES, *PERSONS]))})")


@dataclass(frozen=True)
class Target:
    """One file that is wanted. folder: None stands for the output's own."""

    stem: str
    suffix: str
    folder: Path | None

    def path(self, output: Path, person: str = "") -> Path:
        """Where a person's file goes; person: empty for all, or the one who is followed."""
        name = f"{self.stem}_{person}{self.suffix}" if person else f"{self.stem}{self.suffix}"
        return (output if self.folder is None else self.folder) / name


def target_of(wanted: Path) -> Target:
    """What --export names: a file, or a suffix alone for a file in the output's folder. Raises ExportError."""
    name = wanted.name
    for suffix in sorted([*TABLES, *PERSONS], key=len, reverse=True):
        if name == suffix == str(wanted):
            return Target(INSIDE, suffix, None)
        if name.endswith(suffix) and name != suffix:
            return Target(name.removesuffix(suffix), suffix, wanted.parent)
    known = ", ".join([*TABLES, *PERSONS])
    raise ExportError(f"--export '{wanted}': the format is told by the suffix; expected one of: {known}")


def is_inside_name(name: str) -> bool:
    """True for what --export with a suffix alone calls a file in the output's folder."""
    return _INSIDE.fullmatch(name) is not None


def check_archive_exports(wanted: Sequence[Path]) -> None:
    """Raise ExportError for a file name where there are many recordings: only suffixes make sense there."""
    for target in map(target_of, wanted):
        if target.folder is not None:
            raise ExportError(
                f"--export '{target.path(Path())}' names one file for many recordings; give the suffix alone, "
                f"--export {target.suffix}, for a file in each output's folder"
            )


class Exports:
    """The exports of one replay: gathers while it runs, writes at its end."""

    def __init__(self, wanted: Sequence[Path], recorder: MotionRecorder, several: bool, replace: bool) -> None:
        """several: more than one person may be followed. Raises ExportError for what could not be written: now."""
        self._targets = list(dict.fromkeys(map(target_of, wanted)))
        self._recorder, self._replace = recorder, replace
        for target in self._targets:
            if target.folder is not None:
                refuse_existing(target.path(Path()), replace, ExportError)
                if several and target.suffix in PERSONS and not replace:
                    for path in files_of_people(target.folder, target.stem, target.suffix):
                        refuse_existing(path, replace, ExportError)

    def write(self, output: Path, files: AtomicFiles) -> list[Path]:
        """Write all files; their paths. output: the folder for those that name none, the others are some of `files`.

        Raises ExportError, or what `files` does.
        """
        motions = self._recorder.motions()
        paths: list[Path] = []
        with AtomicFiles(self._replace, ExportError) as inside:
            for target in self._targets:
                for path, fill in _jobs(target, output, motions):
                    (inside if target.folder is None else files).write(path, fill)
                    paths.append(path)
        return paths


def _jobs(target: Target, output: Path, motions: list[Motion]) -> list[tuple[Path, Callable[[BinaryIO], None]]]:
    """(path, what writes it) of a target's files; none when nobody was tracked."""
    if not motions:
        return []
    if target.suffix in TABLES:
        return [(target.path(output), partial(TABLES[target.suffix], motions))]
    return [(target.path(output, motion.person), partial(PERSONS[target.suffix], motion)) for motion in motions]
