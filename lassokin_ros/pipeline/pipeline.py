"""From a keypoint message to an estimate. Shared by node and replay, so that both give identical results.

pipeline = Pipeline(TrackerConfig(), NodeSettings())
pipeline.set_camera(camera_info)
result = pipeline.process(keypoints, arrival_ns)     # FrameResult of one person: accepted, or rejected with a reason
results = pipeline.frames(keypoints, arrival_ns)     # one FrameResult per person
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.core.learned.bone_lengths import Calibration
from lassokin_ros.core.learned.height import FEWEST, HeightEstimator
from lassokin_ros.core.observation import Status
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.camera.camera_mount import CameraMount
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE, Camera, View
from lassokin_ros.pipeline.depth_check import MISFIT, DepthCheck
from lassokin_ros.pipeline.depth_images import DepthImages
from lassokin_ros.pipeline.detections import detections_by_person
from lassokin_ros.pipeline.frame_result import FrameResult, repeated_s
from lassokin_ros.pipeline.input_checks.landmark_ids import LandmarkIds
from lassokin_ros.pipeline.input_checks.messages import LEADING_SLASH, check_layout, has_leading_slash
from lassokin_ros.pipeline.input_checks.own_depth import OwnDepth
from lassokin_ros.pipeline.input_checks.stamp_rate import StampRate
from lassokin_ros.pipeline.outputs.description.urdf import check_names
from lassokin_ros.pipeline.people.matching import is_trackable
from lassokin_ros.pipeline.people.people_tracker import PeopleImage, PeopleTracker
from lassokin_ros.pipeline.people.presence import Presence
from lassokin_ros.pipeline.people.single_person import SinglePersonTracker
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.placeholders import PLACEHOLDERS, checked_positions
from lassokin_ros.pipeline.settings import MESSAGE, NodeSettings
from lassokin_ros.pipeline.stamps import StampWatch
from lassokin_ros.skeleton_readers.load import load_skeleton, naming_help
from msg_adapters.detectors.registry import keypoint_adapter
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

NOBODY = "nobody in view"
"""Key of the count of messages without any confident keypoint."""
UNUSED = "keypoints below min_confidence"
"""Key of the count of messages with keypoints, none of which reaches `min_confidence`."""
DEPTH_IN_MESSAGE = "depth: in the message"
"""Key of the count of keypoint messages with depths of their own."""
UNSCORED = "keypoints without confidence"
"""Key of the count of messages with the positions of a body, all with a confidence of 0 or NaN."""


class Pipeline:
    """Decodes messages, removes the distortion, tracks people. No message content raises an error."""

    def __init__(
        self, tracker_config: TrackerConfig, node_config: NodeSettings, evidence: Sequence[Evidence] = ()
    ) -> None:
        """evidence: the user's own, for each frame's lasso; all people share it. Raises a LassokinError if the
        configuration is unusable.
        """
        self.config = node_config.checked()
        tracker_config = _of_camera(tracker_config, self.config)
        skeleton = load_skeleton(tracker_config.checked().skeleton, tracker_config.assumed_height)
        check_names(skeleton)
        with naming_help(tracker_config.skeleton):
            self._trackable = [TrackedPerson(tracker_config, skeleton, evidence) for _ in range(self.config.max_people)]
        self.tracker = self._trackable[0].tracker
        self._landmark_count = self.tracker.kinematics.landmark_count
        self.enabled = True
        """If False, keypoints are counted and not processed."""
        self.counts: Counter[str] = Counter()
        """Number of messages by result: received, accepted, duplicated, unstamped, resets, "rejected: <reason>", and
        messages with keypoints outside the image."""
        self.nobody_in_view = False
        """True if the last message had no confident keypoint."""
        self.answered = False
        """True after the first accepted result for a person."""
        self.unused_confidence = 0.0
        """Largest confidence in the last message without a confident keypoint; 0 if that had no keypoint."""
        self.people = _people_tracker(self._trackable, self.counts, self.config)
        self._adapter = keypoint_adapter(self.config.keypoints_type)
        self.camera = Camera(self.config.rectified)
        depth, registered = self.config.depth, self.config.depth_registered
        self.depth = DepthImages(self.counts, depth, registered) if depth else None
        """The depth images, None if the setting `depth` names no topic."""
        self.depth_check = DepthCheck()
        """Whether the depth images show the tracked people."""
        self.mount = CameraMount(self.config.camera_mount_frame) if self.config.camera_mount_frame else None
        """The camera's mount from TF, None if the setting `camera_mount_frame` names no frame."""
        self._stamps = StampWatch()
        self.stamp_rate = StampRate()
        """The rates of the stamps and of the arrivals."""
        self.own_depth = OwnDepth()
        """What is unusual about depths in the keypoint messages."""
        self.landmark_ids = LandmarkIds(self.tracker.layout.names)
        """Which landmarks have appeared."""
        self._camera_frame: str | None = None  # frame of the camera that took the last image
        self.detector_connected = True
        """False if nobody publishes keypoints. Set by the node; a recording has no such knowledge."""
        self._refused = False  # the last message was refused as a whole
        self._latest: tuple[int, int] | None = None  # stamp and arrival, ns, of the last message not refused as a whole
        self.image: tuple[int, str] | None = None
        """Stamp (ns) and frame_id of the last message that was not refused as a whole."""

    @property
    def has_camera(self) -> bool:
        """True after the first usable camera_info."""
        return self.camera.view is not None

    @property
    def camera_fault(self) -> str:
        """Why the last camera_info was refused, in words; empty if it was accepted."""
        return self.camera.fault

    @property
    def camera_angles(self) -> tuple[float, float]:
        """Roll and pitch of the camera's mount, rad: the newest from TF, otherwise those of the settings."""
        if self.mount is not None and self.mount.angles is not None:
            return self.mount.angles
        return self.tracker.config.camera_roll, self.tracker.config.camera_pitch

    @property
    def ids(self) -> list[str] | None:
        """Ids of the people present; None if one person is followed."""
        return self.people.ids

    @property
    def locked(self) -> str | None:
        """Id of the locked person; None if nobody is locked."""
        return self.people.locked

    @property
    def status(self) -> Status:
        """Tracking status. With several people, the best status among them."""
        return self.people.status

    def presence_at(self, now_ns: int) -> Presence:
        """Return the presence at a time up to which no message has arrived; now_ns: ns of the arrival clock.

        The state does not change. Only the stamp of the next message can remove people, because a paused recording
        looks like a silent detector.
        """
        stamp_ns, arrival_ns = self._latest or (0, 0)
        if arrival_ns == 0:  # no message yet, or the message arrived before the simulated clock started
            return Presence(self.status, self.ids)
        stamp_ns += max(now_ns - arrival_ns, 0)
        return self.people.presence_at(stamp_ns, self.config.forget_after, self.config.stale_after)

    @property
    def reported_lost_after(self) -> float:
        """Time without a result after which a person is reported as lost, s."""
        return min(self.config.stale_after, self.tracker.config.lost_after)

    def is_informed_at(self, now_ns: int) -> bool:
        """Return True if it is known whether somebody is in view, at a time in ns of the arrival clock.

        It is known from a usable message of the last `stale_after`, also from one that shows nobody. With
        `silent_when_empty` it is known from silence, too, while a detector is connected. If a person is locked, nobody
        else counts.
        """
        if not (self.enabled and self.has_camera) or self._refused or self.locked is not None:
            return False
        if self.config.silent_when_empty:
            return self.detector_connected
        if self._latest is None:
            return False
        arrival_ns = self._latest[1]
        return arrival_ns == 0 or now_ns - arrival_ns <= self.config.stale_after * 1e9

    def image_at(self, now_ns: int) -> tuple[int, str]:
        """Return stamp (ns) and frame_id for an output at a time in ns of the arrival clock, if no message arrives.

        The stamp advances with the clock, and keeps the delay of the last message.
        """
        if self._latest is None or self.image is None:
            return now_ns, "" if self.camera.view is None else self.camera.view.intrinsics.frame_id
        stamp_ns, arrival_ns = self._latest
        return stamp_ns + (max(now_ns - arrival_ns, 0) if arrival_ns else 0), self.image[1]

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
    def evidence_faults(self) -> dict[str, str]:
        """What was wrong with the user's evidence that is left out, by name."""
        return {n: fault for one in self._trackable for n, fault in one.tracker.frame_model.faults.items()}

    def reset(self) -> None:
        """Forget all people, the stamps and the depth images. The camera and the counts stay."""
        if self.depth is not None:
            self.depth.reset()
        self.depth_check.reset()
        self.forget_people()

    def forget_people(self) -> None:
        """Forget all people and the stamps."""
        self._stamps.reset()
        self._forget_people()

    def _forget_people(self) -> None:
        self.people.reset()
        self._latest = self._camera_frame = self.image = None
        self.counts["resets"] += 1

    def tune(self, tracker_config: TrackerConfig, node_config: NodeSettings) -> None:
        """Apply settings that can change while running, from the next message on. Another height resets.

        Raises ConfigurationError, before anything is changed, for a setting out of its range.
        """
        config, resized = node_config.checked(), tracker_config.height != self.tracker.config.height
        for tracked in self._trackable:
            tracked.tracker.tune(_of_camera(tracker_config, config))
        self.config = config
        self.people.tune(self.config.follow, self.config.lock)
        if resized:
            self.reset()

    def set_camera(self, message: Any) -> str | None:
        """Apply a CameraInfo message. Return the key of the reason if it is refused; the last good camera then stays.

        A new resolution or lens of the same camera keeps the state. The frame of another camera resets it.
        """
        try:
            if self.camera.update(message):
                self.reset()
        except AdapterError as error:
            self.counts[f"rejected: {error.reason}"] += 1
            return error.reason
        return None

    def process(self, message: Any, arrival_ns: int) -> FrameResult:
        """Track the one person in a keypoint message, without `smoothing_lag`.

        arrival_ns: ns, the stamp of a message that has none.
        """
        (frame,) = self.frames(message, arrival_ns)
        return frame

    def frames(self, message: Any, arrival_ns: int) -> list[FrameResult]:
        """Track all people in a keypoint message. Return one accepted result per person, none if nobody is present.

        A refused message gives one result with the reason; so does a message in which a single followed person was not
        tracked. With `smoothing_lag`, the accepted results are those of earlier messages that are due now.
        """
        self.counts["received"] += 1
        if not self.enabled:
            self.counts["ignored while disabled"] += 1
            return []
        frames = self._frames(message, arrival_ns)
        self.answered = self.answered or any(frame.accepted for frame in frames)
        rejection = next((frame.rejection for frame in frames if not frame.accepted), None)
        self.counts["accepted" if rejection is None else f"rejected: {rejection}"] += 1
        if repeated_s(frames) > 0:
            self.counts["duplicated"] += 1
        return frames

    def _frames(self, message: Any, arrival_ns: int) -> list[FrameResult]:
        stamp_ns, frame_id, self.nobody_in_view = arrival_ns, "", False
        sampled: Keypoints | None = None
        try:
            keypoints, view = self._decode(message)
            frame_id = keypoints.frame_id or view.intrinsics.frame_id
            keypoints = self._remove_placeholders(keypoints, view)
            self._count_nobody_and_outside(keypoints, view)
            if keypoints.stamp_ns is None:
                self.counts["unstamped"] += 1
            else:
                self.stamp_rate.add(keypoints.stamp_ns, arrival_ns)
            stamped = keypoints.stamp_ns is not None
            stamp_ns = keypoints.stamp_ns or self._stamps.estimate(arrival_ns)
            keypoints = self.own_depth.checked(keypoints, stamp_ns)
            self.landmark_ids.add(keypoints)
            if keypoints.depth is not None:
                self.counts[DEPTH_IN_MESSAGE] += bool(np.count_nonzero(keypoints.depth > 0) >= FEWEST)
            elif self.depth is not None:
                sampled = self.depth.with_depth(keypoints, stamp_ns, view.size, view.intrinsics.frame_id)
                self.counts[MISFIT] += bool(self.depth_check.fault)
                keypoints = keypoints if self.depth_check.fault else sampled
            image = PeopleImage(keypoints, stamp_ns, frame_id, view.lens, self._has_persistent_numbers(keypoints))
            if self._is_back_in_time(image, arrival_ns, stamped):
                self._jump_back(image)
            self._switch_camera(view.intrinsics.frame_id)
            self._follow_mount(image)
            frames = self.people.update(image, self.config.forget_after)
            if sampled is not None and self.tracker.config.smoothing_lag == 0:
                self.depth_check.update(sampled, frames)
        except AdapterError as error:
            self._refused = True
            return [FrameResult(stamp_ns, frame_id, None, error.reason, str(error))]
        self._refused = False
        self._latest, self.image = (stamp_ns, arrival_ns), (stamp_ns, frame_id)
        if all(frame.accepted for frame in frames):
            self._stamps.seen(stamp_ns, self.people.tracked_at(stamp_ns))
            self._stamps.follow(stamp_ns, arrival_ns, stamped)
        return frames

    def flush(self) -> list[FrameResult]:
        """Return the results that wait for `smoothing_lag`. No message follows."""
        return self.people.flush()

    def _decode(self, message: Any) -> tuple[Keypoints, View]:
        """Return the keypoints and the camera of their image."""
        present = self.camera.at(None)
        keypoints = self._adapter.decode(message, present.size)
        view = self.camera.at(keypoints.stamp_ns, keypoints.frame_id)
        if view is not present:
            keypoints = self._adapter.decode(message, view.size)
        if has_leading_slash(message):
            self.counts[LEADING_SLASH] += 1
        check_layout(keypoints, self.tracker.layout, self.tracker.config.landmarks)
        return keypoints, view

    def _remove_placeholders(self, keypoints: Keypoints, view: View) -> Keypoints:
        """Remove placeholder coordinates, and count the message. Raises AdapterError for fractions of the image."""
        kept = checked_positions(keypoints, view.size)
        if kept is not keypoints:
            self.counts[PLACEHOLDERS] += 1
        return kept

    def _count_nobody_and_outside(self, keypoints: Keypoints, view: View) -> None:
        confident = keypoints.confidence >= self.tracker.config.min_confidence  # others may be out of view
        self.nobody_in_view = not np.count_nonzero(confident & keypoints.present)
        if self.nobody_in_view:
            self.counts[NOBODY] += 1
            self.unused_confidence = float(keypoints.confidence.compress(keypoints.present).max(initial=0.0))
            self.counts[UNUSED] += self.unused_confidence > 0
            if self.unused_confidence == 0 and keypoints.unscored >= self.tracker.config.min_landmarks:
                self.counts[UNSCORED] += 1
        if view.has_outside(keypoints.xy.compress(confident, axis=0)):
            self.counts[OUTSIDE_IMAGE] += 1

    def _is_back_in_time(self, image: PeopleImage, arrival_ns: int, stamped: bool) -> bool:
        """Return True if the people must be forgotten. Raises AdapterError for an old stamp, see `StampWatch.check`."""
        try:
            return self._stamps.check(image.stamp_ns, arrival_ns, self.config.jump_back)
        except AdapterError:
            if not self._stamps.is_first_stamp(stamped):
                raise
            return True  # arrival times were of another clock than the stamps

    def _jump_back(self, image: PeopleImage) -> None:
        """Reset for a message from an earlier time. Raises AdapterError if nobody in it can be tracked."""
        people = detections_by_person(image.keypoints, self._landmark_count, image.lens)
        if not any(is_trackable(one, self.tracker.config) for one in people):
            raise AdapterError("too_few_landmarks", "the message is from an earlier time and contains no person")
        self._forget_people()
        self._stamps.seen(image.stamp_ns, True)

    def _switch_camera(self, frame: str) -> None:
        """Reset if the image is from another camera than the last image.

        `set_camera` also resets, but images of the previous camera may arrive after it.
        """
        if self._camera_frame not in (None, frame):
            self._forget_people()
        self._camera_frame = frame

    def _follow_mount(self, image: PeopleImage) -> None:
        """Use the camera's mount at the time of the image. Without TF, the present one stays."""
        if self.mount is not None and (angles := self.mount.at(image.frame_id, image.stamp_ns)) is not None:
            for tracked in self._trackable:
                tracked.tracker.move_camera(*angles)

    def _has_persistent_numbers(self, keypoints: Keypoints) -> bool:
        """Return True if the message's person numbers identify people over time."""
        persons = keypoints.persons
        if persons is None or not keypoints.persistent or self.config.person_ids != MESSAGE:
            return False
        return len(persons) == 0 or bool(persons.min() >= 0)


def _of_camera(tracker: TrackerConfig, node: NodeSettings) -> TrackerConfig:
    """The settings for a camera that may move: feet are not held, because nobody tells how it moves."""
    return replace(tracker, hold_feet=False) if node.camera_mount_frame else tracker


def _people_tracker(people: Sequence[TrackedPerson], counts: Counter[str], config: NodeSettings) -> PeopleTracker:
    """Return the tracker for one person or several. MultiPersonTracker is imported on demand, see assignment.py."""
    if not config.several_people:
        return SinglePersonTracker(people[0], config.follow, config.lock)
    from lassokin_ros.pipeline.people.multi_person import MultiPersonTracker

    return MultiPersonTracker(people, counts, config.follow, config.lock)
