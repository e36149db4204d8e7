"""The messages of the session's answers: one list of topics, for the node and for the replay.

`Outputs` asks a `Sink` to open each topic; a message is filled only if the sink wants it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.output.hand_points import HandPoints
from lassokin_ros.pipeline.answers import Answer
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.body_frames import Naming
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages, id_list
from lassokin_ros.pipeline.outputs.robot_description import RobotDescription
from lassokin_ros.pipeline.outputs.scene_messages import (
    TRACKING,
    CameraMarkers,
    Image,
    PeopleMessages,
    PresenceState,
    joints_report,
)
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import OFF
from msg_adapters.backends import Backend
from msg_adapters.detectors.registry import full_type_name
from msg_adapters.output_messages.builders import StringBuilder
from msg_adapters.output_messages.clouds import SkeletonsCloudBuilder

REPEAT_S = 0.2
"""s: ~/people and ~/state are repeated after this time, so that their absence shows that the node has stopped."""
LINK_AS_FRAME = "frame_id is a link's name"
"""Key of the count of frames whose frame_id robot_description cannot use as its base."""


class Sink(Protocol):
    """Where messages go. `Out` is what it knows a topic by."""

    def open(self, topic: topics.OutputTopic, name: str, lasting: bool) -> Any | None:
        """Return the handle of a topic; None if this sink does not take it.

        name: before remapping. lasting: False for the topics of one of several people, which end when they leave.
        """
        ...

    def close(self, out: Any) -> None:
        """End a topic."""
        ...

    def wanted(self, out: Any) -> bool:
        """Return whether somebody reads a topic."""
        ...

    def write(self, out: Any, message: Any) -> None:
        """Publish or write a message, an object or serialised. The object is reused for the next frame."""
        ...


class PersonTopics:
    """The topics of one person, with the body's description before the first frame that needs it."""

    def __init__(
        self, sink: Sink, backend: Backend, session: Session, title: str, person: str, without: str = ""
    ) -> None:
        """title: name of the node. person: the id, empty on the topics of one person. without: a topic left out."""
        skeleton, config = session.tracker.skeleton, session.config
        self._sink = sink
        naming = Naming.of_person(config, title, person)
        self._description = RobotDescription(backend, skeleton, config.root_frame, naming)
        self.described: Callable[[str], None] | None = None
        """Called with each new URDF."""
        hands = HandPoints(skeleton, session.tracker.layout)
        listed = [*topics.person_outputs(config.detects_bodies, bool(hands.sides))]
        listed += [topics.TF] * (config.publish_tf != OFF)
        self.outs: dict[str, Any] = {}
        """The handles by the topic's name."""
        for topic in listed:
            name = topics.of_person(topic.name, person, config.rep155)
            if topic.name != without and (out := sink.open(topic, name, not person)) is not None:
                self.outs[topic.name] = out
        self._messages = FrameMessages(backend, skeleton, title, person, config, serialised=True, hands=hands)

    def publish(self, frame: FrameResult, copy_markers: Callable[[Any], None] | None = None) -> None:
        """Write the messages of an accepted frame. copy_markers: also called with its markers.

        Raises SkeletonError, after all messages, if the frame_id is the name of a link: the URDF keeps its base.
        """
        try:
            if (description := self._description.follow(frame)) is not None:
                self._describe(description)
        finally:
            wanted = {topic for topic, out in self.outs.items() if self._sink.wanted(out)}
            if copy_markers is not None:
                wanted.add(topics.MARKERS)
            for topic, message in self._messages.build(frame, wanted):
                if topic in self.outs:
                    self._sink.write(self.outs[topic], message)
                if copy_markers is not None and topic == topics.MARKERS:
                    copy_markers(message)

    def describe_first(self) -> None:
        """Write the description before any frame. Raises SkeletonError for an impossible base frame."""
        self._describe(self._description.first())

    def _describe(self, description: Any) -> None:
        if topics.ROBOT_DESCRIPTION in self.outs:
            self._sink.write(self.outs[topics.ROBOT_DESCRIPTION], description)
        if self.described is not None:
            self.described(description.data)

    def close(self) -> None:
        """End the topics."""
        for out in self.outs.values():
            self._sink.close(out)


