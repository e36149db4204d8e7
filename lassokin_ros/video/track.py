"""Run detector and tracker over the images of a source, and write the requested files."""

from __future__ import annotations

import argparse
import signal
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.common.progress import Progress
from lassokin_ros.common.summary_output import print_note
from lassokin_ros.core.evidence.upright import level_from_camera
from lassokin_ros.detector.backend import Detector, make_detector
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.settings import OPTICAL_FRAME
from lassokin_ros.replay.bags import typestore
from lassokin_ros.replay.exports.exports import Exports
from lassokin_ros.replay.motion import MotionRecorder
from lassokin_ros.replay.offline_tracker import OfflineTracker
from lassokin_ros.replay.output_paths import OutputError
from lassokin_ros.replay.report.report import Report
from lassokin_ros.video import PROGRAM
from lassokin_ros.video.camera import DEFAULT_FOV, Calibration, assumed_fov_warning, choose_camera
from lassokin_ros.video.live_view import LiveView
from lassokin_ros.video.output_video import OutputVideo
from lassokin_ros.video.sources import Image, Source, SourceError, open_source
from msg_adapters.backends import RosbagsBackend
from msg_adapters.inputs import point_cloud

FIRST_STAMP_NS = 1_000_000_000
"""ns: a stamp of zero means no stamp."""
COMPLETE = 0.9
"""Share of the announced images from which a file counts as complete. Some formats give only an estimate."""


@dataclass(frozen=True)
class Tracked:
    """The end of a run. summary: to be printed. complete: the source was read to its end, or a camera was stopped.

    fault: why the source ended early, in words; empty if it did not. The files hold what was tracked until then.
    """

    summary: str
    complete: bool
    fault: str


def track(options: argparse.Namespace) -> Tracked:
    """Track a source and write the requested files. Raises a LassokinError."""
    source = open_source(options.source, options.fps)  # before the detector, which takes seconds to load
    detector = make_detector(options.detector)
    height = [] if options.height is None else [f"height:={options.height}"]
    layout = f"landmarks:={detector.landmarks}"
    configs = offline_settings(options.params_file, [layout, *options.p, *height])
    if configs[1].camera_mount_frame:
        _note("camera_mount_frame is not used, since a video has no TF; set camera_pitch and camera_roll")
    types = typestore()
    tracker = OfflineTracker(*configs, types)
    report = None if options.report is None else Report(options.report, tracker.pipeline, options.force)
    exports = _exports(options, tracker)
    if report is not None:
        tracker.listeners.append(report.add)
    backend = RosbagsBackend(types)
    with ExitStack() as stack, AtomicFiles(options.force, OutputError) as files:
        stack.callback(detector.close)
        camera = _camera(options, source)
        info = camera.message(backend, FIRST_STAMP_NS, OPTICAL_FRAME)
        for _ in tracker.camera_info(info, FIRST_STAMP_NS):
            pass
        video = None
        if options.video is not None:
            video = OutputVideo(options.video, source.size, source.fps, options.force)
            stack.callback(video.discard)
        view = _view(options, source, camera)
        if view is not None:
            stack.callback(view.discard)
        run = Run(source, detector, tracker, backend, report, video, view)
        complete = run.all_images()
        if report is not None:
            report.write(files, source.name, (f"of {detector_name(options)}", camera_name(options)), own_keypoints=True)
        if exports is not None:
            exports.write(Path(), files)
        if video is not None:
            video.finish()
        if view is not None:
            view.finish()
    return Tracked(run.summary(options), complete, run.fault)


