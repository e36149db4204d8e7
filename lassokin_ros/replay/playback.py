"""Play a recording to a session, with the recording time as its clock: figures, listeners, and the node's messages."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.answers import Answer
from lassokin_ros.pipeline.camera_images import UNREADABLE_WORDS
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics, WarningLog
from lassokin_ros.pipeline.outputs.outputs import Outputs
from lassokin_ros.pipeline.outputs.saved_files import save_all
from lassokin_ros.pipeline.parameter_files import NODE_NAME
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.backends import RosbagsBackend
from msg_adapters.detectors.definitions import DEFINITIONS as OF_DETECTORS
from msg_adapters.detectors.registry import full_type_name
from msg_adapters.output_messages.builders import DiagnosticArrayBuilder
from msg_adapters.output_messages.people import DEFINITIONS

DIAGNOSTICS_PERIOD_NS = 1_000_000_000
LAST_PERIOD_NS = 700_000_000
"""ns: if less than this is missing to the last period of the diagnostics, its warnings are collected, too."""
PATIENCE_S = 0.1
"""s of recording time for which a keypoint message waits for its depth image; `wait` if that is longer."""
NOT_RECORDED = {topic.name for topic in topics.LIVE_OUTPUTS}

Listener = Callable[[Sequence[FrameResult], int, float], None]
"""Called for every answer with its frames, recording time in ns, and tracking time in s, NaN if it has none."""
Write = Callable[[str, str, int, Any, bool], None]
"""Called with name, type, recording time in ns, message, and whether the topic is latched."""


class Playback:
    """What the node's shell is live. Methods take the messages of the recording, None for one that is damaged."""

    def __init__(self, session: Session, messages: NodeMessages | None = None) -> None:
        """session: see `PATIENCE_S`. messages: receives everything that the node would publish; None for nothing."""
        self.session, self.messages = session, messages
        self.warnings = WarningLog() if messages is None else messages.warnings
        """The warnings of /diagnostics, none without `messages`."""
        self.listeners: list[Listener] = []
        self.frame_seconds: list[float] = []
        """Time for decoding and tracking each message, s."""
        self.messages_tracked = 0
        """Keypoint messages with a skeleton; with several cameras, instants with one."""
        self.reprojection_px: list[float] = []
        """Reprojection error of each accepted frame, px."""
        self.first_rejection: tuple[str, str] | None = None
        """Key and sentence of the reason of the first rejection, also of a camera_info."""
        self.initialisations = self._reinitialised = 0
        self._seen: set[str] = set()
        self.newest_ns = 0
        """Recording time of the newest message, ns."""

    @property
    def times_lost(self) -> int:
        """The number of re-initialisations of tracked people, plus one if the recording ends in the lost state."""
        return self._reinitialised + (self.session.roster.status is Status.LOST)

    def save_skeleton(self, path: Path, files: AtomicFiles) -> list[Path]:
        """Write the calibrated skeletons as part of `files`, see `skeleton_file.save_all`."""
        return save_all(self.session.roster.calibrations(), path, self.newest_ns, files)

    def camera_info(self, message: Any, time_ns: int, camera: str = "") -> None:
        """Process a CameraInfo, or Intrinsics. time_ns: recording time, ns. camera: its name."""
        self._tick(time_ns)
        if self.messages is not None:
            self.messages.diagnostics.count_camera_info(time_ns * 1e-9)
        reason = self.session.set_camera(message, camera)
        if reason is not None and self.first_rejection is None:
            self.first_rejection = reason, self.session.inputs.camera_fault or UNREADABLE_WORDS

    def keypoints(self, message: Any, time_ns: int, camera: str = "") -> None:
        """Process a keypoint message, or Keypoints; see `camera_info`."""
        self._tick(time_ns)
        started = time.perf_counter()
        self._take(self.session.push(message, time_ns, camera), started)

    def depth_image(self, message: Any, time_ns: int, camera: str = "") -> None:
        """Process a depth image; see `camera_info`."""
        self._tick(time_ns)
        started = time.perf_counter()
        self._take(self.session.push_depth(message, time_ns, camera), started)

    def transforms(self, message: Any, time_ns: int) -> None:
        """Process a message of /tf; see `camera_info`."""
        self._tick(time_ns)
        self.session.push_transforms(message)

    def static_transforms(self, message: Any, time_ns: int) -> None:
        """Process a message of /tf_static; see `camera_info`."""
        self._tick(time_ns)
        self.session.push_transforms(message, static=True)

    def begin_take(self) -> None:
        """Note that the next image is of another shot, see `Session.begin_take`."""
        self._take(self.session.begin_take(), time.perf_counter())

    def finish(self) -> None:
        """Process what still waits at the end of the recording."""
        if self.messages is not None:
            self.messages.finish(self.newest_ns)
        self._take(self.session.finish(), time.perf_counter())

    def _tick(self, time_ns: int) -> None:
        """Process images that have waited in vain, and write what is due at a time."""
        self.newest_ns = time_ns
        if self.messages is not None:
            self.messages.check(time_ns)
        if (due_ns := self.session.due_at_ns) is not None and due_ns <= time_ns:
            started = time.perf_counter()
            self._take(self.session.due(time_ns), started)
        if self.messages is not None:
            self.messages.publish_diagnostics(time_ns)

    def _take(self, answers: Sequence[Answer], started: float) -> None:
        """Tell the listeners, and write the messages. started: s, of `perf_counter`, before the answers were made."""
        if not answers:
            return
        self.frame_seconds.append(time.perf_counter() - started)
        for answer in answers:
            seconds = self.frame_seconds[-1] if answer is answers[-1] else float("nan")
            self._count(answer)
            for listener in self.listeners:
                listener(answer.frames, answer.arrival_ns, seconds)
            if self.messages is not None:
                self.messages.publish(answer, self.newest_ns)

    def _count(self, answer: Answer) -> None:
        accepted = answer.accepted
        self.messages_tracked += bool(accepted)
        if self.first_rejection is None:
            rejected = ((f.rejection, f.detail) for f in answer.frames if f.rejection is not None)
            self.first_rejection = next(rejected, None)
        for frame in accepted:
            assert frame.estimate is not None
            self.reprojection_px.append(frame.estimate.reprojection_px)
            self.initialisations += frame.estimate.initialised
            self._reinitialised += frame.estimate.initialised and frame.person in self._seen
            self._seen.add(frame.person)


