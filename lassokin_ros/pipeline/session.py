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
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.bone_lengths import Calibration
from lassokin_ros.core.learned.extrinsics import Extrinsics
from lassokin_ros.core.learned.height import HeightEstimator
from lassokin_ros.core.observation import Rejection, Status
from lassokin_ros.core.output.fixed_lag import Backward
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.answers import Answer, AnswersInOrder, frames_of
from lassokin_ros.pipeline.camera.camera_places import GivenPoses
from lassokin_ros.pipeline.camera.placement import Placement
from lassokin_ros.pipeline.camera_images import UNREADABLE, UNREADABLE_WORDS, CameraImages
from lassokin_ros.pipeline.frame_result import FrameResult, repeated_s
from lassokin_ros.pipeline.image_sets import LATE, LONGEST_LATE_NS, stamp_of_set
from lassokin_ros.pipeline.inputs import Inputs
from lassokin_ros.pipeline.outputs.description.urdf import check_names
from lassokin_ros.pipeline.people.choice import NoPersonError
from lassokin_ros.pipeline.people.out_of_view import Absent, OutOfView
from lassokin_ros.pipeline.people.people_tracker import PERSON_ABSENT, PeopleTracker
from lassokin_ros.pipeline.people.presence import Presence
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.scene import Scene
from lassokin_ros.pipeline.seen import Image, key_of
from lassokin_ros.pipeline.settings import LASTING, NodeSettings
from lassokin_ros.skeleton_readers.load import load_skeleton, naming_help
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
        skeleton = load_skeleton(tracker_config.checked().skeleton, tracker_config.assumed_height)
        check_names(skeleton)
        up = np.array([0.0, 0.0, 1.0]) if self.config.fixed_frame else None
        with naming_help(tracker_config.skeleton):
            own = [
                TrackedPerson(replace(tracker_config, height=float(body.height)), body, evidence, up, number)
                for number, body in (bodies or {}).items()
            ]
            others = range(self.config.max_people - len(own))
            self._trackable = [*own, *(TrackedPerson(tracker_config, skeleton, evidence, up) for _ in others)]
        self.tracker = self._trackable[0].tracker
        self.enabled = True
        """If False, keypoints are counted and not processed."""
        self.counts: Counter[str] = Counter()
        """Number of messages by result: received, accepted, duplicated, unstamped, resets, "rejected: <reason>", and
        messages with keypoints outside the image."""
        self.identities: Mapping[tuple[str, bytes], int] | None = None
        """The numbers of the people in images that were seen before, by camera and `key_of`: nobody else is there."""
        self.answered = False
        """True after the first accepted result for a person."""
        rules = self.config.follow, self.config.lock, self.config.several_cameras, self.config.person_ids == LASTING
        self.people = PeopleTracker(self._trackable, self.counts, *rules)
        names, layout = self.config.camera_names, self.tracker.layout
        self.cameras = {name: CameraImages(name, tracker_config, self.config, layout, self.counts) for name in names}
        """The inputs of each camera by name; the name of the only camera is empty."""
        self.first = self.cameras[names[0]]
        """The inputs of the only camera, or of the first one."""
        self.placement = Placement(self.config, self._trackable, self.counts, poses)
        """Where the cameras are, and which of them are used."""
        self._out_of_view = OutOfView(np.array([0.0, -1.0, 0.0]) if up is None else up)
        places = self.placement.places
        self.inputs = Inputs(self.cameras, self.config, patience, None if places is None else places.may_reach)
        """What waits for depth images, TF and other cameras."""
        self._order, self._ready = AnswersInOrder(), list[Answer]()
        self.detector_connected = True
        """False if nobody publishes keypoints of a camera. Set by the node; a recording has no such knowledge."""
        self.scene = Scene(names)
        """What the newest messages tell."""

    def use_backward(self, frames: Mapping[int | None, Mapping[int, Backward]]) -> None:
        """See `TrackedPerson.use_backward`. frames: by the person's number in the messages, None without a number."""
        for tracked in self._trackable:
            tracked.use_backward(frames.get(tracked.number, {}))

    @property
    def ids(self) -> list[str] | None:
        """Ids of the people present; None if one person is followed."""
        return self.people.ids

    @property
    def locked(self) -> str | None:
        """Id of the locked person, or GONE; None if nobody is locked."""
        return self.people.locked

    def lock(self, now_ns: int) -> str:
        """Lock the person whom `follow` names in the newest image, and return the id. now_ns: as for `presence_at`.

        Raises NoPersonError if there is none, also if the image is older than `stale_after`.
        """
        if not self.enabled:
            raise NoPersonError("nobody was locked: the node is disabled; call ~/set_enabled with true, then lock")
        if self.scene.latest is None:
            raise NoPersonError("nobody was locked: no usable keypoints arrived since the start or the last reset")
        _, arrival_ns = self.scene.latest
        age_s = (now_ns - arrival_ns) * 1e-9 if arrival_ns else 0.0
        if age_s > self.config.stale_after:
            raise NoPersonError(
                f"nobody was locked: the newest keypoints arrived {age_s:.1f} s ago; expected at most stale_after "
                f"{self.config.stale_after:g} s: start the detector, then lock"
            )
        return self.people.lock()

    @property
    def status(self) -> Status:
        """Tracking status. With several people, the best status among them."""
        return self.people.status

    def presence_at(self, now_ns: int) -> Presence:
        """Return the presence at a time up to which no message has arrived; now_ns: ns of the arrival clock.

        The state does not change. Only the stamp of the next message can remove people, because a paused recording
        looks like a silent detector.
        """
        if self.scene.latest is None or self.scene.latest[1] == 0:  # none yet, or it came before a simulated clock
            return Presence(self.status, self.ids)
        stamp_ns = self.scene.stamp_at(now_ns)
        assert stamp_ns is not None
        return self.people.presence_at(stamp_ns, self.config.forget_after, self.config.stale_after)

    def set_clock_back(self, step_ns: int) -> None:
        """Keep the ages of all messages: the clock of arrivals was set back by `step_ns` ns since the last call."""
        self.scene.set_clock_back(step_ns)
        self.inputs.set_clock_back(step_ns)

    @property
    def reported_lost_after(self) -> float:
        """Time without a result after which a person is reported as lost, s."""
        return min(self.config.stale_after, self.tracker.config.lost_after)

    def scene_known_empty(self, now_ns: int) -> bool:
        """Return True if it is known that nobody is in view who is not tracked, at a time in ns of the arrival clock.

        It is known from usable messages of all cameras in the last `stale_after`, if none of them shows somebody, be it
        a person who was tracked, or one who is too near; and not from keypoints that could not be used, such as those
        of a frozen detector. With `silent_when_empty` it is known from silence, too, while all detectors are connected.
        Nobody must have left the view, see `absent_at`. If a person is locked, nobody else counts.
        """
        if not (self.enabled and self.inputs.has_camera) or self.locked is not None:
            return False
        stamp_ns, places = self.image_at(now_ns)[0], self.placement.places
        if self.config.silent_when_empty and self.detector_connected and places is not None:
            self._out_of_view.look(places.others((), stamp_ns), stamp_ns, self.config.forget_after)
        if self.absent_at(stamp_ns):
            return False
        return self.scene.known_empty(now_ns, self.config, self.detector_connected)

    def absent_at(self, stamp_ns: int) -> list[Absent]:
        """Return who was tracked, and may be where no camera has looked since; nobody if it is unknown where they look.

        stamp_ns: ns.
        """
        return self._out_of_view.at(stamp_ns, self.config.nobody_after)

    def untracked_at(self, stamp_ns: int) -> int:
        """Return the number of people who are in the newest images and are not tracked, at a stamp in ns.

        Of several cameras, it is that of the camera with most of them. It is at least 1 while one of them is silent,
        or its messages cannot be used, because somebody may be before it.
        """
        return self.scene.untracked_at(stamp_ns, self.config, self.reported_lost_after)

    def image_at(self, now_ns: int) -> tuple[int, str]:
        """Return stamp (ns) and frame_id for an output at a time in ns of the arrival clock, if no message arrives.

        The stamp advances with the clock, and keeps the delay of the last message.
        """
        stamp_ns, image = self.scene.stamp_at(now_ns), self.scene.image
        if stamp_ns is None or image is None:
            return now_ns, self.placement.frame_id(self.first.camera.view)
        return stamp_ns, image[1]

    @property
    def trackers(self) -> dict[str, Tracker]:
        """The tracker of each person by id. The id of a single person is empty."""
        return {person: tracked.tracker for person, tracked in self.people.tracked.items()}

    def calibrations(self) -> dict[str, Calibration]:
        """Return the calibration of each person's lengths by id."""
        return {person: tracker.learned.lengths for person, tracker in self.trackers.items()}

    def heights(self) -> dict[str, HeightEstimator]:
        """Return each person's measured height by id, none if the height is given."""
        found = {person: tracker.learned.height for person, tracker in self.trackers.items()}
        return {person: height for person, height in found.items() if height is not None}

    @property
    def extrinsics(self) -> Extrinsics | None:
        """What is learned about the cameras' poses, from the person whom several have seen for the longest time."""
        found = [tracker.learned.extrinsics for tracker in self.trackers.values()]
        return max((one for one in found if one is not None), key=lambda one: one.frame_count, default=None)

    @property
    def evidence_faults(self) -> dict[str, str]:
        """What was wrong with the user's evidence that is left out, by name."""
        return {n: fault for one in self._trackable for n, fault in one.tracker.frame_model.faults.items()}

    def reset(self, unlock: bool = True) -> None:
        """Forget all people, the stamps, the depth images and what waits. The camera and the counts stay.

        unlock: see PeopleTracker.reset.
        """
        self.inputs.reset()
        if self.placement.places is not None:
            self.placement.places.faults.clear()
        self.forget_people(unlock)

    def forget_people(self, unlock: bool = True) -> None:
        """Forget all people and the stamps. unlock: see PeopleTracker.reset."""
        self._forget_people(unlock)
        for camera in self.cameras.values():
            camera.reset()

    def begin_take(self) -> list[Answer]:
        """Note that the next image is of another shot; return the answers of everything that waits.

        What was learned of the only person stays; several people are forgotten.
        """
        answers = self.finish()
        self._forget_people(unlock=True, same_person=True)
        return answers

    def _forget_people(self, unlock: bool, same_person: bool = False) -> None:
        self.people.reset(unlock, same_person)
        self.inputs.reset_sets()
        self._order.reset()
        self.placement.reset()
        self._out_of_view.reset()
        self.scene.reset()
        self.counts["resets"] += 1

    def tune(self, tracker_config: TrackerConfig, node_config: NodeSettings) -> None:
        """Apply settings that can change while running, from the next message on. Another height resets.

        Raises ConfigurationError, before anything is changed, for a setting out of its range.
        """
        config, resized = node_config.checked(), tracker_config.height != self.tracker.config.height
        config.check_with(tracker_config)
        for tracked in self._trackable:
            tracked.tracker.tune(tracker_config)
        self.config = config
        for camera in self.cameras.values():
            camera.tracker_config, camera.config = tracker_config, config
            if tracker_config.smoothing_lag > 0:
                camera.depth_check.reset()  # it is not updated, see _check_depth
        self.people.tune(self.config.follow, self.config.lock)
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
                self._ready += self._order.flush(self.people.flush())
                self.reset(unlock=False)
        except AdapterError as error:
            self.counts[f"rejected: {error.reason}"] += 1
            return error.reason
        return None

    def push(self, message: Any, arrival_ns: int, camera: str = "") -> list[Answer]:
        """Take a keypoint message, or `Keypoints`, and return the answers that are due, in the order of their stamps.

        message: None for one that could not be deserialised. arrival_ns: ns, the stamp of a message that has none.
        camera: its name, empty for the only one. A message may wait for its depth image, for those of other cameras and
        for `smoothing_lag`: call `due` at `due_at_ns`.
        """
        name = camera or self.first.name
        self.inputs.add(name, message, arrival_ns)
        return self._released(name, arrival_ns)

    def push_depth(self, message: Any, arrival_ns: int, camera: str = "") -> list[Answer]:
        """Take a depth image, None for one that could not be deserialised; see `push` and `DepthImages.fault`."""
        name = camera or self.first.name
        if message is not None and (depth := self.cameras[name].depth) is not None:
            depth.add(message, arrival_ns)
        return self._released(name, arrival_ns)

    def push_transforms(self, message: Any, static: bool = False) -> None:
        """Take a message of /tf, or of /tf_static; None for one that could not be deserialised."""
        if message is not None and (transforms := self.placement.transforms) is not None:
            transforms.add(message, static=static)

    def due(self, now_ns: int) -> list[Answer]:
        """Return the answers of images whose wait has ended. now_ns: ns of the arrival clock."""
        answers = [answer for name in self.cameras for answer in self._released(name, now_ns)]
        if self.enabled:
            answers += self._track_sets(self.inputs.due_sets(now_ns), now_ns)
        return answers

    @property
    def due_at_ns(self) -> int | None:
        """Time in ns of the arrival clock at which `due` must be called; None if no image waits."""
        return self.inputs.due_at_ns

    def finish(self) -> list[Answer]:
        """Return the answers of everything that waits. No message follows."""
        answers = [answer for name in self.cameras for answer in self._released(name, None)]
        for images in self.inputs.due_sets(None):
            answers += self._track_sets([images], images[0].stamp_ns)
        return answers + self._order.flush(self.people.flush())

    def process(self, message: Any, arrival_ns: int) -> FrameResult:
        """Track the one person in a keypoint message, without `smoothing_lag`; see `frames`.

        arrival_ns: ns, the stamp of a message that has none.
        """
        (frame,) = self.frames(message, arrival_ns)
        return frame

    def frames(self, message: Any, arrival_ns: int, camera: str = "") -> list[FrameResult]:
        """Return the results of all answers of `push`, without a wait for depth images."""
        name = camera or self.first.name
        self.inputs.add(name, message, arrival_ns)
        return frames_of(self._released(name, None))

    def _released(self, camera: str, now_ns: int | None) -> list[Answer]:
        """Return the answers of messages of a camera that wait no longer. now_ns: None if nothing follows."""
        answers, self._ready = self._ready, []
        for message, arrival_ns in self.inputs.ready(camera, now_ns):
            self.counts["received"] += 1
            if self.enabled:
                answers += self._answers(message, arrival_ns, self.cameras[camera])
            else:
                self.counts["ignored while disabled"] += 1
        return answers

    def _answers(self, message: Any, arrival_ns: int, camera: CameraImages) -> list[Answer]:
        """Return the answers of a message and those of earlier ones that are due."""
        try:
            image, changed = camera.image(message, arrival_ns)
        except AdapterError as error:
            self.scene.refuse([camera.name])
            detail = f"camera '{camera.name}': {error}" if camera.name else str(error)
            return self._refusal(camera.stamp_ns, camera.frame_id, arrival_ns, error.reason, detail)
        if self.identities is not None:
            image = self._identified(image, self.identities)
        before = []
        if changed:
            before = self._order.flush(self.people.flush())
            self._forget_people(unlock=False)
            for other in self.cameras.values():
                if other is not camera:
                    other.reset()
        return before + self._track_sets(self.inputs.sets_with(image, arrival_ns), arrival_ns)

    def _identified(self, image: Image, identities: Mapping[tuple[str, bytes], int]) -> Image:
        """Return an image with those whose numbers are known."""
        known = [(seen, identities.get((image.camera.name, key_of(seen.points)))) for seen in image.people]
        people = [replace(seen, number=number) for seen, number in known if number is not None]
        return replace(image, people=people, numbered=True, lasting=True, identified=True)

    def _track_sets(self, sets: Sequence[Sequence[Image]], arrival_ns: int) -> list[Answer]:
        """Return the answers of several sets of images. Each set counts as one accepted or rejected message."""
        return [answer for images in sets for answer in self._track(images, arrival_ns)]

    def _refusal(self, stamp_ns: int, frame_id: str, arrival_ns: int, reason: str, detail: str) -> list[Answer]:
        frames = self._counted([FrameResult(stamp_ns, frame_id, None, reason, detail)])
        answer = Answer(stamp_ns, frame_id, arrival_ns, frames, refused=True)
        return self._order.add(answer, self.tracker.config.smoothing_lag)

    def _counted(self, frames: list[FrameResult]) -> list[FrameResult]:
        self.answered = self.answered or any(frame.accepted for frame in frames)
        rejection = next((frame.rejection for frame in frames if not frame.accepted), None)
        if frames or not self.config.several_cameras:
            self.counts["accepted" if rejection is None else f"rejected: {rejection}"] += 1
        if repeated_s(frames) > 0:
            self.counts["duplicated"] += 1
        return frames

    def _track(self, images: Sequence[Image], arrival_ns: int) -> list[Answer]:
        """Return the answers that the images of one instant make due."""
        stamp_ns = stamp_of_set(images)
        try:
            placed, frame_id = self.placement.placed(images)
            placed = self.placement.agreeing(placed)
            if not placed:
                return []
            away = self._out_of_view.ids
            frames = self.people.update(placed, frame_id, self.config.forget_after, away)
        except AdapterError as error:
            self.scene.refuse(image.camera.name for image in images)
            return self._refusal(stamp_ns, images[0].frame_id, arrival_ns, error.reason, str(error))
        self.scene.use(images, placed, arrival_ns, self.people, self.reported_lost_after)
        if self.placement.places is not None:
            self._out_of_view.update(frames, placed, self.config.forget_after, self.placement.jumps.newest)
        if self.placement.tf_offset is not None:
            self.placement.tf_offset.update(frames)
        if self.config.several_cameras:
            frames = self._without_absences(frames, stamp_ns)
            self._note_residuals(frames)
        self._check_depth(images, frames)
        older_ns = 0 if self.scene.latest is None else self.scene.latest[0] - stamp_ns
        late = self.config.several_cameras and older_ns < LONGEST_LATE_NS
        if older_ns <= 0 or (not late and self.people.tracked_at(stamp_ns)):  # a stamp that was ahead is left behind
            self.scene.latest, self.scene.image = (stamp_ns, arrival_ns), (stamp_ns, frame_id)
        if not self.config.several_cameras and all(frame.accepted for frame in frames):
            self.first.stamps.seen(stamp_ns, self.people.tracked_at(stamp_ns))
            self.first.stamps.follow(stamp_ns, arrival_ns, images[0].stamped)
        frames = self._counted(frames)
        matters = not self.config.several_cameras or not self._tracked_lately(stamp_ns)
        assert self.scene.image is not None
        of = (stamp_ns, frame_id) if frames else self.scene.image  # an image that is late tells nothing of now
        stamps_ns = [image.stamp_ns for image in images]
        answer = Answer(*of, arrival_ns, frames, stamps_ns, matters=matters)
        return self._order.add(answer, self.tracker.config.smoothing_lag)

    def _without_absences(self, frames: list[FrameResult], stamp_ns: int) -> list[FrameResult]:
        """Leave out the rejections of a camera that only did not see the person whom another camera sees."""
        kept = []
        for frame in frames:
            if frame.rejection == Rejection.LATE.value:
                self.counts[LATE] += 1
            elif frame.rejection not in (Rejection.TOO_FEW_LANDMARKS.value, Rejection.UNPLACED.value, PERSON_ABSENT):
                kept.append(frame)
            elif self.status is not Status.TRACKING or not self._tracked_lately(stamp_ns):
                kept.append(frame)
        return kept

    def _tracked_lately(self, stamp_ns: int) -> bool:
        limit = self.tracker.config.lost_after
        return any(person.unseen_s(stamp_ns) <= limit for person in self.people.tracked.values())

    def _note_residuals(self, frames: Sequence[FrameResult]) -> None:
        """Keep how far the bodies are from the keypoints of each camera."""
        for frame in frames:
            estimate = frame.estimate
            if not frame.accepted or estimate is None or estimate.pose is None:
                continue
            for one in frame.images:
                landmarks = one.camera.into_camera(estimate.pose.landmarks)
                apart = np.linalg.norm(project(landmarks) - one.points, axis=1)
                seen = apart[np.isfinite(apart)]
                if len(seen):
                    self.cameras[one.camera.name].residuals.append(one.lens.focal * float(np.median(seen)))

    def _check_depth(self, images: Sequence[Image], frames: Sequence[FrameResult]) -> None:
        """Compare the depth image of each camera with the tracked people."""
        if self.tracker.config.smoothing_lag > 0:
            return
        for image in images:
            name = image.camera.name
            self.cameras[name].depth_check.update(image.people, frames, name)