class Run:
    """One run over a source. Images wait in a queue until the tracker has returned their frames."""

    def __init__(
        self,
        source: Source,
        detector: Detector,
        tracker: OfflineTracker,
        backend: Any,
        report: Report | None,
        video: OutputVideo | None,
        view: LiveView | None,
    ) -> None:
        self._source, self._detector, self._tracker, self._backend = source, detector, tracker, backend
        self._report, self._video, self._view = report, video, view
        self._waiting: deque[tuple[int, Image]] = deque()
        self.detect_seconds: list[float] = []
        self.fault = ""
        if video is not None:
            tracker.listeners.append(self._draw)
        if view is not None:
            tracker.listeners.append(self._show)

    def all_images(self) -> bool:
        """Track all images until the end or until SIGINT or SIGTERM; return True at the end of the source."""
        progress = Progress(self._source.count, "images")
        started = time.monotonic()
        with _stop_flag() as stopped:
            try:
                for image in self._source.images:
                    if stopped:
                        break
                    self._one(image)
                    progress.advance(note=self._tracker.pipeline.status.value)
            except SourceError as error:
                if not self.detect_seconds:
                    raise
                self.fault = str(error)
            finally:
                progress.close()
            for _ in self._tracker.finish():
                pass
        read, count = len(self.detect_seconds), self._source.count
        if not stopped and not self.fault and read < COMPLETE * count:
            _note(f"{self._source.name} announces {count} images, {read} could be read; it may be damaged")
        self.seconds = time.monotonic() - started
        return not stopped or self._source.count == 0

    def _one(self, image: Image) -> None:
        stamp_ns = FIRST_STAMP_NS + round(image.seconds * 1e9)
        began = time.monotonic()
        found = self._detector.detect(image.rgb, image.seconds)
        self.detect_seconds.append(time.monotonic() - began)
        message = point_cloud(self._backend, stamp_ns, OPTICAL_FRAME, found.pixels, found.confidence)
        if self._report is not None:
            self._report.add_image(stamp_ns, lambda: image.rgb)
        if self._video is not None:
            self._waiting.append((stamp_ns, image))
        if self._view is not None:
            self._view.add_image(image)
        for _ in self._tracker.keypoints(message, stamp_ns):
            pass

    def _draw(self, frames: Sequence[FrameResult], time_ns: int, _seconds: float) -> None:
        assert self._video is not None
        stamp_ns = frames[0].stamp_ns if frames else time_ns
        while self._waiting and self._waiting[0][0] <= stamp_ns:
            own_ns, image = self._waiting.popleft()
            self._video.add(image.seconds, image.rgb, list(frames) if own_ns == stamp_ns else [])

    def _show(self, frames: Sequence[FrameResult], time_ns: int, _seconds: float) -> None:
        assert self._view is not None
        self._view.add(((frames[0].stamp_ns if frames else time_ns) - FIRST_STAMP_NS) * 1e-9, frames)

    def summary(self, options: argparse.Namespace) -> str:
        """Return the summary of the run, one fact per line."""
        counts, error = self._tracker.pipeline.counts, self._tracker.reprojection_px
        times = self._tracker.frame_seconds or [np.nan]
        lines = {
            "images": f"{counts['received']} in, {counts['accepted']} tracked",
            "reprojection": f"{np.median(error):.2f} px median" if error else "nothing was tracked",
            "detector": f"{1e3 * float(np.median(self.detect_seconds or [np.nan])):.1f} ms median",
            "tracker": f"{1e3 * float(np.median(times)):.2f} ms median",
            "total": f"{self.seconds:.1f} s",
        }
        files = [options.report, *options.export, options.video, options.view]
        lines["written"] = ", ".join(str(file) for file in files if file is not None and file.name) or "nothing"
        doubts = [] if self._report is None else self._report.summary_lines
        return "\n".join([self._source.name, *(f"{name:<15} {text}" for name, text in lines.items()), *doubts])


def detector_name(options: argparse.Namespace) -> str:
    """Return the detector for the report's title line."""
    return Path(options.detector).name


def camera_name(options: argparse.Namespace) -> str:
    """Return the camera for the report's title line."""
    if options.camera_info is not None:
        return f"of {options.camera_info.name}"
    return f"with a field of view of {DEFAULT_FOV if options.fov is None else options.fov:g} degrees"


@contextmanager
def _stop_flag() -> Iterator[list[int]]:
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


def _view(options: argparse.Namespace, source: Source, camera: Calibration) -> LiveView | None:
    if options.view is None:
        return None
    path = options.view if options.view.name else None
    return LiveView(path, source.name, camera, source.size, options.force)


def _exports(options: argparse.Namespace, tracker: OfflineTracker) -> Exports | None:
    if not options.export:
        return None
    pipeline = tracker.pipeline
    recorder = MotionRecorder(pipeline.tracker.layout.names, lambda: level_from_camera(*pipeline.camera_angles))
    exports = Exports(options.export, recorder, tracker.pipeline.config.several_people, options.force)
    tracker.listeners.append(recorder.add)
    return exports


def _camera(options: argparse.Namespace, source: Source) -> Calibration:
    if options.camera_info is None and options.fov is None:
        _note(assumed_fov_warning("--fov or --camera-info"))
    if options.camera_info is None and source.content != source.size:
        width, height = source.content
        _note(f"the images have black bars; the field of view is that of the {width} x {height} px between them")
    return choose_camera(options.camera_info, options.fov, source.size, source.content)


def _note(text: str) -> None:
    print_note(f"{PROGRAM}: {text}")
