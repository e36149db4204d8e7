"""Run detector and tracker over the images of a source, and write the requested files."""

from __future__ import annotations

import argparse
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.common.progress import Progress
from lassokin_ros.common.summary_output import print_note
from lassokin_ros.core.body.landmarks import skeleton_of
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import CameraError, ConfigurationError
from lassokin_ros.core.recording import WHOLE_FILE
from lassokin_ros.detector.backend import Detector, make_detector
from lassokin_ros.pipeline.outputs.status.calibration_status import height_in_words
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import LASTING, MESSAGE, OPTICAL_FRAME, NodeSettings
from lassokin_ros.replay.output_paths import OutputError
from lassokin_ros.replay.passes.passes import Bodies, learn
from lassokin_ros.replay.playback import Playback
from lassokin_ros.video import PROGRAM
from lassokin_ros.video.camera import Calibration, assumed_fov_warning, choose_camera
from lassokin_ros.video.detections import FIRST_STAMP_NS, Detections, stamp_of
from lassokin_ros.video.footage.shots import Footage, LiveFootage
from lassokin_ros.video.keypoint_files.source import open_input
from lassokin_ros.video.people import (
    ALL,
    LARGEST,
    NEAREST,
    PersonError,
    Seen,
    choose,
    people_of_shots,
    settings_for,
)
from lassokin_ros.video.sources import Image, Source, SourceError
from lassokin_ros.video.track_outputs import TrackOutputs, height_given
from msg_adapters.keypoints import Keypoints

Configs = tuple[TrackerConfig, NodeSettings]
Images = Iterator[tuple[float, Keypoints]]
"""Time in s and keypoints of each image."""
ASSUMED_HEIGHT = 1.75
"""m: height of the person in a video that does not show the size, if none is given. It is not measured, so that the
lengths can be learned, and the video can be tracked backward."""
HEIGHT_ASSUMED = (
    f"The person is taken to be {ASSUMED_HEIGHT:g} m tall. The images do not show the size: with another "
    "height, all lengths and the distance change by the same factor; set `--height`."
)
NO_TOPICS = ("depth:=''", f"keypoints_type:={NodeSettings().keypoints_type}")
"""Assignments that replace the topics of a robot's parameter file: the keypoints are those of `Detections`."""
RAW_IMAGES = "rectified:=false"
"""The same for its images."""


@dataclass(frozen=True)
class Tracked:
    """The end of a run. summary: to be printed. complete: the source was read to its end, or a camera was stopped.

    fault: why the source ended early, in words; empty if it did not. The files hold what was tracked until then.
    """

    summary: str
    complete: bool
    fault: str


def track(options: argparse.Namespace, detector: Detector | None = None) -> Tracked:
    """Track a source and write the requested files. detector: replaces --detector. Raises a LassokinError."""
    source, stored = open_input(options)  # before the detector, which takes seconds to load
    if stored is not None:
        options.detector = source.name
    detector = detector or stored or make_detector(options.detector)
    live = _is_live(options, source)
    with ExitStack() as stack, AtomicFiles(options.force, OutputError) as files:
        stack.callback(detector.close)
        configs = _settings(options, source, detector)
        camera = lens_of(options, source)
        follow = LiveFootage if live else Footage
        footage = None if stored is not None else follow(camera, source.size, source.content)
        turning = footage.pose if isinstance(footage, LiveFootage) else None
        first = Playback(Session(*configs, poses=turning))
        outputs = TrackOutputs(options, source, camera, first, stack)
        outputs.remarks += [HEIGHT_ASSUMED] * (not height_given(options))
        if options.fov is None and options.camera_info is None:
            remedy = assumed_fov_warning("`--fov` or `--camera-info`")
            outputs.remarks.append(remedy[0].upper() + remedy[1:])
        run = Run(source, detector, camera, outputs, footage)
        tracker = run.live(first) if live else run.whole_file(first, configs, options)
        written = outputs.write(files)
        files.check()
    return Tracked(run.summary(tracker, options, written), run.complete, run.detections.fault)


