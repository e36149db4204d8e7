"""From a keypoint message to an estimate: what the node and the replay share, so that both give the same bytes.

pipeline = Pipeline(TrackerConfig(), NodeConfig())
pipeline.set_camera(camera_info)
frame = pipeline.process(keypoints, arrival_ns)      # Frame: accepted, or rejected with a reason
frames = pipeline.frames(keypoints, arrival_ns)      # the same for one person or several: a Frame for each
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lassokin_ros.body import Body, Detection
from lassokin_ros.camera import Camera, View
from lassokin_ros.core.calibration import Calibration
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Status
from lassokin_ros.frame import Frame, repeated_s
from lassokin_ros.lens import Lens
from lassokin_ros.matching import distances, reach, usable
from lassokin_ros.node_config import MESSAGE, NodeConfig
from lassokin_ros.presence import Presence
from lassokin_ros.skeleton_readers.load import load_skeleton
from lassokin_ros.stamps import StampWatch
from lassokin_ros.urdf import check_names
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints
from msg_adapters.registry import keypoint_adapter

if TYPE_CHECKING:
    from lassokin_ros.people import People

PERSON_ABSENT = "person_absent"
"""The reason against a message that has people, but not the one who is followed."""

MOST_PEOPLE = 100
"""People in one message; more are refused before time is spent on them."""


class Pipeline:
    """Decodes, undistorts, tracks and reads joint angles; its methods never raise for what a message may hold."""

    def __init__(self, tracker_config: TrackerConfig, node_config: NodeConfig) -> None:
        """Raises a LassokinError when the configuration cannot be used."""
        self.config = node_config.checked()
        skeleton = load_skeleton(tracker_config.checked().skeleton, tracker_config.height)
        check_names(skeleton)
        bodies = [Body(tracker_config, skeleton) for _ in range(self.config.max_people)]
        self._bodies, self._body = bodies, bodies[0]
        self.tracker = bodies[0].tracker
        self.enabled = True
        """While False, keypoints are counted and not looked at."""
        self.counts: Counter[str] = Counter()
        """Messages by what became of them: received, accepted, duplicated, unstamped, resets, "rejected: <reason>"."""
        self.people = _people(bodies, self.counts) if self.config.several_people else None
        """Who is there, when several people are followed; None when it is one."""
        self._adapter = keypoint_adapter(self.config.keypoints_type)
        self.camera = Camera(self.config.rectified)
        self._stamps = StampWatch()
        self._person: int | None = None
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
        self._person = self._latest = self._seen_from = None
        self.counts["resets"] += 1

    def tune(self, tracker_config: TrackerConfig, node_config: NodeConfig) -> None:
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

    def process(self, message: Any, arrival_ns: int) -> Frame:
        """Track the one person in a keypoint message, without `smoothing_lag`; arrival_ns stamps what has no stamp."""
        (frame,) = self.frames(message, arrival_ns)
        return frame

    def frames(self, message: Any, arrival_ns: int) -> list[Frame]:
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

    def _frames(self, message: Any, arrival_ns: int) -> list[Frame]:
        stamp_ns, frame_id = arrival_ns, ""
        try:
            keypoints, view = self._decode(message)
            frame_id = keypoints.frame_id or view.intrinsics.frame_id
            if keypoints.stamp_ns is None:
                self.counts["unstamped"] += 1
            else:
                stamp_ns = keypoints.stamp_ns
            if self._stamps.check(stamp_ns, arrival_ns, self.config.jump_back):
                self._go_back(keypoints, stamp_ns, view.lens)
            self._see_from(view.intrinsics.frame_id)
            if self.people is None:
                seen = self._the_person(keypoints, stamp_ns, view.lens)
                self._latest = stamp_ns, arrival_ns
                frames = self._body.track(stamp_ns, frame_id, seen, view.lens)
                if all(frame.accepted for frame in frames):
                    self._stamps.seen(stamp_ns, True)
                elif others := self._others(keypoints, seen):
                    frames[-1] = replace(frames[-1], rejection=PERSON_ABSENT, detail=self._absence(others, keypoints))
                return frames
            everybody = self._everybody(keypoints, view.lens)
        except AdapterError as error:
            return [Frame(stamp_ns, frame_id, None, error.reason, str(error))]
        self._latest = stamp_ns, arrival_ns
        lasting = self._lasting(keypoints)
        frames = self.people.update(stamp_ns, frame_id, everybody, view.lens, lasting, self.config.forget_after)
        self._stamps.seen(stamp_ns, self.people.tracked_at(stamp_ns))
        return frames

    def flush(self) -> list[Frame]:
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

    def _go_back(self, keypoints: Keypoints, stamp_ns: int, lens: Lens) -> None:
        """Forget everybody for a message from an earlier time; AdapterError for one that is of no use in any time."""
        if not any(usable(seen, self.tracker.config) for seen in self._everybody(keypoints, lens)):
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

    def _detection(self, keypoints: Keypoints, person: int | None, lens: Lens) -> Detection:
        pixels, confidence = keypoints.as_landmarks(self.tracker.kinematics.landmark_count, person)
        return Detection(lens.normalise(pixels), confidence, person or 0, pixels)

    def _everybody(self, keypoints: Keypoints, lens: Lens) -> list[Detection]:
        """One detection for each person in the message."""
        numbers, pixels, confidence = keypoints.everybody(self.tracker.kinematics.landmark_count)
        if len(numbers) > MOST_PEOPLE:
            raise AdapterError("too_many_people", f"{len(numbers)} people; expected at most {MOST_PEOPLE}")
        points = lens.normalise(pixels.reshape(-1, 2)).reshape(pixels.shape)
        return [Detection(points[i], confidence[i], number, pixels[i]) for i, number in enumerate(numbers.tolist())]

    def _the_person(self, keypoints: Keypoints, stamp_ns: int, lens: Lens) -> Detection:
        """The one who is followed until lost; first, and then anew, one who is chosen."""
        if keypoints.persons is None or len(keypoints.persons) == 0:
            return self._detection(keypoints, None, lens)
        if self.status is Status.TRACKING:
            seen = self._followed(keypoints, stamp_ns, lens)
            # A silent detector tells nobody that the person is lost: the first stamp after it does.
            lost = self._body.status_at(stamp_ns) is Status.LOST and not usable(seen, self.tracker.config)
            if not lost:
                return seen
        return self._chosen(keypoints, lens)

    def _followed(self, keypoints: Keypoints, stamp_ns: int, lens: Lens) -> Detection:
        """The person who is tracked: by their number where it lasts, else by their place."""
        if not self._lasting(keypoints):
            return self._nearest(self._everybody(keypoints, lens), stamp_ns)
        if self._person is None:
            return self._chosen(keypoints, lens)
        return self._detection(keypoints, self._person, lens)

    def _others(self, keypoints: Keypoints, seen: Detection) -> int:
        """How many people are in a message in which nothing of the one who is followed was seen."""
        if keypoints.persons is None or np.isfinite(seen.points).any():
            return 0
        with np.errstate(invalid="ignore"):
            confident = keypoints.confidence >= max(self.tracker.config.min_confidence, 1e-9)
        return len(np.unique(keypoints.persons[confident & np.isfinite(keypoints.xy).all(axis=1)]))

    def _absence(self, others: int, keypoints: Keypoints) -> str:
        """Such a message in words: to say that there were no landmarks would send people after their confidences."""
        waits = f"; another is followed after lost_after {self.tracker.config.lost_after:g} s"
        if not self._lasting(keypoints):
            return f"nobody of {others} in the message is near where the one who is followed was going{waits}"
        return (
            f"person {self._person}, who is followed, is not in the message, which has {others} other(s){waits}. Do "
            "numbers change from image to image? Then set person_ids to node"
        )

    def _chosen(self, keypoints: Keypoints, lens: Lens) -> Detection:
        """The one seen with the highest confidence in all, of those who can be tracked if there are any."""
        assert keypoints.persons is not None
        people, index = np.unique(keypoints.persons, return_inverse=True)
        scores = np.clip(np.nan_to_num(keypoints.confidence, posinf=0.0), 0.0, 1.0)
        best_first = people[np.argsort(-np.bincount(index, scores), kind="stable")][:MOST_PEOPLE]
        detections = (self._detection(keypoints, int(person), lens) for person in best_first)
        best = next(detections)
        config = self.tracker.config
        chosen = best if usable(best, config) else next((d for d in detections if usable(d, config)), best)
        self._person = chosen.number
        return chosen

    def _nearest(self, everybody: list[Detection], stamp_ns: int) -> Detection:
        """The detection nearest to where the person is expected; an empty one when none is near."""
        expected, body = self._body.expected(stamp_ns), self._body
        assert expected is not None
        apart = distances(expected[None], everybody, body.tracker.config.min_confidence)[0]
        best = int(np.argmin(apart))
        if apart[best] <= reach(body.unseen_s(stamp_ns)):
            return everybody[best]
        return Detection(np.full_like(expected, np.nan), np.zeros(len(expected)))


def _people(bodies: list[Body], counts: Counter[str]) -> People:
    """Imported when several people are followed: see assignment.py."""
    from lassokin_ros.people import People

    return People(bodies, counts)
