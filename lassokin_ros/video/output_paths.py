"""Check the output paths of `track` before anything runs: no output may replace an input or another output."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

from lassokin_ros.common.atomic_files import Named, refuse_existing, refuse_shared
from lassokin_ros.pipeline.camera.calibration_file import split_camera
from lassokin_ros.replay.exports.exports import target_of
from lassokin_ros.replay.output_paths import OutputError, exported_files, settings_files
from lassokin_ros.video.sources import images_of


def check_output_paths(options: argparse.Namespace) -> None:
    """Raise a LassokinError for an output that would replace an input or another output, also with --force.

    An export by its suffix alone gets its name, in the current folder. --save-cameras may name the file of --cameras.
    """
    options.export = [target_of(wanted).path(Path()) for wanted in options.export]
    inputs, outputs = [*_sources(options), *settings_files(options)], [*_outputs(options)]
    if options.cameras is not None:
        refuse_shared([*inputs, ("--cameras", split_camera(options.cameras)[0])], outputs, OutputError)
    if options.save_cameras is not None:
        outputs.append(("--save-cameras", options.save_cameras))
        refuse_existing(options.save_cameras, options.force, OutputError)
    refuse_shared(inputs, outputs, OutputError)


def _sources(options: argparse.Namespace) -> Iterator[Named]:
    """Yield the files that the images, or the keypoints in them, come from."""
    for source in options.sources:
        yield "the input", Path(source)
        if os.path.isdir(source):
            yield from (("the input", file) for file in images_of(Path(source)))
    if options.detector.endswith(".onnx"):
        yield "--detector", Path(options.detector)


def _outputs(options: argparse.Namespace) -> Iterator[Named]:
    """Yield (option, path) of the files to be written, without --save-cameras."""
    if options.report is not None:
        yield "--report", options.report
    yield from exported_files(options.export)
    if options.video is not None:
        yield "--video", options.video
    if options.view is not None and options.view.name:
        yield "--view", options.view
