"""The files of `lassokin track`: report, exports, video and recording of the viewer."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.common.command_line import print_note
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.replay.exports.exports import Exports
from lassokin_ros.replay.frames import FrameTable
from lassokin_ros.replay.motion import ASSUMED, GIVEN, motions, scene_of
from lassokin_ros.replay.playback import Playback
from lassokin_ros.replay.report.images import ReportImages
from lassokin_ros.replay.report.report import Report, check_report
from lassokin_ros.video import PROGRAM
from lassokin_ros.video.camera import DEFAULT_FOV, assumed_fov_warning
from lassokin_ros.video.cameras import Filmed
from lassokin_ros.video.output_video import OutputVideo
from lassokin_ros.video.rerun_scene import LiveView
from lassokin_ros.video.run_settings import ASSUMED_HEIGHT, height_given
from lassokin_ros.video.sources import FIRST_STAMP_NS, Image, stamp_of
from lassokin_ros.video.synchrony import on_first_clock

HEIGHT_ASSUMED = (
    f"The person is taken to be {ASSUMED_HEIGHT:g} m tall. The images do not show the size: with another "
    "height, all lengths and the distance change by the same factor; set `--height`."
)
WITHOUT_H264 = (
    "the video is MPEG-4 part 2, since there is no encoder for H.264: players show it, browsers do not; "
    "install one with: pip install av"
)


class TrackOutputs:
    """Everything that a run writes or shows."""

    def __init__(
        self, options: argparse.Namespace, cameras: Sequence[Filmed], tracker: Playback, files: AtomicFiles
    ) -> None:
        """Open the outputs before anything is tracked. tracker: of the first pass. files: takes video and recording.

        Raises a LassokinError for a path that cannot be written.
        """
        source, views = cameras[0].source, {one.name: (one.calibration, one.source.size) for one in cameras}
        self._options, self._source = options, source
        lens = ASSUMED if options.fov is None and options.camera_info is None and options.cameras is None else GIVEN
        height = GIVEN if options.cameras is not None or height_given(options) else ASSUMED
        self.remarks = [HEIGHT_ASSUMED] * (height == ASSUMED)
        """Sentences for the report, to be added before `write`."""
        if lens == ASSUMED:
            remedy = assumed_fov_warning("`--fov` or `--camera-info`")
            self.remarks.append(remedy[0].upper() + remedy[1:])
        self._given: Skeleton = tracker.session.tracker.skeleton
        self._report: Report | None = None
        session = tracker.session
        self._report_images: dict[str, ReportImages] = {}
        if options.report is not None:
            check_report(options.report, options.force)
            self._report_images = {name: ReportImages() for name in session.cameras}
        self._level = session.placement.level
        self._known_from = {"lens": lens, "height_from": height}
        people = session.config.several_people
        self._exports = Exports(options.export, self._given, people, options.force) if options.export else None
        self._shown: list[OutputVideo | LiveView] = []
        if options.video is not None:
            sizes = {name: size for name, (_, size) in views.items()}
            video = OutputVideo(options.video, sizes, source.fps, files, self._level)
            self._shown.append(video)
            if not video.browsers_play:
                print_note(f"{PROGRAM}: {WITHOUT_H264}")
        if options.view is not None:
            path = options.view if options.view.name else None
            self._shown.append(LiveView(path, source.name, views, files, bool(session.config.fixed_frame)))

    @property
    def needs_images(self) -> bool:
        """Whether `add_images` must be called in the pass that `follow` follows."""
        return bool(self._shown)

    def add_report_image(self, image: Image, camera: str = "") -> None:
        """Keep an image for the report. camera: its name, if there are several."""
        if camera in self._report_images:
            self._report_images[camera].add(stamp_of(image.seconds), lambda: image.rgb)

    def move_report_images(self, camera: Filmed) -> None:
        """Put the images of a camera on the clock of the first one."""
        if camera.name in self._report_images:
            self._report_images[camera.name].move(
                lambda stamp: stamp_of(float(on_first_clock(camera.course, (stamp - FIRST_STAMP_NS) * 1e-9)))
            )

    def follow(self, tracker: Playback) -> None:
        """Take the results of a tracker from now on."""
        self._session, self._table = tracker.session, FrameTable(tracker.session)
        if self._options.report is not None or not self._source.live:
            self._report = Report(self._options.report, tracker.session, self._table, self._options.force, self._given)
            self._report.images = self._report_images
        if self._report is not None or self._exports is not None:
            tracker.listeners.append(self._table.add)
        tracker.listeners.append(self._show)

    def add_images(self, images: Mapping[str, Image]) -> None:
        """Add the images of all cameras at one instant, before their keypoints are tracked."""
        for one in self._shown:
            one.add_images(images)

    def _show(self, frames: Sequence[FrameResult], time_ns: int, _seconds: float) -> None:
        for one in self._shown:
            one.add(frames[0].stamp_ns if frames else time_ns, frames)

    def write(self, files: AtomicFiles) -> list[Path]:
        """Write the files as part of `files` and return the paths of those that exist then."""
        written = []
        if self._report is not None:
            topics = f"of {Path(self._options.detector).name}", camera_name(self._options)
            self._report.remarks = self.remarks
            self._report.write(files, self._source.name, topics, own_keypoints=True)
            written += [] if self._options.report is None else [self._options.report]
        if self._exports is not None:
            found = motions(self._table, scene_of(self._session, self._level, **self._known_from), FIRST_STAMP_NS)
            written += self._exports.write(found, Path(), files)
        for one in self._shown:
            one.finish()
        return written + [path for path in (self._options.video, self._options.view) if path is not None and path.name]

    @property
    def doubts(self) -> list[str]:
        """Lines of the summary with remarks about the exports, and the problems and doubts of the report."""
        remarks = {} if self._exports is None else self._exports.remarks
        lines = [f"{name:<15} {text}" for name, text in remarks.items()]
        return lines + ([] if self._report is None else self._report.summary_lines)


def camera_name(options: argparse.Namespace) -> str:
    """Return the camera for the report's title line."""
    if options.cameras is not None:
        return f"of {options.cameras.name}"
    if options.camera_info is not None:
        return f"of {options.camera_info.name}"
    assumed = " (assumed)" if options.fov is None else ""
    return f"with a field of view of {DEFAULT_FOV if options.fov is None else options.fov:g} degrees{assumed}"
