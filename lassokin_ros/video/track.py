"""Run detector and tracker over the images of one video or several, and write the requested files.

A file is detected once and tracked several times, see `lassokin_ros.replay.passes`. Several videos share one lasso a
frame; without a file with the places of their cameras, the first pass finds them from the person.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.common.command_line import print_note
from lassokin_ros.common.interruption import Interrupted, stop_flag
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
from lassokin_ros.video.cameras import (
    Filmed,
    calibration_toml,
    found_poses,
    images_together,
    open_cameras,
    where_in_words,
)
from lassokin_ros.video.people import ALL, LARGEST, choose, largest_in, only, people_of_shots, who_in_words
from lassokin_ros.video.run_settings import ASSUMED_HEIGHT, height_given, settings_of
from lassokin_ros.video.shots import Footage, LiveFootage
from lassokin_ros.video.sources import FIRST_STAMP_NS, SourceError, stamp_of
from lassokin_ros.video.synchrony import checked_places, given_offsets, shifted, synchronised
from lassokin_ros.video.track_outputs import TrackOutputs


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
    with AtomicFiles(options.force, OutputError) as files, closing(detector):
        run = Run(options, cameras, detector, files)
        if run.is_live:
            run.live(detector)
        else:
            run.whole_files(detector, offsets)
        written = run.write(files)
        files.check()
    return run.end(written)


class Run:
    """One run over the videos of one camera or several."""

    def __init__(
        self, options: argparse.Namespace, cameras: list[Filmed], detector: Detector, files: AtomicFiles
    ) -> None:
        """detector: of the first camera. files: see `TrackOutputs`. Raises a LassokinError."""
        self._options, self._cameras = options, cameras
        self._started = time.monotonic()
        first = cameras[0]
        self._of_several = bool(first.name)  # videos of a scene, with the cameras' names
        self._many = detector.several or any(one.stored is not None and one.stored.several for one in cameras)
        self._config, self._node = settings_of(options, cameras, detector.landmarks, self._many)
        self.is_live = not self._of_several and (first.source.live or bool(options.causal))
        self._poses: Mapping[str, CameraPose] | Callable[[int], CameraPose] | None = None
        if self._of_several:
            self._poses = {camera.name: camera.pose for camera in cameras}
        elif first.stored is None:
            follow = LiveFootage if self.is_live else Footage
            first.footage = follow(first.calibration, first.source.size, first.source.content)
            self._poses = first.footage.pose if self.is_live else None
        self._tracker = Playback(self._make(self._config))
        self._outputs = TrackOutputs(options, cameras, self._tracker, files)
        self._known: Known | None = None
        self._facts: list[tuple[str, str]] = []  # lines of the summary about people and cameras
        self._stopped = False

    def _make(self, config: TrackerConfig, bodies: Bodies | None = None) -> Session:
        return Session(config, self._node, bodies=bodies, poses=self._poses)

    @property
    def _unplaced(self) -> bool:
        """Whether nobody tells where the cameras are."""
        return self._of_several and self._options.cameras is None

    def live(self, detector: Detector) -> None:
        """Track each image as it comes, until the end or until SIGINT or SIGTERM."""
        tracker, (camera,) = self._tracker, self._cameras
        self._outputs.follow(tracker)
        tracker.camera_info(camera.calibration.intrinsics(camera.frame_id), FIRST_STAMP_NS)
        progress, stood = Progress(camera.source.count, "images"), True
        with stop_flag() as stopped:
            for image, people in camera.detect(detector, stopped, progress, keep=not camera.source.live):
                self._outputs.add_report_image(image)
                self._outputs.add_images({"": image})
                if stood and camera.footage is not None and camera.footage.moves:
                    stood = False
                    _note(f"the camera turns from {image.seconds:.1f} s on; its rotation is taken out")
                tracker.keypoints(camera.keypoints(image.seconds, people, self._many), stamp_of(image.seconds))
                progress.advance(note=tracker.session.roster.status.value)
            tracker.finish()
        self._stopped = bool(stopped)

    def whole_files(self, detector: Detector, offsets: Sequence[float] | None) -> None:
        """Detect all images, learn the people's lengths from them, and track them backward and forward with these.

        offsets: see --offsets. Raises a LassokinError; Interrupted if a signal comes too early for any result.
        """
        with stop_flag() as stopped:
            self._detect(self._cameras[0], detector, stopped)
            for camera in self._cameras[1:]:
                with closing(camera.stored or make_detector(self._options.detector)) as own:
                    self._detect(camera, own, stopped)  # of its own: it follows the person from image to image
        self._stopped = bool(stopped)
        self._put_together(offsets)
        self._choose_people()
        if (self._config.calibrate or self._unplaced) and not self._options.causal:
            self._known = learn(self._make, self._play, self._config)
            if self._unplaced:
                self._use_found_places(self._known)
                self._known = replace(self._known, config=replace(self._known.config, extrinsics=CHECK))
        self._tracker = Playback(self._known.session(self._make) if self._known else self._make(self._config))
        self._outputs.follow(self._tracker)
        self._play(self._tracker, "last pass", self._outputs.needs_images)

    def _detect(self, camera: Filmed, detector: Detector, stopped: list[int]) -> None:
        """Detect the people in all images, until the end or until SIGINT or SIGTERM."""
        progress = Progress(camera.source.count, "images")
        for image, people in camera.detect(detector, stopped, progress):
            self._outputs.add_report_image(image, camera.name)
            progress.advance(note=camera.name or f"{len(people)} in view")

    def _put_together(self, offsets: Sequence[float] | None) -> None:
        """Put the videos on one clock, and say what they show of their cameras. offsets: of --offsets."""
        cameras, notes = self._cameras, list[str]()
        if self._stopped:  # the part that was detected in all
            if not all(camera.found for camera in cameras):
                raise Interrupted("nothing was written")
            end = min(camera.found[-1][0] for camera in cameras)
            for camera in cameras:
                camera.found = [found for found in camera.found if found[0] <= end]
        names, found = [camera.name for camera in cameras], [camera.found for camera in cameras]
        courses, remarks = synchronised(names, found, offsets)
        notes += [f"{remark[0].upper()}{remark[1:]}." for remark in remarks]
        for camera, course in zip(cameras, courses):
            camera.course, camera.found = course, shifted(course, camera.found)
            if self._of_several:
                self._outputs.move_report_images(camera)
        if self._of_several and not self._unplaced:
            tracker, given = self._tracker.session.tracker, [camera.pose for camera in cameras]
            rest = tracker.skeleton.rest_positions[tracker.layout.joints] + tracker.layout.offsets
            lenses, found = [camera.calibration for camera in cameras], [camera.found for camera in cameras]
            poses, words = checked_places(found, lenses, given, tracker.layout.names, rest, self._node.fixed_frame)
            notes += words
            self._poses = {camera.name: pose for camera, pose in zip(cameras, poses)}  # in m
        for footage in (camera.footage for camera in cameras):
            if footage is not None:
                footage.finish()
                notes += footage.remarks()
                self._outputs.remarks += footage.unknown()
                self._poses = footage.pose if footage.moves else None
        for remark in notes:
            _note(remark)
        self._outputs.remarks += notes
        self._facts += [("note", remark) for remark in notes]

    def _choose_people(self) -> None:
        """Keep those who are to be tracked, and say who they are. In several videos nobody knows who is who."""
        if not self._of_several and self._node.person_ids == MESSAGE:
            self._node = replace(self._node, person_ids=LASTING)  # those of `people_in`
        if not self._many or self._of_several and self._node.several_people:
            return
        for camera in self._cameras:
            width = camera.source.size[0]
            if self._of_several:
                camera.found, words = largest_in(camera.found, camera.name, width)
            else:
                cuts = [] if camera.footage is None else camera.footage.cuts
                people = people_of_shots(camera.found, cuts)
                who = self._options.person or (ALL if self._node.several_people else LARGEST)
                chosen = choose(who, people, self._node.max_people)
                camera.found = only(camera.found, [(i + 1, people[i]) for i in chosen])
                words = who_in_words(people, chosen, width)
            self._outputs.remarks += [words] if words else []
            self._facts.append(("people", words))

    def _use_found_places(self, known: Known) -> None:
        """Use the places of the cameras that the first pass has found."""
        try:
            self._poses = found_poses(known.first)
        except CameraError:
            if self._stopped:
                raise Interrupted("nothing was written") from None
            raise

    def _play(self, tracker: Playback, title: str, show: bool = False) -> None:
        """Play the keypoints of all cameras in the order of their times. show: give the images to the outputs, too."""
        for camera in self._cameras:
            tracker.camera_info(camera.calibration.intrinsics(camera.frame_id), FIRST_STAMP_NS, camera.name)
        images = images_together(self._cameras, self._options) if show else iter(())
        found = [(at, camera, people) for camera in self._cameras for at, people in camera.found]
        progress = Progress(len(found), "frames")
        for seconds, camera, people in sorted(found, key=lambda one: one[0]):
            if show and camera is self._cameras[0]:
                if (together := next(images, None)) is None:
                    raise SourceError(f"{camera.source.name} has fewer images when it is read again")
                self._outputs.add_images(together)
            if camera.footage is not None and camera.footage.begins_at(seconds):
                tracker.begin_take()
            keypoints = camera.keypoints(seconds, people, self._node.several_people)
            tracker.keypoints(keypoints, stamp_of(seconds), camera.name)
            progress.advance(note=f"{title}, {tracker.session.roster.status.value}")
        tracker.finish()
        progress.close()

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
        tracker, cameras = self._tracker, self._cameras
        counts, error = tracker.session.counts, tracker.reprojection_px
        seconds = [one for camera in cameras for one in camera.detect_seconds] or [np.nan]
        tracked = f"{tracker.messages_tracked}{' instants' * self._of_several}"
        facts = [
            ("images", f"{counts['received']} in, {tracked} tracked"),
            ("height", self._height_line()),
            ("reprojection", f"{np.median(error):.2f} px median" if error else "nothing was tracked"),
            ("detector", f"{1e3 * float(np.median(seconds)):.1f} ms median"),
            ("tracker", f"{1e3 * float(np.median(tracker.frame_seconds or [np.nan])):.2f} ms median"),
            ("total", f"{time.monotonic() - self._started:.1f} s"),
            ("passes", self._passes_line()),
            *self._facts,
            *self._places(),
            ("written", ", ".join(map(str, written)) or "nothing"),
        ]
        names = [one.source.name + f" ({one.name})" * self._of_several for one in cameras]
        summary = [", ".join(names), *(f"{name:<15} {text}" for name, text in facts if text), *self._outputs.doubts]
        complete = not self._stopped or self.is_live and cameras[0].source.count == 0
        return Tracked("\n".join(summary), complete, "; ".join(one.fault for one in cameras if one.fault))

    def _places(self) -> Iterator[tuple[str, str]]:
        """Yield where the cameras were found, or by how much their given places are off."""
        session, first = self._tracker.session, self._cameras[0]
        places, extrinsics = session.placement.places, session.roster.extrinsics
        for camera in self._cameras[1:]:
            if self._unplaced and places is not None and camera.name in places.newest:
                yield f"camera {camera.name}", where_in_words(places.newest[camera.name], first.pose)
            elif extrinsics is not None and (words := extrinsics.in_words(camera.name)):
                yield f"camera {camera.name}", words

    def _height_line(self) -> str:
        """Return the height. Without one, sizes and distances are those of a person of the default height."""
        session = self._tracker.session
        learned = self._known.heights if self._known else {}
        if measured := list(learned.values()) or list(map(height_in_words, session.roster.heights().values())):
            return "; ".join(measured)
        if height_given(self._options) or self._options.cameras is not None:
            return session.tracker.config.height_text
        return f"{ASSUMED_HEIGHT:g} m is assumed; sizes and distances scale with it, set --height"

    def _passes_line(self) -> str:
        """Return the passes over a file that were made."""
        if self._options.causal or self.is_live:
            return ""
        learned, backward = self._known is not None, self._known is not None and any(self._known.backward.values())
        made = ", ".join(["lengths"] * learned + ["backward"] * backward + ["forward"])
        made += "; smoothed" * (self._config.smoothing_lag > 0)
        made += "" if learned else "; those for the lengths and backward need calibrate"
        return f"{made} (--causal tracks as a camera's images)"


def _note(text: str) -> None:
    print_note(f"{PROGRAM}: {text}")
