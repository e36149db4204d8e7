"""Run the tracker on one rosbag2 recording, without ROS, and write the outputs to another recording."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.common.progress import Progress
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.recording import WHOLE_FILE
from lassokin_ros.pipeline.depth.depth_images import MATCHED, UNMATCHED
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.figures import averaged_sides, height_in_words
from lassokin_ros.pipeline.outputs.outputs import LINK_AS_FRAME
from lassokin_ros.pipeline.outputs.saved_files import check_skeleton_file, save_all
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.bag_writer import BagWriter
from lassokin_ros.replay.bags import BagReader, RecordedTopic
from lassokin_ros.replay.camera_source import messages_of, recorded_cameras
from lassokin_ros.replay.exports.exports import Exports, is_inside_name
from lassokin_ros.replay.frames import FrameTable
from lassokin_ros.replay.motion import motions, scene_of
from lassokin_ros.replay.output_paths import OutputError, check_output_paths, refuse_existing_files
from lassokin_ros.replay.passes import Bodies, learn
from lassokin_ros.replay.playback import PATIENCE_S, NodeMessages, Playback
from lassokin_ros.replay.record import KEY, Figures, Record, origin_of
from lassokin_ros.replay.recording_files import recording_name
from lassokin_ros.replay.report.images import RecordedImages, recorded_images
from lassokin_ros.replay.report.report import Report


@dataclass(frozen=True)
class Replayed:
    """The result of a replay: printed summary, figures, and median ms per frame (which is not repeatable).

    warning: a sentence if no frame was accepted although there were keypoint messages, else empty.
    """

    summary: str
    figures: Figures
    frame_ms: float
    warning: str


def replay(options: argparse.Namespace, progress_on: TextIO | None = None) -> Replayed:
    """Track the recording options.bag and write options.output. Raises a LassokinError.

    progress_on: stream for the progress bar, stderr by default.
    """
    options.output = options.output or Path(f"{recording_name(options.bag.resolve())}_tracked")
    check_output_paths([options])
    refuse_existing_files(options)
    defaults = WHOLE_FILE if options.two_pass else {}
    tracker_config, node_config = offline_settings(options.params_file, options.p, defaults)
    _check_learning(options, tracker_config, node_config)
    with BagReader(options.bag) as bag:
        source = _Source(bag, options, node_config, progress_on)
        poses = {camera.name: camera.pose for camera in source.cameras if camera.pose is not None} or None

        def make(config: TrackerConfig, bodies: Bodies | None = None) -> Session:
            return Session(config, node_config, poses=poses, bodies=bodies, patience=PATIENCE_S)

        known = learn(make, source.play, tracker_config) if options.two_pass else None
        session = make(tracker_config) if known is None else known.session(make)
        table, report = FrameTable(session), None
        if options.report is not None:
            given = None if known is None else known.first.tracker.given_skeleton
            report = Report(options.report, session, table, options.force, given)
        exports = Exports(options.export, session.tracker.skeleton, node_config.several_people, options.force)
        images = recorded_images(bag, options, report, {one.name: one.keypoints for one in source.cameras})
        output, storage = options.output, options.storage or bag.storage
        # All or nothing: every file is complete on the disk before the recording and the files get their names.
        with AtomicFiles(options.force, OutputError) as files:
            with BagWriter(output, storage, bag.types, options.force, is_inside_name) as writer:
                tracker = Playback(session, NodeMessages(session, bag.types, writer.write))
                tracker.listeners += [table.add] if report is not None or options.export else []
                seconds = source.play(tracker, "messages", images)
                figures = _figures(tracker)
                writer.note(KEY, Record(origin_of(options), figures).text)
                written = _files(options, tracker, exports, table, writer.folder, files)
                if report is not None:
                    report.write(files, options.bag.resolve().name, source.names, warnings=tracker.warnings.found)
                files.check()
            files.placed.append(output)
    written |= {f"images {n}" if n else "images": str(shown) for n, shown in enumerate(images)}
    heights = {person: height_in_words(height) for person, height in session.roster.heights().items()}
    title = [f"{options.bag} -> {output} ({storage})", *source.lines]
    lines = _summary(tracker, seconds, heights if known is None else known.heights, report is None) | written
    summary = [*title, *(f"{name:<15} {text}" for name, text in lines.items())]
    summary += [] if report is None else report.summary_lines
    frame_ms = 1e3 * float(np.median(tracker.frame_seconds or [np.nan]))
    return Replayed("\n".join(summary), figures, frame_ms, _warning(figures, tracker))


class _Source:
    """The topics of a recording that the settings need."""

    def __init__(
        self, bag: BagReader, options: argparse.Namespace, config: NodeSettings, progress_on: TextIO | None
    ) -> None:
        """Raises BagError, CameraError."""
        self._bag, self._progress_on = bag, progress_on
        self.cameras = recorded_cameras(bag, options, config)
        self._depth: dict[str, RecordedTopic] = {}  # topics of depth images, by camera
        for camera in self.cameras if config.depth else ():
            topic = config.depth_topic(camera.name)
            found = bag.find(topics.depth_type(topic), topic, topics.DEPTH_IMAGE, "-p depth:=")
            self._depth[camera.name] = found
        transforms = (topics.TF, topics.TF_STATIC) if config.fixed_frame or config.several_cameras else ()
        self._others = [*self._depth.values(), *(topic for topic in bag.topics if topic.name in transforms)]

    @property
    def names(self) -> tuple[str, str]:
        """The keypoint topics, and the camera_info topics or what replaces them."""
        return ", ".join(one.keypoints.name for one in self.cameras), ", ".join(one.source for one in self.cameras)

    @property
    def lines(self) -> list[str]:
        """The topics as lines of the summary."""
        keypoints, info = topics.KEYPOINTS, topics.CAMERA_INFO
        pairs = [pair for one in self.cameras for pair in ((keypoints, one.keypoints), (info, one.title))]
        return [f"{name:<15} {topic}" for name, topic in pairs]

    def play(self, tracker: Playback, title: str, images: Sequence[RecordedImages] = ()) -> float:
        """Process every message, and return the elapsed time in s. title: of the progress bar."""
        inputs = self._inputs(tracker) | {shown.topic.name: shown.take for shown in images}
        read = [*(topic for one in self.cameras for topic in one.topics), *self._others]
        read += [shown.topic for shown in images]
        progress = Progress(sum(topic.count for topic in read), title, self._progress_on)
        started = time.monotonic()
        try:
            for topic, time_ns, message in messages_of(self.cameras, self._bag, read):
                inputs[topic](message, time_ns)
                progress.advance(note=tracker.session.roster.status.value)
            tracker.finish()
        finally:
            progress.close()
        return time.monotonic() - started

    def _inputs(self, tracker: Playback) -> dict[str, Callable[[Any, int], None]]:
        """Return what processes the messages of each topic."""
        inputs: dict[str, Callable[[Any, int], None]] = {topics.TF: tracker.transforms}
        inputs[topics.TF_STATIC] = partial(tracker.transforms, static=True)
        for camera in self.cameras:
            if camera.name in self._depth:
                inputs[self._depth[camera.name].name] = partial(tracker.depth_image, camera=camera.name)
            inputs[camera.source] = partial(tracker.camera_info, camera=camera.name)
            inputs[camera.keypoints.name] = partial(tracker.keypoints, camera=camera.name)
        return inputs


def _check_learning(options: argparse.Namespace, tracker: TrackerConfig, node: NodeSettings) -> None:
    """Raise a LassokinError if --save-skeleton or --two-pass cannot be done with these settings."""
    if options.save_skeleton is not None:
        if not tracker.calibrate:
            raise ConfigurationError("--save-skeleton needs calibration; add -p calibrate:=true")
        check_skeleton_file(options.save_skeleton, node.several_people, options.force)
    if options.two_pass and not tracker.calibrate:
        raise ConfigurationError("--two-pass needs calibration; add -p calibrate:=true")


def _files(
    options: argparse.Namespace,
    tracker: Playback,
    exports: Exports,
    table: FrameTable,
    folder: Path,
    files: AtomicFiles,
) -> dict[str, str]:
    """Write the skeletons and the exports; return their lines of the summary. folder: of the output, as yet."""
    lines, session = {}, tracker.session
    if options.save_skeleton is not None:
        saved = save_all(session.roster.calibrations(), options.save_skeleton, tracker.newest_ns, files)
        lines["skeleton"] = ", ".join(map(str, saved))
    if options.export:
        paths = exports.write(motions(table, scene_of(session, session.placement.level)), folder, files)
        names = [str(options.output / path.name if path.parent == folder else path) for path in paths]
        lines["exported"] = ", ".join(names) or "nothing: nobody was tracked"
        lines |= exports.remarks if names else {}
    return lines


def _figures(tracker: Playback) -> Figures:
    counts, error = tracker.session.counts, tracker.reprojection_px
    median = round(float(np.median(error)), 3) if error else None
    return Figures(counts["received"], tracker.messages_tracked, tracker.times_lost, median)


def _warning(figures: Figures, tracker: Playback) -> str:
    if tracker.session.answers.any_accepted or not figures.frames_in:
        return ""
    found = f"none of {figures.frames_in} keypoint messages gave a skeleton"
    return f"{found}; first rejection: {tracker.first_rejection}" if tracker.first_rejection else found


def _summary(tracker: Playback, seconds: float, heights: Mapping[str, str], with_warnings: bool) -> dict[str, str]:
    """Return the lines of the summary by name. seconds: of the replay. heights: see `Known.heights`."""
    session, counts, error = tracker.session, tracker.session.counts, tracker.reprojection_px
    rejected = {key.partition(": ")[2]: n for key, n in sorted(counts.items()) if key.startswith("rejected: ")}
    times = 1e3 * np.array(tracker.frame_seconds or [np.nan])
    lines = {
        "frames": f"{counts['received']} in, {tracker.messages_tracked} out",
        "rejected": ", ".join(f"{reason} {count}" for reason, count in rejected.items()) or "none",
        "rejected first": tracker.first_rejection,
        "initialised": "once" if tracker.initialisations == 1 else f"{tracker.initialisations} times",
        "reprojection": f"{np.median(error):.2f} px median" if error else "nothing was tracked",
        "time per frame": f"{np.median(times):.2f} ms median, {np.percentile(times, 99):.2f} ms 99th percentile",
        "in all": f"{seconds:.1f} s, {counts['received'] / max(seconds, 1e-9):.0f} frames/s",
    }
    if (places := session.placement.places) is not None:
        lines["cameras"] = places.fault or places.in_words()
    lines["left and right"] = averaged_sides(session.tracker.averaged) if session.tracker.averaged else ""
    lines["limitations"] = session.tracker.limitations
    if (depth := session.first.depth) is not None:
        found = f"for {counts[MATCHED]} of {counts[MATCHED] + counts[UNMATCHED]} keypoint messages"
        lines["depth images"] = "; ".join(filter(None, (found, depth.fault or depth.note)))
    lines |= {f"height of {person}" if person else "height": words for person, words in heights.items()}
    if with_warnings:
        lines |= {f"warned {number}": raised.text for number, raised in enumerate(tracker.warnings.found, 1)}
    if counts[LINK_AS_FRAME]:
        lines["base frame"] = "frame_id is the name of a link of the body; robot_description has another base"
    return {name: text for name, text in lines.items() if text}
