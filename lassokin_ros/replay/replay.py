"""Run the tracker on one rosbag2 recording, without ROS, and write the outputs to another recording."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.common.progress import Progress
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.recording import WHOLE_FILE
from lassokin_ros.pipeline.depth.depth_images import MATCHED, UNMATCHED
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.description.skeleton_file import check_skeleton_file
from lassokin_ros.pipeline.outputs.outputs import LINK_AS_FRAME
from lassokin_ros.pipeline.outputs.status.calibration_status import averaged_sides, height_in_words
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.bags import BagReader, BagWriter, RecordedTopic
from lassokin_ros.replay.camera_source import RecordedCamera, messages_of, poses_in, recorded_cameras
from lassokin_ros.replay.exports.exports import Exports, is_inside_name
from lassokin_ros.replay.motion import MotionRecorder
from lassokin_ros.replay.output_paths import OutputError, check_output_paths, refuse_existing_files
from lassokin_ros.replay.passes.passes import Bodies, learn
from lassokin_ros.replay.playback import PATIENCE_S, Listener, NodeMessages, Playback
from lassokin_ros.replay.record import KEY, Figures, Record, origin_of
from lassokin_ros.replay.recorded_images import recorded_images
from lassokin_ros.replay.recording_files import recording_name

if TYPE_CHECKING:
    from lassokin_ros.replay.report.report import Report


Inputs = Mapping[str, Callable[[Any, int], None]]
"""By the topic's name, what processes its messages."""


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
        cameras = recorded_cameras(bag, options, node_config)
        others = _other_topics(bag, node_config)
        read = [*(topic for one in cameras for topic in one.topics), *others]
        poses = poses_in(cameras)

        def make(config: TrackerConfig, bodies: Bodies | None = None) -> Session:
            return Session(config, node_config, poses=poses, bodies=bodies, patience=PATIENCE_S)

        def play(playback: Playback, title: str) -> None:
            inputs = _inputs(playback, cameras, others)
            progress = Progress(sum(topic.count for topic in read), title, progress_on)
            _run(messages_of(cameras, bag, read), inputs, playback, progress)

        known = learn(make, play, tracker_config) if options.two_pass else None
        given = None if known is None else known.first.tracker.given_skeleton
        session = make(tracker_config) if known is None else known.session(make)
        listeners: list[Listener] = []
        report = _report(options, session, given, listeners)
        exports = _exports(options, session, listeners)
        images = recorded_images(bag, options, report, {one.name: one.keypoints for one in cameras})
        read += [shown.topic for shown in images]
        output, storage = options.output, options.storage or bag.storage
        # All or nothing: every file is complete on the disk before the recording and the files get their names.
        with AtomicFiles(options.force, OutputError) as files:
            with BagWriter(output, storage, bag.types, options.force, is_inside_name) as writer:
                tracker = Playback(session, NodeMessages(session, bag.types, writer.write))
                tracker.listeners += listeners
                inputs = {**_inputs(tracker, cameras, others), **{shown.topic.name: shown.take for shown in images}}
                progress = Progress(sum(topic.count for topic in read), "messages", progress_on)
                seconds = _run(messages_of(cameras, bag, read), inputs, tracker, progress)
                figures = _figures(tracker)
                writer.note(KEY, Record(origin_of(options), figures).text)
                written = _files(options, tracker, exports, writer, files)
                if report is not None:
                    report.write(
                        files, options.bag.resolve().name, _topics_of(cameras), warnings=tracker.warnings.found
                    )
                files.check()
            files.placed.append(output)
    written.update({f"images {n}" if n else "images": str(shown) for n, shown in enumerate(images)})
    title = f"{options.bag} -> {output} ({storage})"
    heights = session.heights().items()
    words = {person: height_in_words(height) for person, height in heights} if known is None else known.heights
    summary = _summary(title, cameras, tracker, seconds, written, words, report is not None)
    if report is not None:
        summary = "\n".join([summary, *report.summary_lines])
    frame_ms = 1e3 * float(np.median(tracker.frame_seconds or [np.nan]))
    return Replayed(summary, figures, frame_ms, _warning(figures, tracker))