class Outputs:
    """The topics of all people, the list of them, and those about the scene: ~/people, ~/skeletons, ~/state, cameras.

    With one person, that one's topics are opened at once. With several, each has topics from the first frame until they
    leave, and the locked one those of one person, too.
    """

    def __init__(self, session: Session, sink: Sink, backend: Backend, title: str) -> None:
        """title: name of the node.

        Raises ConfigurationError if the package of a required message type is not installed.
        """
        self._session, self._sink, self._backend = session, sink, backend
        config = session.config
        self.on_fault: Callable[[str], None] = lambda words: None
        """Called with a reason why a message could not be made."""
        self.on_state: Callable[[str], None] = lambda state: None
        """Called with each new state."""
        self._open_person = partial(PersonTopics, sink, backend, session, title)
        self._people: dict[str, PersonTopics] = {}
        self.person: PersonTopics | None = None
        """The topics of the only person; of several, those of the locked one, None before."""
        self._ids: list[str] | None = None
        scene, self._outs = [], dict[str, Any]()
        if not config.several_people:
            self.person = self._open_person("")
            if (markers := self.person.outs.get(topics.MARKERS)) is not None:
                self._outs[topics.MARKERS] = markers
        else:
            if not config.topic_per_body:  # else the detector publishes the list
                scene.append(topics.REP155_TRACKED_OUTPUT if config.rep155 else topics.TRACKED_OUTPUT)
            scene.append(topics.MARKERS)
        kind = full_type_name(config.people_type)
        for topic in (*scene, topics.people_output(kind), topics.STATE, topics.SKELETONS):
            if (out := sink.open(topic, topic.name, True)) is not None:
                self._outs[topic.name] = out
        self._newest = PeopleMessages(backend, kind, True, config.several_cameras)
        self._skeletons = SkeletonsCloudBuilder(backend, session.tracker.skeleton.joint_count, serialised=True)
        self._cameras, self._state = CameraMarkers(backend, session), PresenceState()
        self._as_of_ns = 0  # newest time of the clock of arrivals for which the state was derived
        self._written_at = {topics.PEOPLE: 0.0, topics.STATE: 0.0}  # s, see `repeat`

    @property
    def state(self) -> str:
        """The newest state on ~/state."""
        return self._state.value

    def start(self, now_ns: int) -> None:
        """Write the state and the list of people before the first answer. now_ns: ns of the clock of arrivals."""
        self._write_state()
        self.keep(self._session.roster.ids or [], now_ns)

    def publish(self, answer: Answer, now_ns: int, now: float = 0.0) -> None:
        """Write the messages of an answer. now_ns: ns of the clock of arrivals; now: s, see `repeat`."""
        session, accepted = self._session, answer.accepted
        self._publish_people(accepted)
        if not answer.frames or accepted:  # a rejected message does not change the list of people
            self.keep(session.roster.ids or [], now_ns)
        if not answer.refused:
            image = answer.stamp_ns, answer.frame_id
            self._newest.update(answer.frames, session.roster.ids, session.placement.jumps.newest)
            self._write_people(image, now)
            if self._wants(topics.SKELETONS):
                skeletons = [joints_report(frame) for frame in answer.frames if frame.accepted]
                self._sink.write(self._outs[topics.SKELETONS], self._skeletons.fill(*image, skeletons))
        if self._state.value != TRACKING or not accepted:
            self.check(now_ns)

    def _publish_people(self, frames: Sequence[FrameResult]) -> None:
        several, copy_markers = self._session.config.several_people, None
        if several and self._wants(topics.MARKERS):
            copy_markers = partial(self._sink.write, self._outs[topics.MARKERS])
        for frame in frames:
            if several and frame.person not in self._people:
                self._people[frame.person] = self._open_person(frame.person)
            try:
                if several:
                    self._people[frame.person].publish(frame, copy_markers)
                if not several or frame.person == self._session.roster.locked:
                    self.person = self.person or self._open_person("", without=topics.MARKERS)
                    self.person.publish(frame)
            except SkeletonError as error:
                self._session.counts[LINK_AS_FRAME] += 1
                self.on_fault(str(error))

    def _wants(self, topic: str) -> bool:
        return topic in self._outs and self._sink.wanted(self._outs[topic])

    def keep(self, ids: Sequence[str], now_ns: int) -> None:
        """End the topics of people who have left, and write the list of ids if it has changed."""
        for person in [person for person in self._people if person not in ids]:
            self._people.pop(person).close()
        rep155 = self._session.config.rep155
        out = self._outs.get((topics.REP155_TRACKED_OUTPUT if rep155 else topics.TRACKED_OUTPUT).name)
        if out is not None and list(ids) != self._ids:
            self._sink.write(out, id_list(self._backend, rep155)(now_ns, "", list(ids)))
        self._ids = list(ids)

    def check(self, now_ns: int) -> None:
        """Write the state if it has changed.

        now_ns: ns of the clock of arrivals, a time up to which all messages were processed. A time before that of the
        last call is replaced by it, so that the state does not return to an earlier one.
        """
        self._as_of_ns = max(now_ns, self._as_of_ns)
        if self._update_state():
            self.on_state(self._state.value)

    def _update_state(self) -> bool:
        """Derive the state, and write it if it has changed. Return True in this case."""
        session, now_ns = self._session, self._as_of_ns
        limits = session.scene.lost_after, session.config.forget_after
        presence, informed = session.scene.presence_at(now_ns), session.scene_known_empty(now_ns)
        if changed := self._state.update(presence, now_ns, *limits, informed):
            self._write_state()
        return changed

    def repeat(self, now_ns: int, now: float) -> None:
        """Write ~/people and ~/state again if the last ones are older than REPEAT_S, and the places of the cameras.

        now_ns: as for `check`; without a clock (0) there is no stamp for ~/people and ~/markers. now: s, steady clock.
        """
        due = {topic for topic, at in self._written_at.items() if now - at >= REPEAT_S}
        if now_ns > 0:
            image = self._session.scene.image_at(now_ns)
            if topics.PEOPLE in due:
                self._write_people(image, now)
            self.write_cameras(image[0], now)
        if topics.STATE in due and self._wants(topics.STATE):
            self._write_state(now)

    def forget(self, now_ns: int) -> None:
        """Forget all people: the session was reset, and the clock may have jumped. This is no news, see `on_state`."""
        self.keep(self._session.roster.ids or [], now_ns)
        self._newest.forget()
        self.restart_clock()
        self._update_state()

    def restart_clock(self) -> None:
        """Use the time of the next call of `check`, although it is earlier: the clock was set back."""
        self._as_of_ns = 0

    def _write_people(self, image: Image, now: float) -> None:
        if self._wants(topics.PEOPLE):
            session, scene = self._session, self._session.scene
            limits, others = (scene.lost_after, session.config.forget_after), scene.untracked_at(image[0])
            message = self._newest.build(image, *limits, others, session.roster.locked, scene.absent_at(image[0]))
            self._sink.write(self._outs[topics.PEOPLE], message)
            self._written_at[topics.PEOPLE] = now

    def write_cameras(self, stamp_ns: int, now: float) -> None:
        """Write the places of the cameras to ~/markers, at most at 5 Hz. now: s of any clock."""
        if self._wants(topics.MARKERS) and (message := self._cameras.build(stamp_ns, now)) is not None:
            self._sink.write(self._outs[topics.MARKERS], message)

    def _write_state(self, now: float = 0.0) -> None:
        self._written_at[topics.STATE] = now
        if topics.STATE in self._outs:  # latched: also for those who come later
            self._sink.write(self._outs[topics.STATE], StringBuilder(self._backend).fill(self._state.value))
