"""Play a recording to a session, with the recording time as its clock: figures, listeners, and the node's messages."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.answers import Answer
from lassokin_ros.pipeline.camera_images import UNREADABLE_WORDS
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics, WarningLog
from lassokin_ros.pipeline.outputs.outputs import Outputs
from lassokin_ros.pipeline.parameter_files import NODE_NAME
from lassokin_ros.pipeline.session import Session
from lassokin_ros.replay.bags import register_types
from msg_adapters.backends import RosbagsBackend
from msg_adapters.definitions import DEFINITIONS
from msg_adapters.detectors.registry import full_type_name
from msg_adapters.output_messages.builders import DiagnosticArrayBuilder

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
        self.first_rejection = ""
        """'unknown_id: ...', the first rejection, also of a camera_info."""
        self.initialisations = self._reinitialised = 0
        self._seen: set[str] = set()
        self.newest_ns = 0
        """Recording time of the newest message, ns."""

    @property
    def times_lost(self) -> int:
        """The number of re-initialisations of tracked people, plus one if the recording ends in the lost state."""
        return self._reinitialised + (self.session.roster.status is Status.LOST)

    def camera_info(self, message: Any, time_ns: int, camera: str = "") -> None:
        """Process a CameraInfo, or Intrinsics. time_ns: recording time, ns. camera: its name."""
        self._tick(time_ns)
        if self.messages is not None:
            self.messages.diagnostics.count_camera_info(time_ns * 1e-9)
        if (reason := self.session.set_camera(message, camera)) is not None:
            self._note_rejection(reason, self.session.inputs.camera_fault or UNREADABLE_WORDS)

    def keypoints(self, message: Any, time_ns: int, camera: str = "") -> None:
        """Process a keypoint message, or Keypoints; see `camera_info`."""
        self._tick(time_ns)
        self._take(self.session.push, message, time_ns, camera)

    def depth_image(self, message: Any, time_ns: int, camera: str = "") -> None:
        """Process a depth image; see `camera_info`."""
        self._tick(time_ns)
        self._take(self.session.push_depth, message, time_ns, camera)

    def transforms(self, message: Any, time_ns: int, static: bool = False) -> None:
        """Process a message of /tf, or of /tf_static; see `camera_info`."""
        self._tick(time_ns)
        self.session.push_transforms(message, static=static)

    def begin_take(self) -> None:
        """Note that the next image is of another shot, see `Session.begin_take`."""
        self._take(self.session.begin_take)

    def finish(self) -> None:
        """Process what still waits at the end of the recording."""
        if self.messages is not None:
            self.messages.finish(self.newest_ns)
        self._take(self.session.finish)

    def _tick(self, time_ns: int) -> None:
        """Process images that have waited in vain, and write what is due at a time."""
        self.newest_ns = time_ns
        if self.messages is not None:
            self.messages.check(time_ns)
        if (due_ns := self.session.due_at_ns) is not None and due_ns <= time_ns:
            self._take(self.session.due, time_ns)
        if self.messages is not None:
            self.messages.publish_diagnostics(time_ns)

    def _take(self, answer: Callable[..., Sequence[Answer]], *given: Any) -> None:
        """Let the session answer, tell the listeners, and write the messages."""
        started = time.perf_counter()
        if not (answers := answer(*given)):
            return
        self.frame_seconds.append(time.perf_counter() - started)
        for one in answers:
            self._count(one)
            for listener in self.listeners:
                listener(one.frames, one.arrival_ns, self.frame_seconds[-1] if one is answers[-1] else float("nan"))
            if self.messages is not None:
                self.messages.publish(one, self.newest_ns)

    def _count(self, answer: Answer) -> None:
        accepted = answer.accepted
        self.messages_tracked += bool(accepted)
        for frame in answer.frames:
            if frame.rejection is not None:
                self._note_rejection(frame.rejection, frame.detail)
        for frame in accepted:
            assert frame.estimate is not None
            self.reprojection_px.append(frame.estimate.reprojection_px)
            self.initialisations += frame.estimate.initialised
            self._reinitialised += frame.estimate.initialised and frame.person in self._seen
            self._seen.add(frame.person)

    def _note_rejection(self, key: str, words: str) -> None:
        self.first_rejection = self.first_rejection or ": ".join(filter(None, (key, words)))


class NodeMessages:
    """The messages that the node publishes, written with the recording time, so that they are repeatable; a `Sink`."""

    def __init__(self, session: Session, types: Any, write: Write) -> None:
        """types: the typestore of rosbags."""
        packages = [full_type_name(session.config.people_type).partition("/")[0], *["hri_msgs"] * session.config.rep155]
        register_types(types, {name: DEFINITIONS[name] for name in DEFINITIONS if name.partition("/")[0] in packages})
        backend = RosbagsBackend(types)
        self._session, self._write = session, write
        self._outputs, self._status = Outputs(session, self, backend, NODE_NAME), DiagnosticArrayBuilder(backend)
        self.warnings = WarningLog()
        """The warnings of /diagnostics."""
        self._diagnostics: Diagnostics | None = None
        self._next_ns = self._time_ns = 0

    def open(self, topic: topics.OutputTopic, name: str, lasting: bool) -> tuple[str, str, bool] | None:
        """Return full name, type and whether it is latched, of a topic that is recorded; see `Sink`."""
        full = topics.full_name(name, NODE_NAME)
        return None if topic.name in NOT_RECORDED else (full, topic.message_type, topic.latched)

    def close(self, out: Any) -> None:
        """Nothing: a recording has no end of a topic."""

    def wanted(self, out: Any) -> bool:
        """All topics are recorded."""
        return True

    def write(self, out: tuple[str, str, bool], message: Any) -> None:
        """Write a message with the present recording time."""
        name, kind, latched = out
        self._write(name, kind, self._time_ns, message, latched)

    @property
    def diagnostics(self) -> Diagnostics:
        """The figures of /diagnostics, after the first message."""
        assert self._diagnostics is not None
        return self._diagnostics

    def check(self, time_ns: int) -> None:
        """Write the state if it has changed; at the first time, begin."""
        self._time_ns = time_ns
        if self._diagnostics is None:
            self._diagnostics = Diagnostics(self._session, NODE_NAME, time_ns * 1e-9)
            self._next_ns = time_ns + DIAGNOSTICS_PERIOD_NS
            self._outputs.start(time_ns)
        else:
            self._outputs.check(time_ns)

    def publish(self, answer: Answer, time_ns: int) -> None:
        """Write the messages of an answer."""
        self._time_ns = time_ns
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
        self._write(name, topics.DIAGNOSTICS.message_type, time_ns, message, False)

    def finish(self, time_ns: int) -> None:
        """Collect the warnings of the last period, if it is nearly over."""
        if self._diagnostics is not None and self._next_ns - time_ns < LAST_PERIOD_NS:
            self._diagnostics.line(time_ns * 1e-9)
            self.warnings.add(self._diagnostics.concerns)