def _topics_of(cameras: Sequence[RecordedCamera]) -> tuple[str, str]:
    """Return the keypoint topics, and the camera_info topics or what replaces them."""
    return ", ".join(one.keypoints.name for one in cameras), ", ".join(one.source.name for one in cameras)


def _check_learning(options: argparse.Namespace, tracker: TrackerConfig, node: NodeSettings) -> None:
    """Raise a LassokinError if --save-skeleton or --two-pass cannot be done with these settings."""
    if options.save_skeleton is not None:
        if not tracker.calibrate:
            raise ConfigurationError("--save-skeleton needs calibration; add -p calibrate:=true")
        check_skeleton_file(options.save_skeleton, node.several_people, options.force)
    if options.two_pass and not tracker.calibrate:
        raise ConfigurationError("--two-pass needs calibration; add -p calibrate:=true")


def _other_topics(bag: BagReader, config: NodeSettings) -> list[RecordedTopic]:
    """Return the topics of depth images and of TF, if the settings need them."""
    found = []
    if config.depth:
        for name in config.camera_names:
            topic = config.depth_topic(name)
            found.append(bag.find(topics.depth_type(topic), topic, topics.DEPTH_IMAGE, "-p depth:="))
    if config.fixed_frame or config.several_cameras:
        found += [topic for topic in bag.topics if topic.name in (topics.TF, topics.TF_STATIC)]
    return found


def _inputs(tracker: Playback, cameras: Sequence[RecordedCamera], others: Sequence[RecordedTopic]) -> Inputs:
    """Return what processes the messages of each topic."""
    by_name: dict[str, Any] = {topics.TF: tracker.transforms, topics.TF_STATIC: tracker.static_transforms}
    inputs = {topic.name: by_name.get(topic.name, tracker.depth_image) for topic in others}
    config = tracker.session.config
    for camera in cameras:
        if config.depth:
            depth = next(n for n in inputs if n.strip("/") == config.depth_topic(camera.name).strip("/"))
            inputs[depth] = partial(tracker.depth_image, camera=camera.name)
        inputs[camera.source.name] = partial(tracker.camera_info, camera=camera.name)
        inputs[camera.keypoints.name] = partial(tracker.keypoints, camera=camera.name)
    return inputs


def _run(messages: Iterator[tuple[str, int, Any]], inputs: Inputs, tracker: Playback, progress: Progress) -> float:
    """Process every message (topic, recording time in ns, message) and return the elapsed time in s."""
    started = time.monotonic()
    try:
        for topic, time_ns, message in messages:
            inputs[topic](message, time_ns)
            progress.advance(note=tracker.session.status.value)
        tracker.finish()
    finally:
        progress.close()
    return time.monotonic() - started


def _files(
    options: argparse.Namespace, tracker: Playback, exports: Exports | None, writer: BagWriter, files: AtomicFiles
) -> dict[str, str]:
    """Write the skeletons and the exports; return their lines of the summary."""
    lines = {}
    if options.save_skeleton is not None:
        lines["skeleton"] = ", ".join(map(str, tracker.save_skeleton(options.save_skeleton, files)))
    if exports is not None:
        paths = exports.write(writer.folder, files)
        names = [str(options.output / path.name if path.parent == writer.folder else path) for path in paths]
        lines["exported"] = ", ".join(names) or "nothing: nobody was tracked"
        lines |= exports.remarks if names else {}
    return lines


def _report(
    options: argparse.Namespace, session: Session, given: Skeleton | None, listeners: list[Listener]
) -> Report | None:
    """Return the collector of the report, None without --report. Raises a LassokinError for an unusable path.

    given: the skeleton before the first of two passes, if there are two.
    """
    if options.report is None:
        return None
    from lassokin_ros.replay.report.report import Report

    report = Report(options.report, session, options.force, given)
    listeners.append(report.add)
    return report


