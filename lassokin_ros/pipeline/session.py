"""The engine: messages or arrays in, answers out. Node, replay, `track` and notebooks drive the same one.

session = Session(TrackerConfig(), NodeSettings())
session.set_camera(camera_info)                     # a message, or Intrinsics
answers = session.push(keypoints, arrival_ns)       # a message, or Keypoints; one Answer per instant
answers += session.due(now_ns)                      # what has waited long enough, see `due_at_ns`
answers += session.finish()                         # what still waits at the end
result = session.process(keypoints, arrival_ns)     # FrameResult of one person: accepted, or rejected with a reason
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.core.output.smoothing import Backward
from lassokin_ros.pipeline.answers import Answer, Answers, frames_of
from lassokin_ros.pipeline.camera.camera_places import GivenPoses
from lassokin_ros.pipeline.camera.placement import Placement
from lassokin_ros.pipeline.camera_images import UNREADABLE, UNREADABLE_WORDS, CameraImages
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.image_sets import LONGEST_LATE_NS
from lassokin_ros.pipeline.inputs import Inputs
from lassokin_ros.pipeline.people.choice import NoPersonError
from lassokin_ros.pipeline.people.people_tracker import PeopleTracker
from lassokin_ros.pipeline.people.roster import Roster, people_to_track
from lassokin_ros.pipeline.scene import Scene
from lassokin_ros.pipeline.seen import Image, identified
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.errors import AdapterError


class Session:
    """Decodes messages, removes the distortion, tracks people. No message content raises an error."""

    def __init__(
        self,
        tracker_config: TrackerConfig,
        node_config: NodeSettings,
        evidence: Sequence[Evidence] = (),
        poses: GivenPoses | None = None,
        bodies: Mapping[int | None, Skeleton] | None = None,
        patience: float = 0.0,
    ) -> None:
        """evidence: the user's own, for each frame's lasso; all people share it. poses: see CameraPlaces, in
        place of those from TF. bodies: skeletons, with their heights, of people whose numbers in the messages are
        known; of the only person by None. patience: s, lower limit of the wait for depth images; messages in a
        recording have no exact order.
        Raises a LassokinError if the configuration is unusable.
        """
        self.config = node_config.checked()
        self.config.check_with(tracker_config)
        self.enabled = True
        """If False, keypoints are counted and not processed."""
        self.counts: Counter[str] = Counter()
        """Number of messages by result: received, accepted, duplicated, unstamped, resets, "rejected: <reason>", and
        messages with keypoints outside the image."""
        trackable = people_to_track(tracker_config, self.config, evidence, bodies or {})
        self.roster = Roster(trackable, self.counts, self.config)
        """Who is tracked, who is locked, and what was learned of them."""
        self.tracker = self.roster.tracker
        self.identities: Mapping[tuple[str, bytes], int] | None = None
        """The numbers of the people in images that were seen before, by camera and `key_of`: nobody else is there."""
        self.answers = Answers(self.counts, self.config.several_cameras)
        """The answers that wait for `smoothing_lag`."""
        self.people = PeopleTracker(self.roster)
        """Who is who in the images."""
        names = self.config.camera_names
        self.cameras = {name: CameraImages(name, self.tracker, self.config, self.counts) for name in names}
        """The inputs of each camera by name; the name of the only camera is empty. With a topic per body they are those
        of the last body."""
        self.first = self.cameras[names[0]]
        """The inputs of the only camera, or of the first one."""
        self.placement = Placement(self.config, trackable, self.counts, poses)
        """Where the cameras are, and which of them are used."""
        places = self.placement.places
        self.inputs = Inputs(self.cameras, self.config, patience, None if places is None else places.may_reach)
        """What waits for depth images, TF and other cameras."""
        self._ready: list[Answer] = []
        self.scene = Scene(self.roster, self.inputs, self.placement)
        """What the newest messages tell, and who is present."""

    def use_backward(self, frames: Mapping[int | None, Mapping[int, Backward]]) -> None:
        """See `TrackedPerson.use_backward`. frames: by the person's number in the messages, None without a number."""
        for tracked in self.roster.bodies:
            tracked.use_backward(frames.get(tracked.number, {}))

    def lock(self, now_ns: int) -> str:
        """Lock the person whom `follow` names in the newest image, and return the id. now_ns: of the arrival clock.

        Raises NoPersonError if there is none, also if the image is older than `stale_after`.
        """
        limit, age_s = self.config.stale_after, self.scene.age_s(now_ns)
        if self.config.topic_per_body:
            raise NoPersonError("lock failed: each person has a topic of keypoints, and the detector says who is who")
        if not self.enabled:
            raise NoPersonError("lock failed: the node is disabled; call ~/set_enabled with true, then lock")
        if age_s is None:
            raise NoPersonError("lock failed: no usable keypoints arrived since the start or the last reset")
        if age_s > limit:
            raise NoPersonError(
                f"lock failed: the newest keypoints arrived {age_s:.1f} s ago; expected at most stale_after "
                f"{limit:g} s: start the detector, then lock"
            )
        return self.people.lock()

    def keep(self, bodies: Sequence[str]) -> None:
        """Set the ids of the people present by the detector's list, with a topic per body. The others are forgotten.

        Of too many people the first ones are kept.
        """
        self.roster.keep(bodies)
        kept = [person.id for person in self.roster.people]
        self.inputs.keep(kept)
        self.scene.keep(kept)

    def scene_known_empty(self, now_ns: int) -> bool:
        """See `Scene.known_empty`. Of a disabled session nothing is known."""
        return self.enabled and self.scene.known_empty(now_ns)

    def set_clock_back(self, step_ns: int) -> None:
        """Keep the ages of all messages: the clock of arrivals was set back by `step_ns` ns since the last call."""
        self.scene.set_clock_back(step_ns)
        self.inputs.set_clock_back(step_ns)

    def reset(self, unlock: bool = True) -> None:
        """Forget all people, the stamps, the depth images and what waits. The camera and the counts stay.

        unlock: see PeopleTracker.reset.
        """
        self.inputs.reset()
        if self.placement.places is not None:
            self.placement.places.faults.clear()
        self._forget_people(unlock)

    def begin_take(self) -> list[Answer]:
        """Note that the next image is of another shot; return the answers of everything that waits.

        What was learned of the only person stays; several people are forgotten.
        """
        answers = self.finish()
        self._forget_people(unlock=True, same_person=True)
        return answers

    def _forget_people(self, unlock: bool, same_person: bool = False, but: CameraImages | None = None) -> None:
        """Forget all people, see PeopleTracker.reset, and the stamps of other people's messages but those of `but`."""
        self.people.reset(unlock, same_person)
        self.inputs.reset_sets()
        self.answers.reset()
        self.placement.reset()
        self.scene.reset()
        self.counts["resets"] += 1
        for stream in () if same_person else self.inputs.streams.values():
            if stream is not but:
                stream.reset()

    def tune(self, tracker_config: TrackerConfig, node_config: NodeSettings) -> None:
        """Apply settings that can change while running, from the next message on. Another height resets.

        Raises ConfigurationError, before anything is changed, for a setting out of its range.
        """
        config, resized = node_config.checked(), tracker_config.height != self.tracker.config.height
        config.check_with(tracker_config)
        for tracked in self.roster.bodies:
            tracked.tracker.tune(tracker_config)
        self.config = config
        for depth in [camera.depth for camera in self.cameras.values()]:
            if depth is not None and tracker_config.smoothing_lag > 0:
                depth.check.reset()  # it is not updated, see `_track`
        self.roster.tune(config)
        self.placement.use_floor(config.floor)
        self.inputs.tune(config)
        if resized:
            self.reset(unlock=False)

    def set_camera(self, message: Any, camera: str = "") -> str | None:
        """Apply a CameraInfo message. Return the key of the reason if it is refused; the last good camera then stays.

        camera: name of the camera, empty for the only one. A new resolution or lens of the same camera keeps the state.
        The frame of another camera resets it.
        """
        try:
            if message is None:
                raise AdapterError(UNREADABLE, UNREADABLE_WORDS)
            if self.cameras[camera or self.first.name].camera.update(message):
                self._ready += self.answers.flush(self.roster.flush())
                self.reset(unlock=False)
        except AdapterError as error:
            self.counts[f"rejected: {error.reason}"] += 1
            return error.reason
        return None

    def push(self, message: Any, arrival_ns: int, camera: str = "", body: str = "", waits: bool = True) -> list[Answer]:
        """Take a keypoint message, or `Keypoints`, and return the answers that are due, in the order of their stamps.

        message: None for one that could not be deserialised. arrival_ns: ns, the stamp of a message that has none.
        camera: its name, empty for the only one. body: id of the person, with a topic per body; who is not present is
        ignored. A message may wait for its depth image, for those of other cameras and for `smoothing_lag`: call `due`
        at `due_at_ns`. waits: False if it waits for no depth image and no TF.
        """
        name = body or camera or self.first.name
        if name not in self.inputs.streams:
            return []
        return self._process(name, self.inputs.receive(name, message, arrival_ns, arrival_ns if waits else None))

    def push_depth(self, message: Any, arrival_ns: int, camera: str = "") -> list[Answer]:
        """Take a depth image, None for one that could not be deserialised; see `push` and `DepthImages.fault`."""
        name = camera or self.first.name
        if message is not None and (depth := self.cameras[name].depth) is not None:
            depth.add(message, arrival_ns)
        return self._released([stream for stream, one in self.inputs.streams.items() if one.name == name], arrival_ns)

    def push_transforms(self, message: Any, static: bool = False) -> None:
        """Take a message of /tf, or of /tf_static; None for one that could not be deserialised."""
        if message is not None and (transforms := self.placement.transforms) is not None:
            transforms.add(message, static=static)

    def due(self, now_ns: int) -> list[Answer]:
        """Return the answers of images whose wait has ended. now_ns: ns of the arrival clock."""
        answers = self._released(self.inputs.streams, now_ns)
        for images in self.inputs.due_sets(now_ns) if self.enabled else ():
            answers += self._track(images, now_ns)
        return answers

    @property
    def due_at_ns(self) -> int | None:
        """Time in ns of the arrival clock at which `due` must be called; None if no image waits."""
        return self.inputs.due_at_ns

    def finish(self) -> list[Answer]:
        """Return the answers of everything that waits. No message follows."""
        answers = self._released(self.inputs.streams, None)
        for images in self.inputs.due_sets(None):
            answers += self._track(images, images[0].stamp_ns)
        return answers + self.answers.flush(self.roster.flush())

    def process(self, message: Any, arrival_ns: int) -> FrameResult:
        """Track the one person in a keypoint message, without `smoothing_lag`; see `frames`.

        arrival_ns: ns, the stamp of a message that has none.
        """
        (frame,) = self.frames(message, arrival_ns)
        return frame

    def frames(self, message: Any, arrival_ns: int, camera: str = "", body: str = "") -> list[FrameResult]:
        """Return the results of all answers of `push`, without a wait for depth images."""
        return frames_of(self.push(message, arrival_ns, camera, body, waits=False))

    def _released(self, streams: Iterable[str], now_ns: int | None) -> list[Answer]:
        """Return the answers of messages of streams that wait no longer. now_ns: None if nothing follows."""
        return [answer for one in streams for answer in self._process(one, self.inputs.ready(one, now_ns))]

    def _process(self, stream: str, messages: Iterable[tuple[Any, int]]) -> list[Answer]:
        """Return the answers of messages of a stream, with their arrivals, and those of earlier ones that are due."""
        answers, self._ready, camera = self._ready, [], self.inputs.streams[stream]
        for message, arrival_ns in messages:
            self.counts["received"] += 1
            if camera.name:
                self.counts[camera.key("received")] += 1
            if self.enabled:
                answers += self._answers(message, arrival_ns, camera)
            else:
                self.counts["ignored while disabled"] += 1
        return answers

    def _answers(self, message: Any, arrival_ns: int, camera: CameraImages) -> list[Answer]:
        """Return the answers of a message and those of earlier ones that are due."""
        if camera.body:
            self.cameras[camera.name] = self.first = camera
        try:
            image, changed = camera.image(message, arrival_ns)
        except AdapterError as error:
            self.scene.refuse([camera.body or camera.name])
            detail = f"camera '{camera.name}': {error}" if camera.name else str(error)
            return self._refusal(*camera.last, arrival_ns, error.reason, detail)
        if self.identities is not None:
            image = identified(image, self.identities)
        answers: list[Answer] = []
        if changed:
            answers = self.answers.flush(self.roster.flush())
            if camera.body:
                for person in self.roster.people:
                    if person.id == camera.body:
                        person.body.reset()
                self.counts["resets"] += 1
            else:
                self._forget_people(unlock=False, but=camera)
        for images in self.inputs.sets_with(image, arrival_ns):
            answers += self._track(images, arrival_ns)
        return answers

    def _refusal(self, stamp_ns: int, frame_id: str, arrival_ns: int, reason: str, detail: str) -> list[Answer]:
        frame = FrameResult(stamp_ns, frame_id, None, reason, detail)
        answer = Answer(stamp_ns, frame_id, arrival_ns, [frame], refused=True)
        return self.answers.add(answer, self.tracker.config.smoothing_lag)

    def _track(self, images: Sequence[Image], arrival_ns: int) -> list[Answer]:
        """Return the answers that the images of one instant make due."""
        stamp_ns = max(image.stamp_ns for image in images)
        try:
            placed, frame_id = self.placement.placed(images)
            placed = self.placement.agreeing(placed)
            if not placed:
                return []
            frames = self.people.update(placed, frame_id)
        except AdapterError as error:
            self.scene.refuse(image.source for image in images)
            return self._refusal(stamp_ns, images[0].frame_id, arrival_ns, error.reason, str(error))
        self.scene.use(images, placed, arrival_ns, frames)
        if self.placement.tf_offset is not None:
            self.placement.tf_offset.update(frames)
        several, tracked = self.config.several_cameras, self.roster.tracked_at(stamp_ns)
        lately = several and self.roster.tracked_lately(stamp_ns)
        if several:
            frames = self.answers.without_absences(frames, lately)
            self.placement.agreement.note(frames)
        if self.tracker.config.smoothing_lag == 0:
            for image in images:
                if (depth := self.cameras[image.camera.name].depth) is not None:
                    depth.check.update(image.people, frames, image.camera.name)
        apart = several or images[0].body  # the stamps of cameras, and of bodies, need no common order
        newest = self.scene.arrive(stamp_ns, arrival_ns, frame_id, tracked, LONGEST_LATE_NS if apart else 0)
        if not several and all(frame.accepted for frame in frames):
            stamps = self.inputs.streams[images[0].source].stamps
            stamps.seen(stamp_ns, tracked)
            stamps.follow(stamp_ns, arrival_ns, images[0].stamped)
        of = (stamp_ns, frame_id) if frames else newest  # an image that is late tells nothing of now
        stamps_ns = [image.stamp_ns for image in images]
        answer = Answer(*of, arrival_ns, frames, stamps_ns, matters=not lately)
        return self.answers.add(answer, self.tracker.config.smoothing_lag)
