"""Several people with one keypoint topic each (REP-155): one session per person, with the ids of the detector.

config = NodeSettings(rep155=True, max_people=4, keypoints_type="hri_msgs/Skeleton2D")
session = PerBodySession(TrackerConfig(), config)
session.keep(["abcde"])                                     # ids of the people present
frames = session.frames_of("abcde", skeleton2d, arrival_ns)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.core.observation import Status
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.answers import Answer, frames_of
from lassokin_ros.pipeline.camera.placement import JUMPS
from lassokin_ros.pipeline.camera.pose_jumps import PoseJumps
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.people.choice import NoPersonError
from lassokin_ros.pipeline.people.tracked_person import Presence, best
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings


class PerBodySession(Session):
    """One single-person session per person. They are created at the start, reused, and share camera and counts.

    Each person has a separate topic, so that each session checks its own order of stamps.
    """

    def __init__(
        self, tracker_config: TrackerConfig, node_config: NodeSettings, evidence: Sequence[Evidence] = ()
    ) -> None:
        """evidence: see `Session`. Raises a LassokinError if the configuration is unusable."""
        super().__init__(tracker_config, _for_one(node_config), evidence)
        self._idle = [Session(tracker_config, self.config, evidence) for _ in range(node_config.max_people)]
        for session in self._idle:
            mine, shared = session.first, self.first
            session.counts = mine.counts = self.counts
            mine.camera, mine.depth, mine.depth_check = shared.camera, shared.depth, shared.depth_check
            session.placement.places = self.placement.places
            session.placement.counts = self.counts
        self._all = tuple(self._idle)
        self._present: dict[str, Session] = {}
        self._beyond = 0  # bodies of the list that have no tracker
        self.config = node_config.checked()

    @property
    def ids(self) -> list[str]:
        """Ids of the people present."""
        return list(self._present)

    @property
    def status(self) -> Status:
        """The best status among the people."""
        return best(session.status for session in self._present.values())

    def presence_at(self, now_ns: int) -> Presence:
        """As Session.presence_at. The detector's list alone decides who is present."""
        return Presence(best(p.presence_at(now_ns).status for p in self._present.values()), self.ids)

    @property
    def locked(self) -> str | None:
        """None: with one topic per body the detector decides who is who, and nobody is locked."""
        return None

    def lock(self, now_ns: int) -> str:
        """Raise NoPersonError."""
        raise NoPersonError("lock failed: each person has a topic of keypoints, and the detector says who is who")

    def scene_known_empty(self, now_ns: int) -> bool:
        """As Session.scene_known_empty. The detector's list says who is there; each listed body needs keypoints."""
        if not (self.enabled and self.inputs.has_camera and self.detector_connected):
            return False
        return all(session.scene_known_empty(now_ns) for session in self._present.values())

    def set_clock_back(self, step_ns: int) -> None:
        """See Session.set_clock_back."""
        for session in self._all:
            session.set_clock_back(step_ns)

    def untracked_at(self, stamp_ns: int) -> int:
        """As Session.untracked_at: the bodies of the detector's list that were never tracked."""
        return self._beyond + sum(session.status is Status.SEARCHING for session in self._present.values())

    def image_at(self, now_ns: int) -> tuple[int, str]:
        """As Session.image_at, of the newest message of all bodies."""
        images = [session.image_at(now_ns) for session in self._present.values() if session.scene.image is not None]
        return max(images, default=super().image_at(now_ns))

    @property
    def trackers(self) -> dict[str, Tracker]:
        """The tracker of each person by id."""
        return {person: session.tracker for person, session in self._present.items()}

    @property
    def evidence_faults(self) -> dict[str, str]:
        """See Session.evidence_faults."""
        return {name: fault for one in self._all for name, fault in one.evidence_faults.items()}

    def keep(self, ids: Sequence[str]) -> None:
        """Set the ids of the people present. The others are forgotten. Of too many people the first ones are kept."""
        for person in [person for person in self._present if person not in ids]:
            session = self._present.pop(person)
            with self._uncounted_resets():
                session.forget_people()  # the depth images are also those of the others
            self._idle.append(session)
            self.counts["people left"] += 1
        self._beyond = 0
        for person in [person for person in dict.fromkeys(ids) if person not in self._present]:
            if not self._idle:
                self._beyond += 1
                self.counts["people beyond max_people"] += 1
                continue
            newcomer = self._idle.pop()
            newcomer.tracker.adopt_vertical(known.tracker for known in self._present.values())
            self._present[person] = newcomer
            self.counts["people come"] += 1

    def frames_of(self, person: str, message: Any, arrival_ns: int) -> list[FrameResult]:
        """Return the results of `push_of`."""
        return frames_of(self.push_of(person, message, arrival_ns))

    def push_of(self, person: str, message: Any, arrival_ns: int) -> list[Answer]:
        """Track one person's message, see `Session.push`. Return no answer if the person is not present."""
        session = self._present.get(person)
        if session is None:
            return []
        session.enabled, jumps, before = self.enabled, self.counts[JUMPS], session.scene.image
        answers = session.push(message, arrival_ns, self.first.name)
        if self.counts[JUMPS] > jumps:
            self._note_jump(session.placement.jumps, None if before is None else before[0])
        self.answered = self.answered or session.answered
        mine, theirs = self.first, session.first
        self.scene.image, mine.frame_id = session.scene.image, theirs.frame_id
        mine.nobody_in_view, mine.unused_confidence = theirs.nobody_in_view, theirs.unused_confidence
        mine.stamp_rate, mine.own_depth, mine.landmark_ids = theirs.stamp_rate, theirs.own_depth, theirs.landmark_ids
        return [
            replace(answer, frames=[replace(frame, person=person, label=person) for frame in answer.frames])
            for answer in answers
        ]

    def _note_jump(self, jumps: PoseJumps, before_ns: int | None) -> None:
        """Keep a jump that a person's image shows, unless it is the one that images of others have shown already.

        before_ns: stamp, ns, of the person's image before; the person may have been out of view meanwhile.
        """
        mine = self.placement.jumps
        if before_ns is not None and mine.newest is not None and before_ns < mine.newest[0]:
            return
        mine.newest, mine.words = jumps.newest, jumps.words

    def reset(self, unlock: bool = True) -> None:
        """Forget the state of all people. The list of people, the camera and the counts stay."""
        with self._uncounted_resets():
            for session in self._all:
                session.reset(unlock)
        self.scene.image = None
        self.placement.jumps.reset()
        self.counts["resets"] += 1

    def tune(self, tracker_config: TrackerConfig, node_config: NodeSettings) -> None:
        """Apply settings that can change while running, see Session.tune."""
        with self._uncounted_resets():
            for session in self._all:
                session.tune(tracker_config, _for_one(node_config))
        super().tune(tracker_config, node_config)

    @contextmanager
    def _uncounted_resets(self) -> Iterator[None]:
        resets = self.counts["resets"]
        yield
        self.counts["resets"] = resets


def _for_one(config: NodeSettings) -> NodeSettings:
    return replace(config, max_people=1, rep155=False, lock=False)
