"""`replay --report FILE`: gathers while the replay runs, writes the page at its end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.pipeline import Pipeline
from lassokin_ros.replay.report.facts import Facts
from lassokin_ros.replay.report.log import ReplayLog
from lassokin_ros.replay.report.page import check_report, page


class Report:
    """The report of one replay."""

    def __init__(self, path: Path, pipeline: Pipeline, replace: bool = False) -> None:
        """Raises ReportError when it could not be written: now rather than after the work."""
        check_report(path, replace)
        self._path, self._pipeline = path, pipeline
        self._skeleton = pipeline.tracker.skeleton  # as given: calibration may make another of it
        self._log = ReplayLog(late=pipeline.tracker.config.smoothing_lag)

    def add(self, frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        """A keypoint message that was worked on, see `OfflineTracker.watchers`."""
        self._log.add(frames, time_ns, seconds)

    def write(self, files: AtomicFiles, title: str, topics: tuple[str, str]) -> None:
        """Write the page as one of `files`; title: the recording's name; topics: of keypoints and camera_info.

        Raises ReportError, or what `files` does.
        """
        title = title.encode(errors="backslashreplace").decode()  # a file's name may hold what UTF-8 has not
        pipeline = self._pipeline
        self._log.in_order()
        view = pipeline.camera.view
        size = view.size if view is not None and min(view.size) > 0 else None
        tracker = pipeline.tracker
        names = tracker.layout.names
        counts = dict(pipeline.counts)
        facts = Facts(title, topics, self._log, counts, tracker.config, pipeline.config, self._skeleton, names, size)
        files.write_text(self._path, page(facts))
