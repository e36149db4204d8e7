"""From a keypoint message to an estimate: what the node and the replay share, so that both give the same bytes.

pipeline = Pipeline(TrackerConfig(), NodeSettings())
pipeline.set_camera(camera_info)
frame = pipeline.process(keypoints, arrival_ns)      # Frame: accepted, or rejected with a reason
frames = pipeline.frames(keypoints, arrival_ns)      # the same for one person or several: a Frame for each
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from lassokin_ros.core.calibration import Calibration
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Status
from lassokin_ros.pipeline.camera import BEYOND, Camera, View
from lassokin_ros.pipeline.detections import everybody
from lassokin_ros.pipeline.frame_result import FrameResult, repeated_s
from lassokin_ros.pipeline.lens import Lens
from lassokin_ros.pipeline.outputs.urdf import check_names
from lassokin_ros.pipeline.people.matching import usable
from lassokin_ros.pipeline.people.presence import Presence
from lassokin_ros.pipeline.people.single_person import PERSON_ABSENT, SinglePersonTracker
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.settings import MESSAGE, NodeSettings
from lassokin_ros.pipeline.stamps import StampWatch
from lassokin_ros.skeleton_readers.load import load_skeleton
from msg_adapters.detectors.registry import keypoint_adapter
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

if TYPE_CHECKING:
    from lassokin_ros.pipeline.people.multi_person import MultiPersonTracker


class Pipeline:
    """Decodes, undistorts, tracks and reads joint angles; its methods never raise for what a message may hold."""

    def __init__(self, tracker_config: TrackerConfig, node_config: NodeSettings) -> None:
        """Raises a LassokinError when the configuration cannot be used."""
        self.config = node_config.checked()
        skeleton = load_skeleton(tracker_config.checked().skeleton, tracker_config.height)
        check_names(skeleton)
        bodies = [TrackedPerson(tracker_config, skeleton) for _ in range(self.config.max_people)]
        self._bodies, self._body = bodies, bodies[0]
        self.tracker = bodies[0].tracker
        self._landmark_count = self.tracker.kinematics.landmark_count
        self.enabled = True
        """While False, keypoints are counted and not looked at."""
        self.counts: Counter[str] = Counter()
        """Messages by what became of them: received, accepted, duplicated, unstamped, resets, "rejected: <reason>", and
        those whose keypoints leave the image."""
        self.people = _people(bodies, self.counts) if self.config.several_people else None
        """Who is there, when several people are followed; None when it is one."""
        self._adapter = keypoint_adapter(self.config.keypoints_type)
        self.camera = Camera(self.config.rectified)
        self._stamps = StampWatch()
        self._person = SinglePersonTracker(self._body)
        self._seen_from: str | None = None  # frame of the camera that took the last image
        self._latest: tuple[int, int] | None = None  # stamp and arrival, ns, of the last message not refused as a whole

    @property
    def has_camera(self) -> bool:
        """True once a usable camera_info has come."""
        return self.camera.view is not None

    @property
    def camera_fault(self) -> str:
        """Why the last camera_info was refused, in words; empty when it was taken."""
        return self.camera.fault

    @property
    def ids(self) -> list[str] | None:
        """Of the people who are there; None when one person is followed."""
        return None if self.people is None else self.people.ids

    @property
    def status(self) -> Status:
        """What is known of the person; of several people, of the one of whom most is known."""
        return self._body.status if self.people is None else self.people.status

    def presence_at(self, now_ns: int) -> Presence:
        """Who is there, and what is known of them, when no message has come until now_ns (ns, of the arrivals' clock).

        This is only said. Nobody is forgotten by it: what has passed is for the next message's stamp to say, since a
        recording that is stopped for a while looks from here like a detector that is silent.
        """
        stamp_ns, arrival_ns = self._latest or (0, 0)
        if arrival_ns == 0:  # nothing has come, or it came before a simulated clock did
            return Presence(self.status, self.ids)
        stamp_ns += max(now_ns - arrival_ns, 0)
        if self.people is None:
            return Presence(self._body.status_at(stamp_ns))
        return self.people.presence_at(stamp_ns, self.config.forget_after)

    def calibrations(self) -> dict[str, Calibration]:
        """What is known of each person's lengths, by id; of one person alone under an empty id."""
        bodies = {"": self._body} if self.people is None else self.people.bodies
        return {person: body.tracker.calibration for person, body in bodies.items()}

    def reset(self) -> None:
        """Forget the person, or everybody, and the time; the camera and the counts stay."""
        self._stamps.reset()
        self._forget_people()

    def _forget_people(self) -> None:
        self._body.reset() if self.people is None else self.people.reset()
        self._person.reset()
        self._latest = self._seen_from = None
        self.counts["resets"] += 1

    def tune(self, tracker_config: TrackerConfig, node_config: NodeSettings) -> None:
        """Take over live settings; they hold from the next frame on."""
        for body in self._bodies:
            body.tracker.tune(tracker_config)
        self.config = node_config.checked()

    def set_camera(self, message: Any) -> str | None:
        """Take over a CameraInfo message; the reason's key when it is refused (the last good camera then stays).

        Another resolution or lens of the same camera leaves the person where they are; in another camera's frame they
        are somewhere else, so that the state is forgotten.
        """
        try:
            if self.camera.take(message):
                self.reset()
        except AdapterError as error:
            self.counts[f"rejected: {error.reason}"] += 1
            return error.reason
        return None

    def process(self, message: Any, arrival_ns: int) -> FrameResult:
        """Track the one person in a keypoint message, without `smoothing_lag`; arrival_ns stamps what has no stamp."""
        (frame,) = self.frames(message, arrival_ns)
        return frame

    def frames(self, message: Any, arrival_ns: int) -> list[FrameResult]:
        """Track everybody in a keypoint message: one accepted frame for each, none when nobody is there.

        A message that is refused, and one in which the one person who is followed was not tracked, gives one frame
        that says why. With `smoothing_lag`, accepted frames are those of earlier messages that have become due.
        """
        self.counts["received"] += 1
        if not self.enabled:
            self.counts["ignored while disabled"] += 1
            return []
        frames = self._frames(message, arrival_ns)
        rejection = next((frame.rejection for frame in frames if not frame.accepted), None)
        self.counts["accepted" if rejection is None else f"rejected: {rejection}"] += 1
        if repeated_s(frames) > 0:
            self.counts["duplicated"] += 1
        return frames

    def _frames(self, message: Any, arrival_ns: int) -> list[FrameResult]:
        stamp_ns, frame_id = arrival_ns, ""
        try:
            keypoints, view = self._decode(message)
            frame_id = keypoints.frame_id or view.intrinsics.frame_id
            self._count_beyond(keypoints, view)
            if keypoints.stamp_ns is None:
                self.counts["unstamped"] += 1
            else:
                stamp_ns = keypoints.stamp_ns
            if self._stamps.check(stamp_ns, arrival_ns, self.config.jump_back):
                self._go_back(keypoints, stamp_ns, view.lens)
            self._see_from(view.intrinsics.frame_id)
            lasting = self._lasting(keypoints)
            if self.people is None:
                seen = self._person.of(keypoints, stamp_ns, view.lens, lasting)
                self._latest = stamp_ns, arrival_ns
                frames = self._body.track(stamp_ns, frame_id, seen, view.lens)
                if all(frame.accepted for frame in frames):
                    self._stamps.seen(stamp_ns, True)
                elif absence := self._person.absence(keypoints, seen, lasting):
                    frames[-1] = replace(frames[-1], rejection=PERSON_ABSENT, detail=absence)
                return frames
            people = everybody(keypoints, self._landmark_count, view.lens)
        except AdapterError as error:
            return [FrameResult(stamp_ns, frame_id, None, error.reason, str(error))]
        self._latest = stamp_ns, arrival_ns
        frames = self.people.update(stamp_ns, frame_id, people, view.lens, lasting, self.config.forget_after)
        self._stamps.seen(stamp_ns, self.people.tracked_at(stamp_ns))
        return frames

    def flush(self) -> list[FrameResult]:
        """The frames that wait for their `smoothing_lag`: no message will come after them."""
        return self._body.flush() if self.people is None else self.people.flush()

    def _decode(self, message: Any) -> tuple[Keypoints, View]:
        """The keypoints, and the camera that took their image."""
        present = self.camera.at(None)
        keypoints = self._adapter.decode(message, present.size)
        view = self.camera.at(keypoints.stamp_ns)
        if view is not present:
            keypoints = self._adapter.decode(message, view.size)
        return keypoints, view

    def _count_beyond(self, keypoints: Keypoints, view: View) -> None:
        believed = keypoints.confidence >= self.tracker.config.min_confidence  # others may well be out of sight
        if view.is_left_by(keypoints.xy[believed]):
            self.counts[BEYOND] += 1

    def _go_back(self, keypoints: Keypoints, stamp_ns: int, lens: Lens) -> None:
        """Forget everybody for a message from an earlier time; AdapterError for one that is of no use in any time."""
        people = everybody(keypoints, self._landmark_count, lens)
        if not any(usable(seen, self.tracker.config) for seen in people):
            raise AdapterError("too_few_landmarks", "the message is from an earlier time, and nobody is in it")
        self._forget_people()
        self._stamps.seen(stamp_ns, True)

    def _see_from(self, frame: str) -> None:
        """Forget everybody when the image is another camera's than the last; they were still seen from there after
        `set_camera`, in images that came late.
        """
        if self._seen_from not in (None, frame):
            self._forget_people()
        self._seen_from = frame

    def _lasting(self, keypoints: Keypoints) -> bool:
        """True when the message's numbers tell who is who."""
        persons = keypoints.persons
        if persons is None or not keypoints.lasting or self.config.person_ids != MESSAGE:
            return False
        return len(persons) == 0 or bool(persons.min() >= 0)


def _people(bodies: list[TrackedPerson], counts: Counter[str]) -> MultiPersonTracker:
    """Imported when several people are followed: see assignment.py."""
    from lassokin_ros.pipeline.people.multi_person import MultiPersonTracker

    return MultiPersonTracker(bodies, counts)
