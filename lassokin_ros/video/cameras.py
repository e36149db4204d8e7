"""The cameras of a run: that of one video, or those of several of a scene, whose places a file or the person tells."""

from __future__ import annotations

import argparse
import json
import math
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lassokin_ros.common.command_line import print_note
from lassokin_ros.common.progress import Progress
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.learned.camera_finder import FEWEST_FRAMES
from lassokin_ros.core.learned.extrinsics import KEPT_EVERY_S
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.rig.clocks import Course
from lassokin_ros.detector.backend import Detected, Detector, DetectorError, numbered
from lassokin_ros.pipeline.camera.calibration_file import Calibration, camera_names, read_cameras
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import OPTICAL_FRAME
from lassokin_ros.video import PROGRAM
from lassokin_ros.video.camera import DEFAULT_FOV, assumed_fov_warning, from_file, from_fov
from lassokin_ros.video.keypoint_files.source import open_input
from lassokin_ros.video.people import Found
from lassokin_ros.video.shots import Footage
from lassokin_ros.video.sources import Image, Source, SourceError, stamp_of
from lassokin_ros.video.synchrony import SAME_CLOCK, on_first_clock
from msg_adapters.keypoints import Keypoints

COMPLETE = 0.9
"""Share of the announced images or of the announced duration from which a file counts as complete."""


@dataclass(eq=False)
class Filmed:
    """One camera: its video, its lens and its place, and what is seen in the video.

    name: in the topics; empty for the only camera. stored: the detector that a file of keypoints stands for. course: of
    its clock, see `on_first_clock`. footage: follows the background, where that is wanted. found: the people in each
    image, once detected. fault: why the video ended early, in words; empty if it did not. detect_seconds: time of the
    detector for each image, s.
    """

    name: str
    source: Source
    calibration: Calibration
    pose: CameraPose
    stored: Detector | None = None
    course: Course = SAME_CLOCK
    footage: Footage | None = None
    found: list[Found] = field(default_factory=list)
    fault: str = ""
    detect_seconds: list[float] = field(default_factory=list)

    @property
    def frame_id(self) -> str:
        """The frame of the keypoints."""
        return self.name or OPTICAL_FRAME

    def detect(
        self, detector: Detector, stopped: Sequence[int], progress: Progress, keep: bool = True
    ) -> Iterator[tuple[Image, list[Detected]]]:
        """Yield each image with the people in it. stopped: not empty after a signal. keep: in `found`.

        Raises a LassokinError, which is kept in `fault` after the first image.
        """
        if self.source.remark:
            print_note(f"{PROGRAM}: {self.source.remark}")
        last = step = 0.0
        try:
            for image in self.source.images:
                if stopped:
                    break
                began = time.monotonic()
                people = detector.detect(image.rgb, image.seconds)
                self.detect_seconds.append(time.monotonic() - began)
                step, last = image.seconds - last, image.seconds
                if self.footage is not None:
                    self.footage.add(image, people)
                if keep:
                    self.found.append((image.seconds, people))
                yield image, people
        except (SourceError, DetectorError) as error:
            if not self.detect_seconds:
                raise
            self.fault = str(error)
        finally:
            progress.close()
        if not self.fault and not stopped:
            self._check_end(last + step)  # the last image is shown as long as the one before

    def _check_end(self, seconds: float) -> None:
        """Print a note if the file ended early. The number of images may be an estimate, and so may the duration."""
        read, source = len(self.detect_seconds), self.source
        if read < COMPLETE * source.count and source.begin + seconds < COMPLETE * source.seconds:
            print_note(
                f"{PROGRAM}: {source.name} announces {source.count} images, {read} could be read; it may be damaged, "
                "or its images begin later than its sound"
            )

    def keypoints(self, seconds: float, people: Sequence[Detected], several: bool) -> Keypoints:
        """Return the people in an image at a time, s. several: all of them; otherwise the first one alone."""
        rows = numbered(people if several else people[:1])
        keypoints = Keypoints.of_people(stamp_of(seconds), self.frame_id, rows)
        return keypoints if several else replace(keypoints, persons=None)