def _is_live(options: argparse.Namespace, source: Source) -> bool:
    """Whether each image is tracked as it comes: later ones are not known, or must not be used."""
    return source.live or bool(options.causal)


def _settings(options: argparse.Namespace, source: Source, detector: Detector) -> Configs:
    height = [] if options.height is None else [f"height:={options.height}"]
    layout = f"landmarks:={detector.landmarks}"
    live = _is_live(options, source)
    body = {"height": ASSUMED_HEIGHT, "skeleton": skeleton_of(detector.landmarks)}
    defaults = {**body, **({} if live else WHOLE_FILE)}
    who = []
    if detector.several:
        who = settings_for(options.person or (NEAREST if live else LARGEST), live)
    elif options.person is not None:
        raise PersonError(f"--person {options.person}: {options.detector} finds one person; expected YOLO-pose or RTMO")
    tracker, node = offline_settings(
        options.params_file, [layout, RAW_IMAGES, *who, *options.p, *height, *NO_TOPICS], defaults
    )
    if node.camera_names != ("",):
        raise CameraError(f"cameras is {', '.join(node.camera_names)}; expected no setting: one video has one camera")
    if node.floor:
        raise ConfigurationError("floor is true, but a video has no TF to say where the floor is; set camera_height")
    if node.fixed_frame:
        _note("fixed_frame is not used, since a video has no TF; set camera_pitch and camera_roll")
    if tracker.height == 0 and not (tracker.camera_height and tracker.tilt_deviation):
        raise CameraError(
            "height is 0, but one video shows the size only by the floor, with camera_height and tilt_deviation above "
            "0; expected both, or --height"
        )
    if not detector.several and node.several_people:
        _note(f"max_people and rep155 are not used, since {options.detector} finds one person")
        node = replace(node, max_people=1, rep155=False)
    return tracker, replace(node, fixed_frame="")


