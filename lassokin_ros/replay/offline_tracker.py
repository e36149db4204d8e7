"""Replace the node in a replay: take the messages of a recording, return the messages that the node publishes."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.observation import CameraPose, Status
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.camera_markers import CameraMarkers
from lassokin_ros.pipeline.outputs.description.robot_description import RobotDescription
from lassokin_ros.pipeline.outputs.description.skeleton_file import save_all
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages, id_list
from lassokin_ros.pipeline.outputs.naming import Naming
from lassokin_ros.pipeline.outputs.people_messages import PeopleMessages, images_of
from lassokin_ros.pipeline.outputs.skeletons_message import SkeletonsMessage
from lassokin_ros.pipeline.outputs.status.diagnostics import Diagnostics
from lassokin_ros.pipeline.outputs.status.presence_state import TRACKING, PresenceState
from lassokin_ros.pipeline.outputs.status.warning_log import WarningLog
from lassokin_ros.pipeline.parameter_files import NODE_NAME
from lassokin_ros.pipeline.pipeline import Pipeline
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.analysis.frames_in_order import FramesInOrder, Timed, by_stamp
from msg_adapters.backends import Backend, RosbagsBackend
from msg_adapters.detectors.definitions import DEFINITIONS as OF_DETECTORS
from msg_adapters.detectors.registry import full_type_name
from msg_adapters.keypoints import stamp_of
from msg_adapters.output_messages.builders import DiagnosticArrayBuilder, StringBuilder
from msg_adapters.output_messages.people import DEFINITIONS

DIAGNOSTICS_PERIOD_NS = 1_000_000_000
LAST_PERIOD_NS = 700_000_000
"""ns: if less than this is missing to the last period of the diagnostics, its warnings are collected, too."""
RECORDED = {topic.name for topic in (*topics.FRAME_OUTPUTS, topics.ROI_OUTPUT, topics.TF_OUTPUT)}
"""Topics of an accepted frame that are written."""
DEPTH_WAIT_NS = 100_000_000
"""ns of recording time for which a keypoint message waits for its depth image; `wait` if that is longer."""
UNREADABLE = "not_deserialised"
LINK_AS_FRAME = "frame_id is a link's name"
"""Key of the count of frames whose frame_id robot_description cannot use as its base."""


class OfflineTracker:
    """Track the messages of one recording. The clock is the recording time, so the outputs are repeatable."""

    def __init__(
        self,
        tracker_config: TrackerConfig,
        node_config: NodeSettings,
        types: Any,
        serialised: bool = False,
        only_track: bool = False,
        poses: Mapping[str, CameraPose] | None = None,
        bodies: Mapping[int, Skeleton] | None = None,
    ) -> None:
        """types: the typestore of rosbags. serialised: yield serialised messages where that is faster.

        only_track: make no messages of people's poses. poses, bodies: see `Pipeline`.
        Raises a LassokinError if the configuration cannot be used.
        """
        self._serialised, self._only_track = serialised, only_track
        self.pipeline = Pipeline(tracker_config, node_config, poses=poses, bodies=bodies)
        self.frame_seconds: list[float] = []
        """Time for decoding and tracking each message, s."""
        self.messages_tracked = 0
        """Keypoint messages with a skeleton; with several cameras, instants with one."""
        self.reprojection_px: list[float] = []
        """Reprojection error of each accepted frame, px."""
        self.listeners: list[Callable[[Sequence[FrameResult], int, float], None]] = []
        """Functions called for every keypoint message with its frames, recording time in ns and tracking time in s.

        The frames come in the order of their stamps. With `smoothing_lag` they come later than their messages, with the
        recording times of these."""
        self.first_rejection: tuple[str, str] | None = None
        """Key and sentence of the reason of the first rejection, also of a camera_info."""
        self.warnings = WarningLog()
        """The warnings of /diagnostics."""
        self.initialisations = 0
        self._reinitialised = 0
        self._backend = RosbagsBackend(types)
        self._status = DiagnosticArrayBuilder(self._backend)
        self._people: dict[str, PersonMessages] = {}
        self._ids: list[str] | None = None
        self._tracked = topics.TRACKED_OUTPUT
        if node_config.rep155:
            self._tracked = topics.REP155_TRACKED_OUTPUT
            for output in (self._tracked, topics.ROI_OUTPUT):
                add_type(types, output.message_type, OF_DETECTORS[output.message_type])
        self._list = id_list(self._backend, node_config.rep155)
        # As in the node: the locked one of several people, on the topics of one person. ~/markers is everybody's.
        self._locked = PersonMessages(self._backend, self.pipeline, "", serialised, RECORDED - {topics.MARKERS})
        self._scene = SceneMessages(self._backend, self.pipeline, types, serialised)
        self._diagnostics: Diagnostics | None = None
        self._next_diagnostics_ns = 0
        self._held: deque[tuple[Any, int, str]] = deque()
        self._in_order = FramesInOrder(tracker_config.smoothing_lag, node_config.several_cameras)
        self.newest_ns = 0
        """Recording time of the newest message, ns."""

    @property
    def times_lost(self) -> int:
        """The number of re-initialisations of tracked people, plus one if the recording ends in the lost state."""
        return self._reinitialised + (self.pipeline.status is Status.LOST)

    def save_skeleton(self, path: Path, files: AtomicFiles) -> list[Path]:
        """Write the calibrated skeletons as part of `files`, see `skeleton_file.save_all`."""
        return save_all(self.pipeline.calibrations(), path, self.newest_ns, files)

    def camera_info(self, message: Any, time_ns: int, camera: str = "") -> Iterator[tuple[str, str, Any]]:
        """Process a CameraInfo, None for one that could not be deserialised; see `keypoints`."""
        yield from self._tick(time_ns)
        assert self._diagnostics is not None
        self._diagnostics.count_camera_info(time_ns * 1e-9)
        if message is None:
            self.pipeline.counts[f"rejected: {UNREADABLE}"] += 1
        elif (reason := self.pipeline.set_camera(message, camera)) is not None and self.first_rejection is None:
            self.first_rejection = reason, self.pipeline.camera_fault

    def keypoints(self, message: Any, time_ns: int, camera: str = "") -> Iterator[tuple[str, str, Any]]:
        """Process a keypoint message, None for one that could not be deserialised. camera: its name.

        Yields (topic, type, message) for everything that the node publishes, in the node's order. The message objects
        are reused for the next frame: serialise them at once.
        """
        yield from self._tick(time_ns)
        self._held.append((message, time_ns, camera))
        yield from self._track_held(time_ns)

    def depth_image(self, message: Any, time_ns: int, camera: str = "") -> Iterator[tuple[str, str, Any]]:
        """Process a depth image, None for one that could not be deserialised; see `keypoints`."""
        yield from self._tick(time_ns)
        if message is not None and (depth := self.pipeline.cameras[camera].depth) is not None:
            depth.add(message, time_ns)
        yield from self._track_held(time_ns)

    def transforms(self, message: Any, time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """Process a message of /tf, None for one that could not be deserialised; see `keypoints`."""
        yield from self._tick(time_ns)
        if message is not None and self.pipeline.transforms is not None:
            self.pipeline.transforms.add(message, static=False)

    def static_transforms(self, message: Any, time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """Process a message of /tf_static, as `transforms`."""
        yield from self._tick(time_ns)
        if message is not None and self.pipeline.transforms is not None:
            self.pipeline.transforms.add(message, static=True)

    def _track_held(self, now_ns: int) -> Iterator[tuple[str, str, Any]]:
        """Track the keypoint messages whose depth image was received or is not expected any more."""
        wait_ns = max(DEPTH_WAIT_NS, round(1e9 * self.pipeline.config.depth_wait))
        while self._held:
            message, time_ns, camera = self._held[0]
            depth, late = self.pipeline.cameras[camera].depth, now_ns - time_ns >= wait_ns
            if depth is not None and message is not None and not late and depth.may_receive(stamp_of(message)):
                return
            self._held.popleft()
            yield from self._track(message, time_ns, camera)

    def _track(self, message: Any, time_ns: int, camera: str) -> Iterator[tuple[str, str, Any]]:
        if message is None:
            self.pipeline.counts["received"] += 1
            self.pipeline.counts[f"rejected: {UNREADABLE}"] += 1
            unreadable = FrameResult(time_ns, "", None, UNREADABLE, "the message could not be deserialised")
            self._notify([unreadable], time_ns, float("nan"))
            return
        yield from self._answer(partial(self.pipeline.frames, message, time_ns, camera), time_ns)

    def _answer(self, track: Callable[[], list[FrameResult]], time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """Yield the outputs of what `track` returns."""
        started = time.perf_counter()
        frames = track()
        if self.pipeline.silent:
            return
        self.frame_seconds.append(time.perf_counter() - started)
        self._notify(frames, time_ns, self.frame_seconds[-1])
        assert self._diagnostics is not None
        self._diagnostics.count_message(frames, time_ns, time_ns * 1e-9, float("nan"))  # the duration is not repeatable
        for frame in frames:
            yield from self._outputs(frame)
        yield from self._list_of_people(time_ns)
        yield from self._scene.outputs(frames, time_ns)

    def finish(self) -> Iterator[tuple[str, str, Any]]:
        """Flush the frames that `smoothing_lag` still holds at the end of the recording; see `keypoints`."""
        while self._held:
            yield from self._track(*self._held.popleft())
        if self._diagnostics is not None and self._next_diagnostics_ns - self.newest_ns < LAST_PERIOD_NS:
            self._diagnostics.line(self.newest_ns * 1e-9)
            self.warnings.add(self._diagnostics.concerns)
        frames = self.pipeline.flush()
        if frames:
            self._notify(frames, self.newest_ns, float("nan"))
        self._tell(self._in_order.flush(), float("nan"))
        for frame in frames:
            yield from self._outputs(frame)
        if frames:
            yield from self._scene.outputs(frames, self.newest_ns)

    def _notify(self, frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        if self.first_rejection is None:
            self.first_rejection = next(((f.rejection, f.detail) for f in frames if f.rejection is not None), None)
        if self.pipeline.tracker.config.smoothing_lag > 0:
            messages = self._in_order.add(frames, self.pipeline.image, time_ns)
        else:
            messages = [(message, time_ns) for message in by_stamp(frames) or [[]]]  # nobody was in the image
        self._tell(messages, seconds)

    def _tell(self, messages: Sequence[Timed], seconds: float) -> None:
        """Call the listeners for messages in their order. seconds: tracking time of the last one."""
        for number, (message, time_ns) in enumerate(messages, 1):
            self.messages_tracked += any(frame.accepted for frame in message)
            for listener in self.listeners:
                listener(message, time_ns, seconds if number == len(messages) else float("nan"))

    def _outputs(self, frame: FrameResult) -> Iterator[tuple[str, str, Any]]:
        if not frame.accepted or frame.estimate is None:
            return
        self.reprojection_px.append(frame.estimate.reprojection_px)
        self.initialisations += frame.estimate.initialised
        self._reinitialised += frame.estimate.initialised and frame.person in self._people
        if frame.person not in self._people:
            self._people[frame.person] = PersonMessages(self._backend, self.pipeline, frame.person, self._serialised)
        if not self._only_track:
            yield from self._people[frame.person].build(frame)
            if frame.person == self.pipeline.locked:
                yield from self._locked.build(frame)

    def _list_of_people(self, time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """Yield the list of ids if it has changed."""
        people = self.pipeline.people
        if people.ids is None or people.ids == self._ids:
            return
        self._ids = people.ids
        self._people = {person: messages for person, messages in self._people.items() if person in self._ids}
        message = self._list(time_ns, "", self._ids)
        yield topics.full_name(self._tracked.name, NODE_NAME), self._tracked.message_type, message

    def _tick(self, time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """Yield the diagnostics that are due, and the outputs of images that have waited for other cameras in vain."""
        self.newest_ns = time_ns
        if self._diagnostics is None:
            self._diagnostics = Diagnostics(self.pipeline, NODE_NAME, time_ns * 1e-9)
            self._next_diagnostics_ns = time_ns + DIAGNOSTICS_PERIOD_NS
            yield self._scene.state()
        else:
            yield from self._scene.check(time_ns)
        if (due_ns := self.pipeline.due_at_ns) is not None and due_ns <= time_ns:
            yield from self._answer(partial(self.pipeline.due, time_ns), time_ns)
        if time_ns >= self._next_diagnostics_ns:
            self._next_diagnostics_ns = time_ns + DIAGNOSTICS_PERIOD_NS
            line = self._diagnostics.line(time_ns * 1e-9)
            self.warnings.add(self._diagnostics.concerns)
            message = self._status.fill(time_ns, "", [line])
            name = topics.full_name(topics.DIAGNOSTICS, NODE_NAME)
            yield name, topics.DIAGNOSTICS_OUTPUT.message_type, message


class PersonMessages:
    """One person's messages, the body's description before those of the first frame that needs it."""

    def __init__(
        self, backend: Backend, pipeline: Pipeline, person: str, serialised: bool, wanted: Container[str] = RECORDED
    ) -> None:
        """person: the id, empty on the topics of one person. serialised: see FrameMessages. wanted: its topics."""
        skeleton, config = pipeline.tracker.skeleton, pipeline.config
        self._messages = FrameMessages(backend, skeleton, NODE_NAME, person, config, serialised)
        naming = Naming.of_person(config, NODE_NAME, person)
        self._description = RobotDescription(backend, skeleton, config.root_frame, naming)
        self._counts, self._wanted = pipeline.counts, wanted
        #: Full name and type of each topic.
        self._places: dict[str, tuple[str, str]] = {}
        for topic in (*topics.person_outputs(regions=True), topics.TF_OUTPUT):
            name = topics.full_name(topics.of_person(topic.name, person, config.rep155), NODE_NAME)
            self._places[topic.name] = name, topic.message_type

    def build(self, frame: FrameResult) -> Iterator[tuple[str, str, Any]]:
        """Yield (topic, type, message). The message objects are reused for the next frame."""
        try:
            description = self._description.follow(frame)
        except SkeletonError:  # frame_id is the name of a link: as in the node, the URDF keeps its base
            description = None
            self._counts[LINK_AS_FRAME] += 1
        if description is not None:
            yield *self._places[topics.ROBOT_DESCRIPTION], description
        for topic, message in self._messages.build(frame, self._wanted):
            yield *self._places[topic], message


class SceneMessages:
    """The people of each image, the state of tracking when it changes, and the places of the cameras; in the node this
    is SceneOutputs.
    """

    def __init__(self, backend: Backend, pipeline: Pipeline, types: Any, serialised: bool) -> None:
        """types: the typestore of rosbags. serialised: see PeopleMessages."""
        self._pipeline, self._type = pipeline, full_type_name(pipeline.config.people_type)
        for name, definition in DEFINITIONS.items():
            if name.split("/")[0] == self._type.split("/")[0]:
                add_type(types, name, definition)
        self._people = PeopleMessages(backend, self._type, serialised, pipeline.config.several_cameras)
        self._name = topics.full_name(topics.PEOPLE, NODE_NAME)
        self._skeletons = SkeletonsMessage(backend, pipeline.tracker.skeleton.joint_count, serialised)
        self._skeletons_name = topics.full_name(topics.SKELETONS, NODE_NAME)
        self._cameras = CameraMarkers(backend, pipeline)
        self._state, self._text = PresenceState(), StringBuilder(backend)

    def state(self) -> tuple[str, str, Any]:
        """Return topic, type and message of the present state."""
        name = topics.full_name(topics.STATE, NODE_NAME)
        return name, topics.STATE_OUTPUT.message_type, self._text.fill(self._state.value)

    def outputs(self, frames: Sequence[FrameResult], time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """Yield the people in one keypoint message, and the state if it has changed."""
        pipeline = self._pipeline
        config = pipeline.tracker.config
        for image, people in images_of(frames, pipeline.image, config.smoothing_lag > 0):
            self._people.update(people, pipeline.ids, pipeline.jumps.newest)
            limits = pipeline.reported_lost_after, pipeline.config.forget_after
            message = self._people.build(image, *limits, pipeline.untracked_at(image[0]), pipeline.locked)
            yield self._name, self._type, message
            skeletons = self._skeletons.build(image, people)
            yield self._skeletons_name, topics.SKELETONS_OUTPUT.message_type, skeletons
        if pipeline.image is not None and (message := self._cameras.build(pipeline.image[0], 1e-9 * time_ns)):
            yield topics.full_name(topics.MARKERS, NODE_NAME), topics.MARKERS_TYPE, message
        tracked = config.smoothing_lag == 0 and any(frame.accepted for frame in frames)
        if self._state.value != TRACKING or not tracked:
            yield from self.check(time_ns)

    def check(self, time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """Yield the state if it has changed. time_ns: recording time of the present message."""
        pipeline = self._pipeline
        limits = pipeline.reported_lost_after, pipeline.config.forget_after
        informed = pipeline.is_informed_at(time_ns)
        if self._state.update(pipeline.presence_at(time_ns), time_ns, *limits, informed):
            yield self.state()


def add_type(types: Any, message_type: str, definition: str) -> None:
    """Register a message type that Jazzy lacks. types: the typestore of rosbags."""
    from rosbags.typesys import get_types_from_msg

    if message_type not in types.types:
        types.register(get_types_from_msg(definition, message_type))
