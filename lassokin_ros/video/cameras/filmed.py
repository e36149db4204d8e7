"""The cameras of a run: that of one video, or those of several of a scene, whose places a file or the person tells."""

from __future__ import annotations

import argparse
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lassokin_ros.common.command_line import print_note
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.learned.camera_finder import FEWEST_FRAMES
from lassokin_ros.core.learned.extrinsics import KEPT_EVERY_S
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.detector.backend import Detector
from lassokin_ros.pipeline.camera.calibration_file import Calibration, camera_names, read_cameras
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import OPTICAL_FRAME
from lassokin_ros.video import PROGRAM
from lassokin_ros.video.camera import assumed_fov_warning, choose_camera
from lassokin_ros.video.cameras.synchrony import Timing
from lassokin_ros.video.detections import Detections
from lassokin_ros.video.keypoint_files.source import open_input
from lassokin_ros.video.sources import Image, Source, SourceError


@dataclass
class Filmed:
    """One camera: its name in the topics, empty for the only one, its video, lens and pose, and its clock.

    stored: the detector that a file of keypoints stands for. detections: the keypoints of the images, once detected.
    """

    name: str
    source: Source
    calibration: Calibration
    pose: CameraPose
    stored: Detector | None = None
    timing: Timing = field(default_factory=Timing)
    detections: Detections | None = None

    @property
    def frame_id(self) -> str:
        """The frame of the keypoints."""
        return self.name or OPTICAL_FRAME

    @property
    def detected(self) -> Detections:
        """The keypoints, which must be detected."""
        assert self.detections is not None
        return self.detections


def open_cameras(options: argparse.Namespace) -> list[Filmed]:
    """Open the videos of the options. Raises a LassokinError.

    With --cameras, the cameras are those of the file, by the names of the videos or by their order. Otherwise the place
    of the first camera is the origin, and those of the others are not known.
    """
    if options.cameras is not None:
        return _placed_cameras(options)
    names = [_topic(Path(source).stem) for source in options.sources] if len(options.sources) > 1 else [""]
    _refuse_same(names)
    cameras: list[Filmed] = []
    for name, path in zip(names, options.sources):
        source, stored = _opened(options, path)
        if name and source.live:
            raise SourceError(f"{path} is live; expected files")
        lens = lens_of(options, source, quiet=bool(cameras))
        cameras.append(Filmed(name, source, lens, CameraPose(name, known=not cameras), stored))
    return cameras


def _placed_cameras(options: argparse.Namespace) -> list[Filmed]:
    if options.camera_info is not None or options.fov is not None:
        raise CameraError("--cameras has the lenses; expected neither --camera-info nor --fov beside it")
    known = camera_names(options.cameras)
    stems = [Path(source).stem for source in options.sources]
    by_topic = {_topic(name): name for name in known}  # --save-cameras writes the names of the topics
    strange = [stem for stem in stems if _topic(stem) not in by_topic]
    if strange and len(strange) < len(stems):
        raise CameraError(f"'{options.cameras}' has no camera '{strange[0]}'; its cameras are: {', '.join(known)}")
    names = known[: len(stems)] if strange else [stem if stem in known else by_topic[_topic(stem)] for stem in stems]
    _refuse_same(names)
    if len(names) < len(stems):
        raise CameraError(
            f"'{options.cameras}' has the cameras {', '.join(known)}; expected one for each of {len(stems)} videos"
        )
    found = read_cameras(options.cameras, names, any_unit=True)
    cameras = []
    for name, path in zip(names, options.sources):
        calibration, pose = found[name]
        source, stored = _opened(options, path, calibration.size)
        if source.live:
            raise SourceError(f"{path} is live; expected files with --cameras")
        scaled, topic = calibration.scaled_to(source.size, f"{options.cameras}:{name}"), _topic(name)
        cameras.append(Filmed(topic, source, scaled, CameraPose(topic, pose.rotation, pose.translation), stored))
    return cameras


def _opened(options: argparse.Namespace, path: str, size: tuple[int, int] = (0, 0)) -> tuple[Source, Detector | None]:
    """Return a video, or a file of keypoints and the detector that it stands for. size: of its images by calibration.

    Raises SourceError.
    """
    one = argparse.Namespace(**{**vars(options), "source": path})
    if one.image_size is None and size != (0, 0):
        one.image_size = f"{size[0]}x{size[1]}"
    return open_input(one)