class Run:
    """One run over a source."""

    def __init__(
        self,
        source: Source,
        detector: Detector,
        camera: Calibration,
        outputs: TrackOutputs,
        footage: Footage | LiveFootage | None,
    ) -> None:
        """footage: follows the background; None without images."""
        self._source, self._outputs, self._footage = source, outputs, footage
        self._info = camera.intrinsics(OPTICAL_FRAME)
        self.detections = Detections(source, detector, OPTICAL_FRAME, keep=not source.live)
        self._several = detector.several
        self._who = self._passes = ""
        self._heights: Mapping[str, str] = {}
        self._started = time.monotonic()

    @property
    def complete(self) -> bool:
        """Whether the source was read to its end, or a camera was stopped."""
        return not self.detections.interrupted or self._source.count == 0

    def live(self, tracker: Playback) -> Playback:
        """Track each image as it comes, until the end or until SIGINT or SIGTERM."""
        self._outputs.follow(tracker)
        tracker.camera_info(self._info, FIRST_STAMP_NS)
        progress = Progress(self._source.count, "images")
        with stop_flag() as stopped:
            for image, message in self.detections.images(stopped, progress):
                self._outputs.add_report_image(image)
                self._outputs.add_image(image)
                self._follow_background(image)
                tracker.keypoints(message, stamp_of(image.seconds))
                progress.advance(note=tracker.session.status.value)
            tracker.finish()
        return tracker

    def _follow_background(self, image: Image) -> None:
        """Use an image; say it when the camera begins to turn."""
        if self._footage is None:
            return
        stood = not self._footage.moves if isinstance(self._footage, LiveFootage) else False
        self._footage.add(image, self.detections.people)
        if stood and self._footage.moves:
            _note(f"the camera turns from {image.seconds:.1f} s on; its rotation is taken out")

    def whole_file(self, first: Playback, configs: Configs, options: argparse.Namespace) -> Playback:
        """Detect all images, learn the people's lengths from them, and track them backward and forward with these."""
        config, node = configs
        self._detect()
        if node.person_ids == MESSAGE:
            node = replace(node, person_ids=LASTING)  # those of `people_in`
        self._found: Callable[[], Images] = self.detections.of_all
        if self._several:
            people = self._chosen(options.person, node)
            self._found = partial(self.detections.of_people, people, node.several_people)

        def make(config: TrackerConfig, bodies: Bodies | None = None) -> Session:
            return Session(config, node, bodies=bodies, poses=turning)

        turning = self._shots.pose if self._shots is not None and self._shots.moves else None
        if turning is not None:
            first = Playback(make(config))
        known = learn(make, self._play, config) if config.calibrate else None
        last = Playback(first.session if known is None else known.session(make))
        backward = known is not None and any(known.backward.values())
        self._passes = _passes_in_words(config.calibrate, backward, config.smoothing_lag > 0)
        self._heights = {} if known is None else known.heights
        self._outputs.follow(last)
        self._track_again(last, options)
        return last

    def _detect(self) -> None:
        """Detect the people in all images, until the end or until SIGINT or SIGTERM."""
        progress = Progress(self._source.count, "images")
        with stop_flag() as stopped:
            for image, _ in self.detections.images(stopped, progress):
                self._outputs.add_report_image(image)
                self._follow_background(image)
                progress.advance(note=f"{len(self.detections.found[-1][1])} in view")
        if self._shots is not None:
            self._shots.finish()
            for remark in self._shots.remarks():
                _note(remark)
                self._outputs.remarks.append(remark)
            self._outputs.remarks += self._shots.unknown()

    def _chosen(self, person: str | None, node: NodeSettings) -> list[tuple[int, Seen]]:
        """Choose among the people in the images, and return their numbers and images."""
        people = people_of_shots(self.detections.found, [] if self._shots is None else self._shots.cuts)
        who = person or (ALL if node.several_people else LARGEST)
        chosen = choose(who, people, node.max_people)
        self._who = _who_in_words(people, chosen, self._source.size[0])
        self._outputs.remarks += [self._who] if self._who else []
        return [(i + 1, people[i]) for i in chosen]

    def _play(self, tracker: Playback, title: str) -> None:
        """Play the kept keypoints."""
        tracker.camera_info(self._info, FIRST_STAMP_NS)
        progress = Progress(len(self.detections.found), "frames")
        for seconds, keypoints in self._found():
            self._begin_take(tracker, seconds)
            tracker.keypoints(keypoints, stamp_of(seconds))
            progress.advance(note=f"{title}, {tracker.session.status.value}")
        tracker.finish()
        progress.close()

    @property
    def _shots(self) -> Footage | None:
        """The shots of a file."""
        return self._footage if isinstance(self._footage, Footage) else None

    def _begin_take(self, tracker: Playback, seconds: float) -> None:
        """Begin a new take if an image at a time, s, is the first of a shot."""
        if self._shots is not None and self._shots.begins_at(seconds):
            tracker.begin_take()

    def _track_again(self, tracker: Playback, options: argparse.Namespace) -> None:
        """Track the kept keypoints; the images are read again if an output shows them."""
        tracker.camera_info(self._info, FIRST_STAMP_NS)
        images = open_input(options)[0].images if self._outputs.needs_images else iter(())
        progress = Progress(len(self.detections.found), "frames")
        for seconds, keypoints in self._found():
            if self._outputs.needs_images:
                self._outputs.add_image(_next_image(images, self._source.name))
            self._begin_take(tracker, seconds)
            tracker.keypoints(keypoints, stamp_of(seconds))
            progress.advance(note="last pass")
        tracker.finish()
        progress.close()

    def summary(self, tracker: Playback, options: argparse.Namespace, written: list[Path]) -> str:
        """Return the summary of the run, one fact per line."""
        counts, error = tracker.session.counts, tracker.reprojection_px
        times, detect_times = tracker.frame_seconds or [np.nan], self.detections.detect_seconds or [np.nan]
        lines = {
            "images": f"{counts['received']} in, {tracker.messages_tracked} tracked",
            "height": _height_line(tracker, options, self._heights),
            "reprojection": f"{np.median(error):.2f} px median" if error else "nothing was tracked",
            "detector": f"{1e3 * float(np.median(detect_times)):.1f} ms median",
            "tracker": f"{1e3 * float(np.median(times)):.2f} ms median",
            "total": f"{time.monotonic() - self._started:.1f} s",
        }
        if self._who:
            lines["people"] = self._who
        if self._passes:
            lines["passes"] = f"{self._passes} (--causal tracks as a camera's images)"
        lines["written"] = ", ".join(map(str, written)) or "nothing"
        facts = [f"{name:<15} {text}" for name, text in lines.items()]
        return "\n".join([self._source.name, *facts, *self._outputs.doubts])