def open_cameras(options: argparse.Namespace) -> list[Filmed]:
    """Open the videos of the options. Raises a LassokinError.

    With --cameras, the cameras are those of the file, by the names of the videos or by their order. Otherwise the place
    of the first camera is the origin, and those of the others are not known.
    """
    stems = [Path(source).stem for source in options.sources]
    placed: Mapping[str, tuple[Calibration, CameraPose]] = {}
    if options.cameras is not None:
        if options.camera_info is not None or options.fov is not None:
            raise CameraError("--cameras has the lenses; expected neither --camera-info nor --fov beside it")
        names = _names_in_file(options.cameras, stems)
        placed = read_cameras(options.cameras, names, any_unit=True)
    else:
        names = stems if len(stems) > 1 else [""]
    topics = [_topic(name) if name else "" for name in names]
    if len(set(topics)) < len(names):
        raise CameraError(f"the videos' names are those of the cameras, and {', '.join(names)} are not different")
    cameras: list[Filmed] = []
    for name, topic, path in zip(names, topics, options.sources):
        lens, pose = placed.get(name, (None, CameraPose(topic, known=not cameras)))
        source, stored = open_input(path, options, (0, 0) if lens is None else lens.size)
        if topic and source.live:
            raise SourceError(f"{path} is live; expected files" + " with --cameras" * bool(placed))
        if lens is None:
            lens = _lens(options, source, quiet=bool(cameras))
        else:
            lens, pose = lens.scaled_to(source.size, f"{options.cameras}:{name}"), replace(pose, name=topic)
        cameras.append(Filmed(topic, source, lens, pose, stored))
    return cameras


def _names_in_file(file: Path, stems: Sequence[str]) -> list[str]:
    """Return the names in the file of the cameras of the videos: by the videos' names, or by their order."""
    known = camera_names(file)
    by_topic = {_topic(name): name for name in known}  # --save-cameras writes the names of the topics
    strange = [stem for stem in stems if _topic(stem) not in by_topic]
    if strange and len(strange) < len(stems):
        raise CameraError(f"'{file}' has no camera '{strange[0]}'; its cameras are: {', '.join(known)}")
    if not strange:
        return [stem if stem in known else by_topic[_topic(stem)] for stem in stems]
    if len(known) < len(stems):
        raise CameraError(f"'{file}' has the cameras {', '.join(known)}; expected one for each of {len(stems)} videos")
    return known[: len(stems)]


def _topic(name: str) -> str:
    """Return the name of a camera as a part of a topic's name."""
    return re.sub(r"\W", "_", name if re.match(r"[A-Za-z_]", name) else f"c{name}", flags=re.ASCII)


def _lens(options: argparse.Namespace, source: Source, quiet: bool) -> Calibration:
    """Return the lens of a video by --camera-info, --fov and --fisheye; quiet: do not warn if there is neither."""
    if options.camera_info is not None and options.fov is not None:
        raise CameraError("--camera-info has the lens; expected no --fov beside it")
    if options.fisheye and options.fov is None:
        raise CameraError("--fisheye is the kind of lens for a field of view; expected --fov beside it")
    if options.camera_info is not None:
        return from_file(options.camera_info, source.size)
    if options.fov is None and not quiet:
        print_note(f"{PROGRAM}: {assumed_fov_warning('--fov or --camera-info')}")
    if source.content != source.size:
        width, height = source.content
        text = f"the images have black bars; the field of view is that of the {width} x {height} px between them"
        print_note(f"{PROGRAM}: {text}")
    return from_fov(options.fov or DEFAULT_FOV, source.size, source.content, options.fisheye)


def images_together(cameras: Sequence[Filmed], options: argparse.Namespace) -> Iterator[dict[str, Image]]:
    """Read the sources again; yield each image of the first one with the images of the others that are nearest in time.

    A source that has ended keeps its last image.
    """

    def images_of(camera: Filmed, path: str) -> Iterator[Image]:
        for image in open_input(path, options, camera.source.size)[0].images:
            yield replace(image, seconds=float(on_first_clock(camera.course, image.seconds)))

    first, *others = map(images_of, cameras, options.sources)
    present, following = [next(images) for images in others], [next(images, None) for images in others]
    for image in first:
        at = image.seconds
        for number, images in enumerate(others):
            while (after := following[number]) and abs(after.seconds - at) <= abs(present[number].seconds - at):
                present[number], following[number] = after, next(images, None)
        yield {camera.name: one for camera, one in zip(cameras, [image, *present])}


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
