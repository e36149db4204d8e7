"""`replay --export`: the available formats, the paths of the files, and their writing."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

from lassokin_ros.common.atomic_files import AtomicFiles, files_of_people, refuse_existing
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.replay.exports.amass import check_root, write_amass
from lassokin_ros.replay.exports.bvh import write_bvh
from lassokin_ros.replay.exports.gltf import write_gltf
from lassokin_ros.replay.exports.markers import import_ezc3d, marker_layout, write_c3d, write_trc
from lassokin_ros.replay.exports.sampling import ExportError
from lassokin_ros.replay.exports.tables import write_csv, write_npz
from lassokin_ros.replay.motion import Motion

TABLES: dict[str, Callable[[Sequence[Motion], BinaryIO], None]] = {".csv": write_csv, ".npz": write_npz}
"""Suffix -> writer of one file for all people."""
PERSONS: dict[str, Callable[..., None]] = {
    ".bvh": write_bvh,
    ".amass.npz": write_amass,
    ".trc": write_trc,
    ".c3d": write_c3d,
    ".glb": write_gltf,
}
"""Suffix -> writer of one file per person, of a motion to a binary file."""
NEEDS: dict[str, Callable[[Skeleton], object]] = {
    ".amass.npz": check_root,
    ".trc": marker_layout,
    ".c3d": marker_layout,
}
"""Suffix -> what raises ExportError for a skeleton that the format cannot hold."""
INSIDE = "motion"
"""Stem of the files written into the output folder."""


_INSIDE = re.compile(rf"{INSIDE}(_p\d+)?({'|'.join(map(re.escape, [*TABLES, *PERSONS]))})")


@dataclass(frozen=True)
class Target:
    """One requested file. folder: None = the output folder."""

    stem: str
    suffix: str
    folder: Path | None

    def path(self, output: Path, person: str = "") -> Path:
        """Return the path of a person's file. person: empty for a file of all people and in single-person mode."""
        name = f"{self.stem}_{person}{self.suffix}" if person else f"{self.stem}{self.suffix}"
        return (output if self.folder is None else self.folder) / name


def target_of(wanted: Path) -> Target:
    """Parse the argument of --export: a file name, or a suffix alone for the output folder. Raises ExportError."""
    name = wanted.name
    for suffix in sorted([*TABLES, *PERSONS], key=len, reverse=True):
        if name == suffix == str(wanted):
            return Target(INSIDE, suffix, None)
        if name.endswith(suffix) and name != suffix:
            return Target(name.removesuffix(suffix), suffix, wanted.parent)
    known = ", ".join([*TABLES, *PERSONS])
    raise ExportError(f"--export '{wanted}': unknown suffix; expected one of: {known}")


def is_inside_name(name: str) -> bool:
    """Return True for the names of files that --export with a suffix alone creates."""
    return _INSIDE.fullmatch(name) is not None


class Exports:
    """The exports of one replay, written at its end."""

    def __init__(self, wanted: Sequence[Path], skeleton: Skeleton, several: bool, replace: bool) -> None:
        """skeleton: that of the people. several: True if several people may be tracked.

        Raises ExportError, before any work, for an unusable path and for a format that cannot hold the skeleton.
        """
        self._targets = list(dict.fromkeys(map(target_of, wanted)))
        self._several, self._replace = several, replace
        self.remarks: dict[str, str] = {}
        """Lines of the summary by name, after `write`."""
        for target in self._targets:
            if target.suffix == ".c3d":
                import_ezc3d()
            if target.suffix in NEEDS:
                NEEDS[target.suffix](skeleton)
            if target.folder is not None:
                refuse_existing(target.path(Path()), replace, ExportError)
                if several and target.suffix in PERSONS and not replace:
                    for path in files_of_people(target.folder, target.stem, target.suffix):
                        refuse_existing(path, replace, ExportError)

    def write(self, motions: Sequence[Motion], output: Path, files: AtomicFiles) -> list[Path]:
        """Write all files and return their paths. With `replace`, those of an earlier run that lack now are removed.

        output: the folder for targets without a folder; the others are written as part of `files`. Raises ExportError,
        and the error of `files`.
        """
        paths: list[Path] = []
        with AtomicFiles(self._replace, ExportError) as inside:
            for target in self._targets:
                whole = inside if target.folder is None else files
                for path, fill in _jobs(target, output, motions):
                    whole.write(path, fill)
                    paths.append(path)
                for old in self._of_an_earlier_run(target) if self._replace else ():
                    if old not in paths:
                        whole.remove(old)
        self.remarks = _remarks(self._targets, motions)
        return paths

    def _of_an_earlier_run(self, target: Target) -> list[Path]:
        """Return the files of a named target that may exist. Names with an id are ours with several people only."""
        if target.folder is None:
            return []
        by_person = self._several and target.suffix in PERSONS
        return [target.path(Path()), *(files_of_people(target.folder, target.stem, target.suffix) if by_person else [])]


def _remarks(targets: Sequence[Target], motions: Sequence[Motion]) -> dict[str, str]:
    """Return lines of the summary: files that were not written, and people whose files begin later."""
    names = [target.path(Path()).name for target in targets]
    if not motions:
        return {"not exported": f"{', '.join(names)}: nobody was tracked"}
    late = [f"{motion.person} {motion.start:.3f} s".strip() for motion in motions if motion.start > 0]
    from_zero = [suffix for suffix in (".bvh", ".amass.npz") if any(target.suffix == suffix for target in targets)]
    if late and from_zero:
        return {"files begin": f"{', '.join(late)} after the recording begins: shift {' and '.join(from_zero)} by it"}
    return {}


def _jobs(target: Target, output: Path, motions: Sequence[Motion]) -> list[tuple[Path, Callable[[BinaryIO], None]]]:
    """Return (path, writer) for the files of a target; empty if nobody was tracked."""
    if not motions:
        return []
    if target.suffix in TABLES:
        return [(target.path(output), partial(TABLES[target.suffix], motions))]
    jobs: list[tuple[Path, Callable[[BinaryIO], None]]] = []
    for motion in motions:
        path = target.path(output, motion.person)
        named = {"name": path.name} if target.suffix == ".trc" else {}  # a .trc contains its name
        jobs.append((path, partial(PERSONS[target.suffix], motion, **named)))
    return jobs