def _passes_in_words(learned: bool, backward: bool, smoothed: bool) -> str:
    """Return the passes over a file that were made. learned: that for the lengths, which the backward one needs."""
    made = ", ".join(["lengths"] * learned + ["backward"] * backward + ["forward"]) + "; smoothed" * smoothed
    return made if learned else f"{made}; those for the lengths and backward need calibrate"


def _who_in_words(people: Sequence[Seen], chosen: Sequence[int], width: int) -> str:
    """Return who is in the images and who is tracked; empty for one person. width: of the images, px."""
    if len(people) < 2:
        return ""
    numbers = " and ".join(str(i + 1) for i in chosen)
    listed = "; ".join(f"{number}: {person.words(width)}" for number, person in enumerate(people, 1))
    tracked = f"number {numbers} is tracked" if len(chosen) == 1 else f"numbers {numbers} are tracked"
    return f"{len(people)} people in the images, {tracked} (`--person`). {listed}."


def _next_image(images: Iterator[Any], name: str) -> Any:
    image = next(images, None)
    if image is None:
        raise SourceError(f"{name} has fewer images when it is read again")
    return image


def _height_line(tracker: Playback, options: argparse.Namespace, before: Mapping[str, str]) -> str:
    """Return the height. Without one, sizes and distances are those of a person of the default height.

    before: see `Known.heights`.
    """
    session = tracker.session
    if measured := list(before.values()) or list(map(height_in_words, session.heights().values())):
        return "; ".join(measured)
    if height_given(options):
        return session.tracker.config.height_text
    return f"{ASSUMED_HEIGHT:g} m is assumed; sizes and distances scale with it, set --height"


@contextmanager
def stop_flag() -> Iterator[list[int]]:
    """Yield a list that is not empty after SIGINT or SIGTERM. A second signal acts as usual."""
    received: list[int] = []

    def stop(number: int, _: object) -> None:
        received.append(number)
        for signal_number, handler in previous.items():
            signal.signal(signal_number, handler)

    previous = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def lens_of(options: argparse.Namespace, source: Source, quiet: bool = False) -> Calibration:
    """Return the lens of a video by the options --camera-info and --fov. Raises CameraError.

    quiet: do not warn if there is neither.
    """
    if options.camera_info is not None and options.fov is not None:
        raise CameraError("--camera-info has the lens; expected no --fov beside it")
    if options.camera_info is None and options.fov is None and not quiet:
        _note(assumed_fov_warning("--fov or --camera-info"))
    if options.camera_info is None and source.content != source.size:
        width, height = source.content
        _note(f"the images have black bars; the field of view is that of the {width} x {height} px between them")
    return choose_camera(options.camera_info, options.fov, source.size, source.content, options.fisheye)


def _note(text: str) -> None:
    print_note(f"{PROGRAM}: {text}")