def _exports(options: argparse.Namespace, session: Session, listeners: list[Listener]) -> Exports | None:
    """Return the collector of the exports, None without --export. Raises a LassokinError for an unusable path."""
    if not options.export:
        return None
    names, config = session.tracker.layout.names, session.tracker.config
    recorder = MotionRecorder(names, config, lambda: session.placement.level, 0, session.config.camera_names)
    listeners.append(recorder.add)
    return Exports(options.export, recorder, session.tracker.skeleton, session.config.several_people, options.force)


def _figures(tracker: Playback) -> Figures:
    counts, error = tracker.session.counts, tracker.reprojection_px
    median = round(float(np.median(error)), 3) if error else None
    return Figures(counts["received"], tracker.messages_tracked, tracker.times_lost, median)


def _warning(figures: Figures, tracker: Playback) -> str:
    if tracker.session.results.answered or not figures.frames_in:
        return ""
    found = f"none of {figures.frames_in} keypoint messages gave a skeleton"
    return f"{found}; first rejection: {_first_rejection(tracker)}" if tracker.first_rejection else found


def _first_rejection(tracker: Playback) -> str:
    """Return 'unknown_id: ...', empty without a rejection."""
    return ": ".join(filter(None, tracker.first_rejection or ()))


def _summary(
    title: str,
    cameras: Sequence[RecordedCamera],
    tracker: Playback,
    seconds: float,
    written: Mapping[str, str],
    heights: Mapping[str, str],
    has_report: bool,
) -> str:
    """heights: measured ones in words, by person; see `Known.heights`."""
    counts, error = tracker.session.counts, tracker.reprojection_px
    rejected = {key.partition(": ")[2]: n for key, n in sorted(counts.items()) if key.startswith("rejected: ")}
    times = 1e3 * np.array(tracker.frame_seconds or [np.nan])
    lines = {
        "frames": f"{counts['received']} in, {tracker.messages_tracked} out",
        "rejected": ", ".join(f"{reason} {count}" for reason, count in rejected.items()) or "none",
    }
    if tracker.first_rejection is not None:
        lines["rejected first"] = _first_rejection(tracker)
    lines |= {
        "initialised": "once" if tracker.initialisations == 1 else f"{tracker.initialisations} times",
        "reprojection": f"{np.median(error):.2f} px median" if error else "nothing was tracked",
        "time per frame": f"{np.median(times):.2f} ms median, {np.percentile(times, 99):.2f} ms 99th percentile",
        "in all": f"{seconds:.1f} s, {counts['received'] / max(seconds, 1e-9):.0f} frames/s",
    }
    if (places := tracker.session.placement.places) is not None:
        lines["cameras"] = places.fault or places.in_words()
    averaged = tracker.session.tracker.averaged
    if averaged:
        lines["left and right"] = averaged_sides(averaged)
    if limitations := tracker.session.tracker.limitations:
        lines["limitations"] = limitations
    if (depth := tracker.session.first.depth) is not None:
        lines["depth images"] = f"for {counts[MATCHED]} of {counts[MATCHED] + counts[UNMATCHED]} keypoint messages"
        if remark := depth.fault or depth.note:
            lines["depth images"] += f"; {remark}"
    lines |= {f"height of {person}" if person else "height": words for person, words in heights.items()}
    if not has_report:  # which has them, too
        lines |= {f"warned {number}": raised.text for number, raised in enumerate(tracker.warnings.found, 1)}
    if counts[LINK_AS_FRAME]:
        lines["base frame"] = "frame_id is the name of a link of the body; robot_description has another base"
    lines.update(written)
    inputs = [(str(camera.keypoints), camera.source.title) for camera in cameras]
    read = [
        f"{name:<15} {topic}" for pair in inputs for name, topic in zip((topics.KEYPOINTS, topics.CAMERA_INFO), pair)
    ]
    return "\n".join([title, *read, *(f"{name:<15} {text}" for name, text in lines.items())])