class NodeMessages:
    """The messages that the node publishes, written with the recording time, so that they are repeatable."""

    def __init__(self, session: Session, types: Any, write: Write) -> None:
        """types: the typestore of rosbags."""
        register_types(types, session.config)
        backend = RosbagsBackend(types)
        self._session, self._sink = session, _BagSink(write)
        self._outputs = Outputs(session, self._sink, backend, NODE_NAME)
        self._status, self._write = DiagnosticArrayBuilder(backend), write
        self.warnings = WarningLog()
        """The warnings of /diagnostics."""
        self._diagnostics: Diagnostics | None = None
        self._next_ns = 0

    @property
    def diagnostics(self) -> Diagnostics:
        """The figures of /diagnostics, after the first message."""
        assert self._diagnostics is not None
        return self._diagnostics

    def check(self, time_ns: int) -> None:
        """Write the state if it has changed; at the first time, begin."""
        self._sink.time_ns = time_ns
        if self._diagnostics is None:
            self._diagnostics = Diagnostics(self._session, NODE_NAME, time_ns * 1e-9)
            self._next_ns = time_ns + DIAGNOSTICS_PERIOD_NS
            self._outputs.start(time_ns)
        else:
            self._outputs.check(time_ns)

    def publish(self, answer: Answer, time_ns: int) -> None:
        """Write the messages of an answer."""
        self._sink.time_ns = time_ns
        frames = list(answer.frames)
        self.diagnostics.count_message(frames, time_ns, time_ns * 1e-9, float("nan"))  # durations are not repeatable
        self._outputs.publish(answer, time_ns)
        if self._session.scene.image is not None:
            self._outputs.write_cameras(self._session.scene.image[0], 1e-9 * time_ns)

    def publish_diagnostics(self, time_ns: int) -> None:
        """Write /diagnostics if its period is over."""
        if time_ns < self._next_ns:
            return
        self._next_ns = time_ns + DIAGNOSTICS_PERIOD_NS
        line = self.diagnostics.line(time_ns * 1e-9)
        self.warnings.add(self.diagnostics.concerns)
        name = topics.full_name(topics.DIAGNOSTICS, NODE_NAME)
        message = self._status.fill(time_ns, "", [line])
        self._write(name, topics.DIAGNOSTICS_OUTPUT.message_type, time_ns, message, False)

    def finish(self, time_ns: int) -> None:
        """Collect the warnings of the last period, if it is nearly over."""
        if self._diagnostics is not None and self._next_ns - time_ns < LAST_PERIOD_NS:
            self._diagnostics.line(time_ns * 1e-9)
            self.warnings.add(self._diagnostics.concerns)


class _BagSink:
    """A `Sink` that writes to a recording. The handle of a topic is its full name, type, and whether it is latched."""

    def __init__(self, write: Write) -> None:
        self._write = write
        self.time_ns = 0
        """Recording time of what is written now, ns."""

    def open(self, topic: topics.OutputTopic, name: str, lasting: bool) -> tuple[str, str, bool] | None:
        if topic.name in NOT_RECORDED:
            return None
        full = topics.full_name(name, NODE_NAME)
        return full, topic.message_type, topics.is_latched(full)

    def close(self, out: Any) -> None:
        """Nothing: a recording has no end of a topic."""

    def wanted(self, out: Any) -> bool:
        return True

    def write(self, out: tuple[str, str, bool], message: Any) -> None:
        name, kind, latched = out
        self._write(name, kind, self.time_ns, message, latched)


def register_types(types: Any, config: NodeSettings) -> None:
    """Register the message types of the outputs that Jazzy lacks. types: the typestore of rosbags."""
    from rosbags.typesys import get_types_from_msg

    package = full_type_name(config.people_type).split("/")[0]
    wanted = {name: text for name, text in DEFINITIONS.items() if name.split("/")[0] == package}
    if config.rep155:
        for topic in (topics.REP155_TRACKED_OUTPUT, topics.ROI_OUTPUT, topics.GESTURE_OUTPUT):
            wanted[topic.message_type] = OF_DETECTORS[topic.message_type]
    for name, definition in wanted.items():
        if name not in types.types:
            types.register(get_types_from_msg(definition, name))
