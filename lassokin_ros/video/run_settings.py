"""The options of `lassokin track`: parameters, what a video has no use for, and the paths of its outputs."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from lassokin_ros.common.atomic_files import Named, refuse_existing, refuse_shared
from lassokin_ros.common.command_line import print_note
from lassokin_ros.core.body.landmarks import skeleton_of
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import CameraError, ConfigurationError
from lassokin_ros.core.recording import WHOLE_FILE
from lassokin_ros.pipeline.camera.calibration_file import split_camera
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.exports.exports import target_of
from lassokin_ros.replay.output_paths import OutputError, exported_files, settings_files
from lassokin_ros.video import PROGRAM
from lassokin_ros.video.cameras import Filmed
from lassokin_ros.video.people import ALL, LARGEST, MOST_PEOPLE, NEAREST, PersonError, settings_for
from lassokin_ros.video.sources import images_of

Configs = tuple[TrackerConfig, NodeSettings]
ASSUMED_HEIGHT = 1.75
"""m: height of the person in a video that does not show the size, if none is given. It is not measured, so that the
lengths can be learned, and the video can be tracked backward."""
NO_TOPICS = ("depth:=''", f"keypoints_type:={NodeSettings().keypoints_type}")
"""Assignments that replace the topics of a robot's parameter file: the keypoints are those of `Detections`."""
RAW_IMAGES = "rectified:=false"
"""The same for its images."""


def settings_of(options: argparse.Namespace, cameras: Sequence[Filmed], landmarks: str, several: bool) -> Configs:
    """Return the settings of a run. landmarks, several: of the detector. Raises a LassokinError."""
    chosen = [f"landmarks:={landmarks}", RAW_IMAGES]
    live = cameras[0].source.live or options.causal
    if cameras[0].name:
        chosen.append(f"cameras:={json.dumps([camera.name for camera in cameras])}")  # quoted: `no` is false in YAML
        chosen += ["extrinsics:=learn"] * (options.cameras is None)
        chosen += [f"max_people:={MOST_PEOPLE}"] * (options.person == ALL)
    elif several:
        chosen += settings_for(options.person or (NEAREST if live else LARGEST), live)
    elif options.person is not None:
        raise PersonError(f"--person {options.person}: {options.detector} finds one person; expected YOLO-pose or RTMO")
    height = [] if options.height is None else [f"height:={options.height}"]
    defaults = {
        "height": ASSUMED_HEIGHT if options.cameras is None else 0.0,
        "skeleton": skeleton_of(landmarks),
        **({} if live else WHOLE_FILE),
    }
    config, node = offline_settings(options.params_file, [*chosen, *options.p, *height, *NO_TOPICS], defaults)
    if cameras[0].name:
        _check_several(options, config, node, [camera.name for camera in cameras], several)
        return config, node
    return config, _checked_single(options, config, node, several)


def _check_several(
    options: argparse.Namespace, config: TrackerConfig, node: NodeSettings, names: Sequence[str], several: bool
) -> None:
    """Raise a LassokinError for settings that several videos have no use for."""
    if options.person not in (None, LARGEST, ALL):
        raise PersonError(f"--person {options.person} with several videos; expected {LARGEST} or {ALL}")
    if not several and (options.person is not None or node.several_people):
        raise PersonError(
            f"several people are to be tracked, but {options.detector} finds one person; expected YOLO-pose or RTMO"
        )
    if list(node.camera_names) != list(names):
        raise CameraError(
            f"cameras is {', '.join(node.camera_names)}; expected no setting: the videos name the cameras"
        )
    if options.cameras is None and config.height == 0:
        raise CameraError("height is 0, and without the places of the cameras nothing shows the size; give --height")


def _checked_single(
    options: argparse.Namespace, config: TrackerConfig, node: NodeSettings, several: bool
) -> NodeSettings:
    """Return the settings without those that one video has no use for. Raises a LassokinError."""
    if node.camera_names != ("",):
        raise CameraError(f"cameras is {', '.join(node.camera_names)}; expected no setting: one video has one camera")
    if node.floor:
        raise ConfigurationError("floor is true, but a video has no TF to say where the floor is; set camera_height")
    if node.fixed_frame:
        print_note(f"{PROGRAM}: fixed_frame is not used, since a video has no TF; set camera_pitch and camera_roll")
    if config.height == 0 and not (config.camera_height and config.tilt_deviation):
        raise CameraError(
            "height is 0, but one video shows the size only by the floor, with camera_height and tilt_deviation above "
            "0; expected both, or --height"
        )
    if not several and node.several_people:
        print_note(f"{PROGRAM}: max_people and rep155 are not used, since {options.detector} finds one person")
        node = replace(node, max_people=1, rep155=False)
    return replace(node, fixed_frame="")


def height_given(options: argparse.Namespace) -> bool:
    """Return whether the options give the person's height, or settings that may."""
    named = any(parameter.startswith("height:=") for parameter in options.p)
    return options.height is not None or bool(options.params_file) or named


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
