"""The files that belong to each recording of an archive: exports, report, saved skeleton."""

from __future__ import annotations

import argparse
import copy
from pathlib import Path

from lassokin_ros.common.atomic_files import files_of_people
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.settings import SKELETON_SUFFIXES

PAGE, SKELETON = ".html", ".yaml"


class ArchiveFilesError(LassokinError):
    """An option names one file for many recordings."""


def check(options: argparse.Namespace) -> None:
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


def use_own_files(options: argparse.Namespace, name: str) -> None:
    """Replace the folders of --report and --save-skeleton by this recording's files in them.

    options: the options of this recording, changed in place. name: path of the recording relative to the archive.
    """
    if options.report is not None:
        options.report = options.report.absolute() / f"{name}{PAGE}"
    if options.save_skeleton is not None:
        options.save_skeleton = options.save_skeleton.absolute() / f"{name}{SKELETON}"


def folders(options: argparse.Namespace) -> list[Path]:
    """Return the folders that must exist before this recording is processed."""
    files = [options.output, options.report, options.save_skeleton]
    return [file.parent for file in files if file is not None]


def all_exist(options: argparse.Namespace) -> bool:
    """Return True if all files that the options request exist beside the output of a recording."""
    _, node_config = offline_settings(options.params_file, options.p)
    several = node_config.several_people
    there = [options.report.exists()] if options.report is not None else []
    if options.save_skeleton is not None:
        there.append(_exists(options.save_skeleton, options.save_skeleton.suffix, several))
    if options.export:
        from lassokin_ros.replay.exports.exports import PERSONS, target_of

        for target in map(target_of, options.export):
            there.append(_exists(target.path(options.output), target.suffix, several and target.suffix in PERSONS))
    return all(there)


def replacement_options(options: argparse.Namespace) -> argparse.Namespace:
    """Return the options to redo a recording in place of its old output, including the old output's exports."""
    from lassokin_ros.replay.exports.exports import INSIDE, PERSONS, TABLES

    options = copy.copy(options)
    options.force, options.export = True, list(options.export)
    for file in sorted(options.output.glob(f"{INSIDE}*")):
        suffix = max((s for s in (*TABLES, *PERSONS) if file.name.endswith(s)), key=len, default="")
        if suffix and Path(suffix) not in options.export:
            options.export.append(Path(suffix))
    return options


def _exists(file: Path, suffix: str, each: bool) -> bool:
    """Return True if the file exists. each: there is one file per person instead."""
    if each:
        return bool(files_of_people(file.parent, file.name.removesuffix(suffix), suffix))
    return file.exists()
