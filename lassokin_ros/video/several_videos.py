"""Videos of several cameras to one skeleton: detect each, then track all of them in one lasso a frame.

Without a file with the places of the cameras, a first pass finds them from the person.
"""

from __future__ import annotations

import argparse
import json
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.common.progress import Progress
from lassokin_ros.common.summary_output import print_note
from lassokin_ros.core.body.landmarks import skeleton_of
from lassokin_ros.core.config import CHECK, TrackerConfig
from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.recording import WHOLE_FILE
from lassokin_ros.detector.backend import Detected, Detector, make_detector
from lassokin_ros.pipeline.camera.calibration_file import Calibration, camera_names, read_cameras
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.output_paths import OutputError
from lassokin_ros.replay.passes.passes import Bodies, learn
from lassokin_ros.replay.playback import Playback
from lassokin_ros.video import PROGRAM
from lassokin_ros.video.cameras.found_cameras import calibration_toml, found_poses, where_in_words
from lassokin_ros.video.cameras.synchrony import Timing, checked_places, given_offsets, set_up_of, synchronised
from lassokin_ros.video.detections import FIRST_STAMP_NS, Detections, stamp_of
from lassokin_ros.video.keypoint_files.source import open_input
from lassokin_ros.video.people import ALL, LARGEST, MOST_PEOPLE, PersonError, people_in
from lassokin_ros.video.sources import Image, Source, SourceError
from lassokin_ros.video.track import ASSUMED_HEIGHT, HEIGHT_ASSUMED, NO_TOPICS, RAW_IMAGES, Tracked, lens_of, stop_flag
from lassokin_ros.video.track_outputs import TrackOutputs, height_given


@dataclass
class Filmed:
    """One camera: its name in the topics, its video, lens and pose, the keypoints of its images, and its clock.

    stored: the detector that a file of keypoints stands for.
    """

    name: str
    source: Source
    calibration: Calibration
    pose: CameraPose
    detections: Detections | None = None
    timing: Timing = field(default_factory=Timing)
    stored: Detector | None = None


def track_videos(options: argparse.Namespace) -> Tracked:
    """Track the videos `options.sources` with the cameras of `options.cameras`. Raises a LassokinError."""
    began = time.monotonic()
    cameras = _cameras(options)
    offsets = None if options.offsets is None else given_offsets(options.offsets, len(cameras))
    height = [] if options.height is None else [f"height:={options.height}"]
    stored = [camera.stored for camera in cameras if camera.stored is not None]
    if stored:
        options.detector = cameras[0].source.name
    detector = stored[0] if stored else make_detector(options.detector)
    if any(one.landmarks != detector.landmarks for one in stored) or 0 < len(stored) < len(cameras):
        raise SourceError("some sources have other keypoints, or are videos; expected one kind of keypoints for all")
    names = f"cameras:={json.dumps([camera.name for camera in cameras])}"  # quoted: `no` is a truth value in YAML
    unplaced = options.cameras is None
    search = ["extrinsics:=learn"] if unplaced else []
    who = [f"max_people:={MOST_PEOPLE}"] if options.person == ALL else []
    chosen = [f"landmarks:={detector.landmarks}", names, RAW_IMAGES, *search, *who, *options.p, *height, *NO_TOPICS]
    body = {"height": ASSUMED_HEIGHT if unplaced else 0.0, "skeleton": skeleton_of(detector.landmarks)}
    defaults = {**body, **({} if options.causal else WHOLE_FILE)}
    tracker_config, node_config = offline_settings(options.params_file, chosen, defaults)
    several = detector.several or any(one.several for one in stored)
    _check(options, node_config, [camera.name for camera in cameras], several)
    if unplaced and tracker_config.height == 0:
        raise CameraError("height is 0, and without the places of the cameras nothing shows the size; give --height")
    poses = {camera.name: camera.pose for camera in cameras}

    def make(config: TrackerConfig, bodies: Bodies | None = None) -> Session:
        return Session(config, node_config, poses=poses, bodies=bodies)

    first = Playback(make(tracker_config))
    with ExitStack() as stack, AtomicFiles(options.force, OutputError) as files:
        views = {camera.name: (camera.calibration, camera.source.size) for camera in cameras}
        outputs = TrackOutputs(options, cameras[0].source, cameras[0].calibration, first, stack, views)
        if unplaced and not height_given(options):
            outputs.remarks.append(HEIGHT_ASSUMED)
        with stop_flag() as stopped:
            for number, camera in enumerate(cameras):
                if number:  # a detector follows the person from image to image
                    detector = camera.stored or make_detector(options.detector)
                _detect(camera, detector, outputs, stopped)
        if stopped:
            _keep_common_part(cameras)
        everybody = node_config.several_people
        remarks = _synchronise(cameras, offsets, outputs)
        if not unplaced:
            session = first.session
            words = _check_places(cameras, session, node_config.fixed_frame)
            remarks += words
            poses |= {camera.name: camera.pose for camera in cameras}
            first = Playback(make(tracker_config))  # with the places in m
        for remark in remarks:
            print_note(f"{PROGRAM}: {remark}")
        if several and not everybody:
            remarks += map(_keep_largest, cameras)
        outputs.remarks += filter(None, remarks)
        if (unplaced or tracker_config.calibrate) and not options.causal:
            known = learn(make, partial(_play, cameras, everybody), tracker_config)
            heights = list(known.heights.values())
            if unplaced:
                try:
                    poses = found_poses(known.first)
                except CameraError:
                    if stopped:
                        raise KeyboardInterrupt from None
                    raise
                known = replace(known, config=replace(known.config, extrinsics=CHECK))
            second = Playback(known.session(make))
        else:
            second, heights = first, []
        outputs.follow(second)
        images = _images_together(cameras, options) if outputs.needs_images else iter(())

        def show(camera: Filmed) -> None:
            if outputs.needs_images and camera is cameras[0]:
                outputs.add_images(_next(images))

        _play(cameras, everybody, second, before=show)
        written = outputs.write(files)
        if options.save_cameras is not None:
            poses = found_poses(second.session)
            text = calibration_toml([(camera.name, camera.calibration) for camera in cameras], poses)
            files.write_text(options.save_cameras, text)
            written.append(options.save_cameras)
        files.check()
    summary = _summary(options, cameras, second, written, heights, time.monotonic() - began)
    summary = "\n".join([summary, *(f"{'note':<15} {remark}" for remark in remarks if remark)])
    faults = [camera.detections.fault for camera in cameras if camera.detections is not None]
    return Tracked("\n".join([summary, *outputs.doubts]), not stopped, "; ".join(filter(None, faults)))