def _refuse_same(names: Sequence[str]) -> None:
    """Raise CameraError for two videos of one camera."""
    if len({_topic(name) for name in names}) < len(names):
        raise CameraError(f"the videos' names are those of the cameras, and {', '.join(names)} are not different")


def _topic(name: str) -> str:
    """Return the name of a camera as a part of a topic's name."""
    return re.sub(r"\W", "_", name if re.match(r"[A-Za-z_]", name) else f"c{name}", flags=re.ASCII)


def lens_of(options: argparse.Namespace, source: Source, quiet: bool = False) -> Calibration:
    """Return the lens of a video by the options --camera-info and --fov. Raises CameraError.

    quiet: do not warn if there is neither.
    """
    if options.camera_info is not None and options.fov is not None:
        raise CameraError("--camera-info has the lens; expected no --fov beside it")
    if options.camera_info is None and options.fov is None and not quiet:
        print_note(f"{PROGRAM}: {assumed_fov_warning('--fov or --camera-info')}")
    if options.camera_info is None and source.content != source.size:
        width, height = source.content
        text = f"the images have black bars; the field of view is that of the {width} x {height} px between them"
        print_note(f"{PROGRAM}: {text}")
    return choose_camera(options.camera_info, options.fov, source.size, source.content, options.fisheye)


def images_together(cameras: Sequence[Filmed], options: argparse.Namespace) -> Iterator[dict[str, Image]]:
    """Read the sources again; yield each image of the first one with the images of the others that are nearest in time.

    A source that has ended keeps its last image.
    """
    sources = [_opened(options, path, one.source.size)[0] for one, path in zip(cameras, options.sources)]
    first, *others = (_on_first_clock(camera, source) for camera, source in zip(cameras, sources))
    present, following = [next(images) for images in others], [next(images, None) for images in others]
    for image in first:
        for number, images in enumerate(others):
            while (after := following[number]) is not None and _is_nearer(after, present[number], image):
                present[number], following[number] = after, next(images, None)
        yield {camera.name: one for camera, one in zip(cameras, [image, *present])}


def _on_first_clock(camera: Filmed, source: Source) -> Iterator[Image]:
    for image in source.images:
        yield replace(image, seconds=float(camera.timing.of_first(np.array([image.seconds]))[0]))


def _is_nearer(one: Image, than: Image, to: Image) -> bool:
    return abs(one.seconds - to.seconds) <= abs(than.seconds - to.seconds)


def found_poses(session: Session) -> dict[str, CameraPose]:
    """Return the pose of each camera by name after a pass over all images. Raises CameraError if one was not found."""
    places, extrinsics = session.placement.places, session.roster.extrinsics
    assert places is not None
    for name in session.cameras:
        if name not in places.newest:
            raise CameraError(
                f"the place of camera '{name}' was not found; expected a person who moves in view of it and of the "
                f"first camera for {FEWEST_FRAMES * KEPT_EVERY_S:g} s or more, in synchronised videos; "
                "or --cameras FILE"
            )
    given = {name: places.newest[name] for name in session.cameras}
    return given if extrinsics is None else {name: extrinsics.learned(pose) for name, pose in given.items()}


def where_in_words(pose: CameraPose, first: CameraPose) -> str:
    """Return where a camera is, as seen from the first one."""
    turn = math.degrees(float(np.linalg.norm(logarithm((pose.rotation @ first.rotation.T)[None])[0])))
    apart = float(np.linalg.norm(pose.centre - first.centre))
    return f"found {apart:.2f} m from the first camera, turned by {turn:.0f} degrees"


def calibration_toml(cameras: Sequence[tuple[str, Calibration]], poses: Mapping[str, CameraPose]) -> str:
    """Return a calibration file of lenses and poses that --cameras reads, in the form of Pose2Sim."""
    lines = []
    for name, lens in cameras:
        pose, (width, height) = poses[name], lens.size
        lines += [
            f"[{json.dumps(name, ensure_ascii=False)}]",  # a string of TOML; without quotes few characters are allowed
            f"name = {json.dumps(name, ensure_ascii=False)}",
            f"size = [{width}.0, {height}.0]",
            f"matrix = {lens.K.tolist()}",
            f'distortion_model = "{lens.model}"',
            f"distortions = {np.asarray(lens.D, dtype=float).tolist()}",
            f"rotation = {logarithm(pose.rotation[None])[0].tolist()}",
            f"translation = {pose.translation.tolist()}",
            "",
        ]
    return "\n".join(lines)
