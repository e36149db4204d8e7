"""Check the output paths of `replay`: no output may overwrite an input or another output."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from lassokin_ros.common.atomic_files import Named, real_path, refuse_existing, refuse_shared
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.camera.calibration_file import split_camera
from lassokin_ros.replay.exports.exports import target_of

OUTPUT = "the output"


class OutputError(LassokinError):
    """An output path conflicts with another path, or cannot be written."""


def _refuse_inputs(bags: Iterable[Path], what: str, path: Path) -> None:
    """Raise OutputError if `path` is an input, lies inside one, or is an output folder that contains one.

    what: the kind of output, for the error text.
    """
    place, inputs = real_path(path), {real_path(bag): bag for bag in bags}
    inside = next((folder for folder in place.parents if folder in inputs), None)
    around = next((bag for folder, bag in inputs.items() if what == OUTPUT and place in folder.parents), None)
    if place in inputs:
        relation, bag = "is", inputs[place]
    elif inside is not None:
        relation, bag = "is inside", inputs[inside]
    elif around is not None:
        relation, bag = "contains", around
    else:
        return
    raise OutputError(f"{what} '{path}' {relation} the input recording '{bag}'; choose another path")


def check_output_paths(replays: Sequence[argparse.Namespace]) -> None:
    """Raise OutputError for an output that would destroy an input or another output, also with --force.

    replays: the options of each recording, with `bag` and `output` set. Raises ExportError for a bad --export.
    """
    for options in replays:
        # Without --force the archive itself refuses an output that is the input of another recording.
        bags = [one.bag for one in (replays if options.force else [options])]
        for what, path in _places(options):
            _refuse_inputs(bags, what, path)
    places = [place for options in replays for place in _places(options)]
    refuse_shared(settings_files(replays[0]), places, OutputError)
    _refuse_inside(places)


def refuse_existing_files(options: argparse.Namespace) -> None:
    """Raise OutputError if a page or an export cannot be written. Call it before the first of two passes."""
    for what, path in _places(options):
        if what in ("--report", "--export"):
            refuse_existing(path, options.force, OutputError)


def settings_files(options: argparse.Namespace) -> Iterator[Named]:
    """Yield (option, path) of the files with settings that replay and track read."""
    for file in options.params_file:
        yield "--params-file", file
    if options.camera_info is not None:
        yield "--camera-info", split_camera(options.camera_info)[0]


def _places(options: argparse.Namespace) -> Iterator[Named]:
    """Yield (kind of output, path) for one recording, except exports into the output folder, which cannot conflict."""
    yield OUTPUT, options.output
    if options.report is not None:
        yield "--report", options.report
    if options.save_skeleton is not None:
        yield "--save-skeleton", Path(os.path.expanduser(options.save_skeleton))
    yield from exported_files(options.export)


def exported_files(wanted: Sequence[Path]) -> Iterator[Named]:
    """Yield (option, path) of the exports, once each, without those into the output folder. Raises ExportError."""
    for target in dict.fromkeys(map(target_of, wanted)):
        if target.folder is not None:
            yield "--export", target.path(Path())


def _refuse_inside(places: Sequence[Named]) -> None:
    """Raise OutputError for a file inside an output folder."""
    outputs = {real_path(path): path for what, path in places if what == OUTPUT}
    for what, path in places:
        around = next((outputs[folder] for folder in real_path(path).parents if folder in outputs), None)
        if around is not None and what != OUTPUT:
            raise OutputError(f"{what} '{path}' is inside the output '{around}'; choose another path")