def _check(options: argparse.Namespace, node: NodeSettings, names: Sequence[str], several: bool) -> None:
    """Raise a LassokinError for settings that several videos have no use for, before anything is detected.

    several: whether the detector finds several people.
    """
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


def _cameras(options: argparse.Namespace) -> list[Filmed]:
    """Return the cameras of the videos: those of the calibration file, by the names of the videos or by their order.

    Without a file, the place of the first camera is the origin, and those of the others are not known.
    """
    if options.cameras is None:
        return _unplaced_cameras(options)
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
        topic = _topic(name)
        scaled = calibration.scaled_to(source.size, f"{options.cameras}:{name}")
        placed = CameraPose(topic, pose.rotation, pose.translation)
        cameras.append(Filmed(topic, source, scaled, placed, stored=stored))
    return cameras


def _unplaced_cameras(options: argparse.Namespace) -> list[Filmed]:
    names = [_topic(Path(source).stem) for source in options.sources]
    _refuse_same(names)
    cameras: list[Filmed] = []
    for name, path in zip(names, options.sources):
        source, stored = _opened(options, path)
        if source.live:
            raise SourceError(f"{path} is live; expected files")
        lens = lens_of(options, source, quiet=bool(cameras))
        cameras.append(Filmed(name, source, lens, CameraPose(name, known=not cameras), stored=stored))
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


def _detect(camera: Filmed, detector: Detector, outputs: TrackOutputs, stopped: list[int]) -> None:
    """Detect all images of a camera, and close the detector. outputs: keep the images for the report."""
    try:
        camera.detections = Detections(camera.source, detector, camera.name, keep=True)
        progress = Progress(camera.source.count, "images")
        for image, _ in camera.detections.images(stopped, progress):
            outputs.add_report_image(image, camera.name)
            progress.advance(note=camera.name)
    finally:
        detector.close()


def _synchronise(cameras: Sequence[Filmed], given: Sequence[float] | None, outputs: TrackOutputs) -> list[str]:
    """Put the keypoints of all videos on the clock of the first one, and return what to say about it.

    given: the offsets of --offsets; None to find them from the people.
    """
    kept = [camera.detections for camera in cameras if camera.detections is not None]
    found = synchronised([camera.name for camera in cameras], [one.found for one in kept], given)
    for number, (camera, detections) in enumerate(zip(cameras, kept)):
        camera.timing = found.timings[number]
        detections.found = found.shifted(number, detections.found)
        outputs.move_report_images(camera.name, camera.timing.of_first)
    return [f"{remark[0].upper()}{remark[1:]}." for remark in found.remarks]


