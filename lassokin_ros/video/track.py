"""Run detector and tracker over the images of one video or several, and write the requested files.

A file is detected once and tracked several times, see `lassokin_ros.replay.passes`. Several videos share one lasso a
frame; without a file with the places of their cameras, the first pass finds them from the person.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.common.command_line import print_note
from lassokin_ros.common.interruption import Interrupted
from lassokin_ros.common.progress import Progress
from lassokin_ros.core.config import CHECK, TrackerConfig
from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.detector.backend import Detector, make_detector
from lassokin_ros.pipeline.outputs.figures import height_in_words
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import LASTING, MESSAGE
from lassokin_ros.replay.output_paths import OutputError
from lassokin_ros.replay.passes import Bodies, Known, learn
from lassokin_ros.replay.playback import Playback
from lassokin_ros.video import PROGRAM
from lassokin_ros.video.cameras.filmed import (
    Filmed,
    calibration_toml,
    found_poses,
    images_together,
    open_cameras,
    where_in_words,
)
from lassokin_ros.video.cameras.synchrony import checked_places, given_offsets, set_up_of, synchronised
from lassokin_ros.video.detections import FIRST_STAMP_NS, Detections, stamp_of, stop_flag
from lassokin_ros.video.footage.shots import Footage, LiveFootage
from lassokin_ros.video.people import ALL, LARGEST, Seen, choose, largest_in, people_of_shots, who_in_words
from lassokin_ros.video.run_settings import settings_of
from lassokin_ros.video.sources import Image, SourceError
from lassokin_ros.video.track_outputs import ASSUMED_HEIGHT, TrackOutputs, height_given
from msg_adapters.keypoints import Keypoints


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
    cameras = open_cameras(options)  # before the detector, which takes seconds to load
    offsets = None if options.offsets is None else given_offsets(options.offsets, len(cameras))
    stored = [camera.stored for camera in cameras if camera.stored is not None]
    if stored:
        options.detector = cameras[0].source.name
    detector = detector or (stored[0] if stored else make_detector(options.detector))
    if any(one.landmarks != detector.landmarks for one in stored) or 0 < len(stored) < len(cameras):
        raise SourceError("some sources have other keypoints, or are videos; expected one kind of keypoints for all")
    with ExitStack() as stack, AtomicFiles(options.force, OutputError) as files:
        stack.callback(detector.close)
        run = Run(options, cameras, detector, stack)
        if run.is_live:
            run.live()
        else:
            run.whole_files(offsets)
        written = run.write(files)
        files.check()
    return run.end(written)


class Run:
    """One run over the videos of one camera or several."""

    def __init__(
        self, options: argparse.Namespace, cameras: list[Filmed], detector: Detector, stack: ExitStack
    ) -> None:
        """detector: of the first camera. stack: removes outputs that are not finished. Raises a LassokinError."""
        self._options, self._cameras, self._detector = options, cameras, detector
        self._started = time.monotonic()
        (self._first, *others) = cameras
        self._of_several = bool(self._first.name)  # videos of a scene, with the cameras' names
        self._unplaced = self._of_several and options.cameras is None
        self._many = detector.several or any(one.stored is not None and one.stored.several for one in others)
        self._config, self._node = settings_of(options, cameras, detector.landmarks, self._many)
        self.is_live = not self._of_several and (self._first.source.live or bool(options.causal))
        self._footage: Footage | LiveFootage | None = None
        if not self._of_several and self._first.stored is None:
            source = self._first.source
            follow = LiveFootage if self.is_live else Footage
            self._footage = follow(self._first.calibration, source.size, source.content)
        self._poses: Mapping[str, CameraPose] | Callable[[int], CameraPose] | None = None
        if self._of_several:
            self._poses = {camera.name: camera.pose for camera in cameras}
        elif isinstance(self._footage, LiveFootage):
            self._poses = self._footage.pose
        self._tracker = Playback(self._make(self._config))
        self._outputs = TrackOutputs(options, cameras, self._tracker, stack)
        self._people: list[tuple[int, Seen]] | None = None  # those who are tracked, of one video
        self._who = self._passes = ""
        self._notes: list[str] = []
        self._heights: Mapping[str, str] = {}
        self._stopped = False

    def _make(self, config: TrackerConfig, bodies: Bodies | None = None) -> Session:
        return Session(config, self._node, bodies=bodies, poses=self._poses)

    def live(self) -> None:
        """Track each image as it comes, until the end or until SIGINT or SIGTERM."""
        tracker, source = self._tracker, self._first.source
        self._outputs.follow(tracker)
        tracker.camera_info(self._first.calibration.intrinsics(self._first.frame_id), FIRST_STAMP_NS)
        detections = self._first.detections = Detections(source, self._detector, self._first.frame_id, not source.live)
        progress = Progress(source.count, "images")
        with stop_flag() as stopped:
            for image, message in detections.images(stopped, progress):
                self._outputs.add_report_image(image)
                self._outputs.add_images({"": image})
                self._follow_background(image)
                tracker.keypoints(message, stamp_of(image.seconds))
                progress.advance(note=tracker.session.roster.status.value)
            tracker.finish()
        self._stopped = bool(stopped)

    def _follow_background(self, image: Image) -> None:
        """Use an image; say it when the camera begins to turn."""
        if self._footage is None:
            return
        stood = not self._footage.moves if isinstance(self._footage, LiveFootage) else False
        self._footage.add(image, self._first.detected.people)
        if stood and self._footage.moves:
            _note(f"the camera turns from {image.seconds:.1f} s on; its rotation is taken out")

    def whole_files(self, offsets: Sequence[float] | None) -> None:
        """Detect all images, learn the people's lengths from them, and track them backward and forward with these.

        offsets: see --offsets. Raises a LassokinError; Interrupted if a signal comes too early for any result.
        """
        with stop_flag() as stopped:
            for camera in self._cameras:
                if camera is self._first:
                    self._detect(camera, self._detector, stopped)
                    continue
                with closing(camera.stored or make_detector(self._options.detector)) as detector:
                    self._detect(camera, detector, stopped)  # of its own: it follows the person from image to image
        self._stopped = bool(stopped)
        if self._of_several:
            self._put_together(offsets)
        else:
            self._use_shots()
        known = None
        if (self._config.calibrate or self._unplaced) and not self._options.causal:
            known = learn(self._make, self._play, self._config)
            self._heights = known.heights
            known = self._with_found_places(known) if self._unplaced else known
        self._tracker = Playback(self._make(self._config) if known is None else known.session(self._make))
        backward = known is not None and any(known.backward.values())
        if not self._options.causal:
            self._passes = _passes_in_words(known is not None, backward, self._config.smoothing_lag > 0)
        self._outputs.follow(self._tracker)
        self._play(self._tracker, "last pass", self._outputs.needs_images)

    def _detect(self, camera: Filmed, detector: Detector, stopped: list[int]) -> None:
        """Detect the people in all images, until the end or until SIGINT or SIGTERM."""
        camera.detections = Detections(camera.source, detector, camera.frame_id, keep=True)
        progress = Progress(camera.source.count, "images")
        for image, _ in camera.detections.images(stopped, progress):
            self._outputs.add_report_image(image, camera.name)
            self._follow_background(image)
            progress.advance(note=camera.name or f"{len(camera.detections.people)} in view")

    def _use_shots(self) -> None:
        """Say what the background of one video shows, and choose among the people in it."""
        footage = self._footage
        if isinstance(footage, Footage):
            footage.finish()
            for remark in footage.remarks():
                _note(remark)
            self._outputs.remarks += [*footage.remarks(), *footage.unknown()]
            self._poses = footage.pose if footage.moves else None
        if self._node.person_ids == MESSAGE:
            self._node = replace(self._node, person_ids=LASTING)  # those of `people_in`
        if self._many:
            cuts = footage.cuts if isinstance(footage, Footage) else []
            people = people_of_shots(self._first.detected.found, cuts)
            who = self._options.person or (ALL if self._node.several_people else LARGEST)
            chosen = choose(who, people, self._node.max_people)
            self._who = who_in_words(people, chosen, self._first.source.size[0])
            self._outputs.remarks += [self._who] if self._who else []
            self._people = [(i + 1, people[i]) for i in chosen]

    def _put_together(self, offsets: Sequence[float] | None) -> None:
        """Put several videos on one clock, and check the places of their cameras. offsets: of --offsets."""
        cameras, kept = self._cameras, [camera.detected for camera in self._cameras]
        if self._stopped:  # the part that was detected in all
            if not all(one.found for one in kept):
                raise Interrupted("nothing was written")
            end = min(one.found[-1][0] for one in kept)
            for one in kept:
                one.found = [found for found in one.found if found[0] <= end]
        clocks = synchronised([camera.name for camera in cameras], [one.found for one in kept], offsets)
        for number, camera in enumerate(cameras):
            camera.timing = clocks.timings[number]
            camera.detected.found = clocks.shifted(number, camera.detected.found)
            self._outputs.move_report_images(camera.name, camera.timing.of_first)
        self._notes = [f"{remark[0].upper()}{remark[1:]}." for remark in clocks.remarks]
        if not self._unplaced:
            layout, skeleton = self._tracker.session.tracker.layout, self._tracker.session.tracker.skeleton
            rest = skeleton.rest_positions[layout.joints] + layout.offsets
            lenses, given = [camera.calibration for camera in cameras], [camera.pose for camera in cameras]
            found = set_up_of([one.found for one in kept], lenses, given, layout.names, rest)
            poses, words = checked_places(found, given, self._node.fixed_frame)
            self._notes += words
            self._poses = {camera.name: pose for camera, pose in zip(cameras, poses)}  # in m
        for remark in self._notes:
            _note(remark)
        if self._many and not self._node.several_people:
            for camera in cameras:
                camera.detected.found, words_of = largest_in(camera.detected.found, camera.name, camera.source.size[0])
                self._notes += [words_of] if words_of else []
        self._outputs.remarks += self._notes

    def _with_found_places(self, known: Known) -> Known:
        """Use the places of the cameras that the first pass has found."""
        try:
            self._poses = found_poses(known.first)
        except CameraError:
            if self._stopped:
                raise Interrupted("nothing was written") from None
            raise
        return replace(known, config=replace(known.config, extrinsics=CHECK))

    def _play(self, tracker: Playback, title: str, show: bool = False) -> None:
        """Play the keypoints of all cameras in the order of their times. show: give the images to the outputs, too."""
        for camera in self._cameras:
            tracker.camera_info(camera.calibration.intrinsics(camera.frame_id), FIRST_STAMP_NS, camera.name)
        images = images_together(self._cameras, self._options) if show else iter(())
        found = [(at, camera, points) for camera in self._cameras for at, points in self._keypoints(camera)]
        progress = Progress(len(found), "frames")
        for seconds, camera, keypoints in sorted(found, key=lambda one: one[0]):
            if show and camera is self._first:
                if (together := next(images, None)) is None:
                    raise SourceError(f"{self._first.source.name} has fewer images when it is read again")
                self._outputs.add_images(together)
            if isinstance(self._footage, Footage) and self._footage.begins_at(seconds):
                tracker.begin_take()
            tracker.keypoints(keypoints, stamp_of(seconds), camera.name)
            progress.advance(note=f"{title}, {tracker.session.roster.status.value}")
        tracker.finish()
        progress.close()

    def _keypoints(self, camera: Filmed) -> Iterator[tuple[float, Keypoints]]:
        """Return time in s and keypoints of each kept image of a camera."""
        if self._people is not None:
            return camera.detected.of_people(self._people, self._node.several_people)
        if self._of_several and self._node.several_people:
            return camera.detected.of_everybody()
        return camera.detected.of_all()

    def write(self, files: AtomicFiles) -> list[Path]:
        """Write the files as part of `files`, and return their paths. Raises a LassokinError."""
        written = self._outputs.write(files)
        if self._options.save_cameras is not None:
            lenses = [(camera.name, camera.calibration) for camera in self._cameras]
            files.write_text(self._options.save_cameras, calibration_toml(lenses, found_poses(self._tracker.session)))
            written.append(self._options.save_cameras)
        return written

    def end(self, written: Sequence[Path]) -> Tracked:
        """Return the end of the run, with a summary of one fact per line."""
        tracker, detections = self._tracker, [camera.detected for camera in self._cameras]
        counts, error = tracker.session.counts, tracker.reprojection_px
        seconds = [one for each in detections for one in each.detect_seconds] or [np.nan]
        tracked = f"{tracker.messages_tracked}{' instants' * self._of_several}"
        lines = {
            "images": f"{counts['received']} in, {tracked} tracked",
            "height": self._height_line(),
            "reprojection": f"{np.median(error):.2f} px median" if error else "nothing was tracked",
            "detector": f"{1e3 * float(np.median(seconds)):.1f} ms median",
            "tracker": f"{1e3 * float(np.median(tracker.frame_seconds or [np.nan])):.2f} ms median",
            "total": f"{time.monotonic() - self._started:.1f} s",
            "people": self._who,
            "passes": self._passes and f"{self._passes} (--causal tracks as a camera's images)",
            "written": ", ".join(map(str, written)) or "nothing",
        }
        facts = [(name, text) for name, text in lines.items() if text]
        facts += [*self._places(), *(("note", remark) for remark in self._notes)]
        names = [one.source.name + f" ({one.name})" * self._of_several for one in self._cameras]
        summary = [", ".join(names), *(f"{name:<15} {text}" for name, text in facts), *self._outputs.doubts]
        complete = not self._stopped or self.is_live and self._first.source.count == 0
        return Tracked("\n".join(summary), complete, "; ".join(one.fault for one in detections if one.fault))

    def _places(self) -> Iterator[tuple[str, str]]:
        """Yield where the cameras were found, or by how much their given places are off."""
        session = self._tracker.session
        places, extrinsics = session.placement.places, session.roster.extrinsics
        for camera in self._cameras[1:]:
            if self._unplaced and places is not None and camera.name in places.newest:
                yield f"camera {camera.name}", where_in_words(places.newest[camera.name], self._first.pose)
            elif extrinsics is not None and (words := extrinsics.in_words(camera.name)):
                yield f"camera {camera.name}", words

    def _height_line(self) -> str:
        """Return the height. Without one, sizes and distances are those of a person of the default height."""
        session = self._tracker.session
        if measured := list(self._heights.values()) or list(map(height_in_words, session.roster.heights().values())):
            return "; ".join(measured)
        if height_given(self._options) or self._options.cameras is not None:
            return session.tracker.config.height_text
        return f"{ASSUMED_HEIGHT:g} m is assumed; sizes and distances scale with it, set --height"


def _passes_in_words(learned: bool, backward: bool, smoothed: bool) -> str:
    """Return the passes over a file that were made. learned: that for the lengths, which the backward one needs."""
    made = ", ".join(["lengths"] * learned + ["backward"] * backward + ["forward"]) + "; smoothed" * smoothed
    return made if learned else f"{made}; those for the lengths and backward need calibrate"


def _note(text: str) -> None:
    print_note(f"{PROGRAM}: {text}")