def _check_places(cameras: Sequence[Filmed], session: Session, frame: str) -> list[str]:
    """Compare the given places with the person; put them into m. Return what is wrong, a sentence each."""
    names, skeleton = session.tracker.layout.names, session.tracker.skeleton
    rest = skeleton.rest_positions[session.tracker.layout.joints] + session.tracker.layout.offsets
    kept = [camera.detections.found for camera in cameras if camera.detections is not None]
    given = [camera.pose for camera in cameras]
    found = set_up_of(kept, [camera.calibration for camera in cameras], given, names, rest)
    poses, words = checked_places(found, given, frame)
    for camera, pose in zip(cameras, poses):
        camera.pose = pose
    return words


def _keep_largest(camera: Filmed) -> str:
    """Keep the keypoints of the largest person in the images, and return who else is there; empty for one person.

    Others who are never in view together with those who are kept are the same person, who was out of view for a while.
    """
    assert camera.detections is not None
    people = people_in(camera.detections.found)
    if len(people) < 2:
        return ""
    present: dict[float, Detected] = {}
    kept = []
    for number, person in enumerate(people, 1):
        if present.keys().isdisjoint(person.seconds.tolist()):
            present.update(zip(person.seconds.tolist(), person.detected))
            kept.append(str(number))
    times = [seconds for seconds, _ in camera.detections.found]
    camera.detections.found = [(seconds, [present[seconds]] if seconds in present else []) for seconds in times]
    listed = "; ".join(person.words(camera.source.size[0]) for person in people)
    who = "the first, largest one is tracked"
    if len(kept) > 1:
        who = f"{', '.join(kept)} are never in view together and are tracked as one person"
    return f"{len(people)} people in the images of {camera.name}, {who}: {listed}."


def _keep_common_part(cameras: list[Filmed]) -> None:
    """Keep the keypoints of the time for which all cameras were detected. Raises KeyboardInterrupt if there is none."""
    kept = [camera.detections for camera in cameras if camera.detections is not None and camera.detections.found]
    if len(kept) < len(cameras):
        raise KeyboardInterrupt
    end = min(detections.found[-1][0] for detections in kept)
    for detections in kept:
        detections.found = [found for found in detections.found if found[0] <= end]


def _images_together(cameras: list[Filmed], options: argparse.Namespace) -> Iterator[dict[str, Image]]:
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


def _next(images: Iterator[dict[str, Image]]) -> dict[str, Image]:
    found = next(images, None)
    if found is None:
        raise SourceError("the videos have fewer images when they are read again")
    return found


def _play(
    cameras: list[Filmed],
    everybody: bool,
    tracker: Playback,
    title: str = "",
    before: Callable[[Filmed], None] = lambda camera: None,
) -> None:
    """Play the keypoints of all cameras in the order of their times.

    everybody: with all people in the images; False for one. before: called with the camera of each image.
    """
    for camera in cameras:
        tracker.camera_info(camera.calibration.intrinsics(camera.name), FIRST_STAMP_NS, camera.name)
    found = [
        (seconds, camera, keypoints)
        for camera in cameras
        if camera.detections is not None
        for seconds, keypoints in (camera.detections.of_everybody() if everybody else camera.detections.of_all())
    ]
    for seconds, camera, keypoints in sorted(found, key=lambda one: one[0]):
        before(camera)
        tracker.keypoints(keypoints, stamp_of(seconds), camera.name)
    tracker.finish()


def _summary(
    options: argparse.Namespace,
    cameras: list[Filmed],
    tracker: Playback,
    written: list[Path],
    heights: Sequence[str],
    seconds: float,
) -> str:
    """heights: as the first pass measured them, in words."""
    counts, error = tracker.session.counts, tracker.reprojection_px
    images = ", ".join(f"{camera.source.name} ({camera.name})" for camera in cameras)
    lines = {
        "images": f"{counts['received']} in, {tracker.messages_tracked} instants tracked",
        "height": "; ".join(heights) or tracker.session.tracker.config.height_text,
        "reprojection": f"{np.median(error):.2f} px median" if error else "nothing was tracked",
        "total": f"{seconds:.1f} s",
        "written": ", ".join(map(str, written)) or "nothing",
    }
    places, extrinsics = tracker.session.placement.places, tracker.session.extrinsics
    for camera in cameras[1:]:
        if options.cameras is None and places is not None and camera.name in places.newest:
            lines[f"camera {camera.name}"] = where_in_words(places.newest[camera.name], cameras[0].pose)
        elif extrinsics is not None and (words := extrinsics.in_words(camera.name)):
            lines[f"camera {camera.name}"] = words
    return "\n".join([images, *(f"{name:<15} {text}" for name, text in lines.items())])
