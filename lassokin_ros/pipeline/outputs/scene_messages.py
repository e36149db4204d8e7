"""The messages about the whole image: ~/people, ~/skeletons, ~/state, and the cameras on ~/markers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.observation import HERE, CameraPose, Status
from lassokin_ros.pipeline.frame_result import BODY_FROM_ROOT, FrameResult
from lassokin_ros.pipeline.image_sets import LONGEST_LATE_NS
from lassokin_ros.pipeline.people.out_of_view import Absent
from lassokin_ros.pipeline.people.roster import Presence
from lassokin_ros.pipeline.session import Session
from msg_adapters.backends import Backend
from msg_adapters.output_messages.clouds import JointsReport
from msg_adapters.output_messages.markers import CameraMarkersBuilder
from msg_adapters.output_messages.people import PersonReport, number_of, people_builder

Image = tuple[int, str]
"""Stamp in ns and frame_id of an image."""
WALKING_M_S = 0.7
"""m/s: growth of the standard deviation of the place of a person who is lost. Twice of it is the speed of a walk."""
SINGLE_PERSON = "p1"
"""Id in the message if one person is followed."""


class PeopleMessages:
    """Stores the newest result of each person, and makes the messages.

    A person is `tracking` for `lost_after` s after the last accepted frame, then `lost`. A person who was not seen for
    `forget_after` s, or is not among the people present, is left out, unless they may be out of view.
    """

    def __init__(
        self, backend: Backend, message_type: str, serialised: bool = False, several_cameras: bool = False
    ) -> None:
        """message_type: parameter people_type, long form. The package of the type must be installed.

        serialised: return serialised messages where that is faster. several_cameras: images come late, and a message
        has the stamp of the newest person in it.
        """
        self._late_ns = LONGEST_LATE_NS if several_cameras else 0
        self._builder = people_builder(backend, message_type, serialised)
        self._newest: dict[str, tuple[FrameResult, CameraPose]] = {}  # and how the frame has moved since then
        self._jump_ns = 0

    def update(
        self, frames: Sequence[FrameResult], ids: Sequence[str] | None, jump: tuple[int, CameraPose] | None = None
    ) -> None:
        """Store accepted results. ids: of the people present, None if one person is followed.

        jump: see `PoseJumps.newest`; people without a result since then are moved with the frame.
        """
        jump_ns, moved = jump or (0, HERE)
        if jump_ns != self._jump_ns:
            self._jump_ns = jump_ns
            self._newest = {person: (frame, moved.after(before)) for person, (frame, before) in self._newest.items()}
        for frame in frames:
            if frame.accepted:
                self._newest[frame.person] = frame, moved if frame.stamp_ns < jump_ns else HERE
        if ids is not None:
            self._newest = {person: known for person, known in self._newest.items() if person in ids}

    def forget(self) -> None:
        """Forget all people."""
        self._newest.clear()

    def build(
        self,
        image: Image,
        lost_after: float,
        forget_after: float,
        untracked: int = 0,
        locked: str | None = None,
        absent: Sequence[Absent] = (),
    ) -> Any:
        """Return the message.

        image: stamp in ns and frame_id of the keypoints; lost_after, forget_after: s. untracked: number of people who
        are in the image and not tracked. locked: id of the locked person. absent: see `Session.absent_at`; those who
        were not seen for forget_after come last.
        """
        stamp_ns, frame_id = image
        if "" in self._newest and self._newest[""][0].stamp_ns > stamp_ns:  # the stamps have jumped back
            self.forget()
        here = [(frame, moved) for frame, moved in self._newest.values() if frame.frame_id == frame_id]
        others_ns = (frame.stamp_ns for frame, _ in here if frame.stamp_ns < stamp_ns + self._late_ns)
        stamp_ns = max([stamp_ns, *others_ns])
        listed: dict[str, PersonReport] = {}
        for frame, moved in here:
            age_s, person = (stamp_ns - frame.stamp_ns) * 1e-9, id_of(frame)
            if 0 <= age_s <= max(forget_after, lost_after):
                age_s += 0.0 if frame.estimate is None else frame.estimate.repeated
                listed[person] = person_report(frame, age_s <= lost_after, age_s, person == locked, moved)
        for one in absent:
            person, age_s = id_of(one.frame), (image[0] - one.frame.stamp_ns) * 1e-9
            if one.frame.frame_id == frame_id and age_s > lost_after:
                known = listed.get(person) or person_report(one.frame, False, age_s, person == locked, one.moved)
                listed[person] = replace(known, out_of_view=one.out_of_view and not known.tracked)
        return self._builder.fill(stamp_ns, frame_id, list(listed.values()), untracked)


def id_of(frame: FrameResult) -> str:
    """Return the id of a frame's person in the messages about all people."""
    return frame.label or frame.person or SINGLE_PERSON


def person_report(
    frame: FrameResult, tracked: bool, age_s: float = 0.0, locked: bool = False, moved: CameraPose = HERE
) -> PersonReport:
    """Return the report on the person of an accepted frame, whose keypoints are `age_s` older than the message.

    moved: what was at x is at `into_camera(x)` of it now.
    """
    estimate = frame.estimate
    assert estimate is not None and estimate.pose is not None and frame.velocity is not None
    positions, quaternion, velocity = estimate.pose.positions, frame.quaternions[-1], frame.velocity
    assert frame.velocity_covariance is not None
    of_velocity = frame.velocity_covariance
    covariance = frame.uncertainty.absolute.pelvis
    if not tracked:
        covariance = covariance.copy()
        covariance[[0, 1, 2], [0, 1, 2]] += (WALKING_M_S * age_s) ** 2
    if moved is not HERE:
        turn = np.kron(np.eye(2), moved.rotation)
        positions, velocity = moved.into_camera(positions), moved.rotation @ velocity
        covariance = turn @ covariance @ turn.T
        of_velocity = moved.rotation @ of_velocity @ moved.rotation.T
        (quaternion,) = to_quaternion(moved.rotation @ estimate.pose.orientations[:1] @ BODY_FROM_ROOT)
    return PersonReport(
        id=id_of(frame),
        tracked=tracked,
        confidence=confidence(frame) if tracked else 0.0,
        position=positions[0],
        quaternion=quaternion,
        velocity=velocity,
        velocity_covariance=of_velocity,
        covariance=covariance,
        joints=positions,
        age=age_s,
        detector_id=frame.detector_id,
        guessed=frame.guessed,
        doubtful=bool(frame.doubtful),
        locked=locked,
    )


def confidence(frame: FrameResult) -> float:
    """Return the probability that the pose is right, 0 to 1; 0 if it is unknown."""
    wrong = frame.likely_wrong
    return 1.0 - wrong if math.isfinite(wrong) else 0.0


def joints_report(frame: FrameResult) -> JointsReport:
    """Return what ~/skeleton and ~/skeletons say about the person of an accepted frame."""
    assert frame.estimate is not None and frame.estimate.pose is not None
    still, up = frame.estimate.still, frame.estimate.up
    assert still is not None and up is not None
    return JointsReport(
        number_of(id_of(frame)),
        frame.estimate.pose.positions,
        frame.joint_velocities,
        frame.uncertainty.absolute.joints,
        frame.observed,
        frame.contacts,
        still,
        frame.uncertainty.rotation_deviation,
        frame.uncertainty.deviation,
        frame.quaternions[:-1],
        up,
    )


MARKERS_EVERY_S = 0.2
"""s between two messages; markers disappear after 1 s without one."""

UNKNOWN_HALF = 0.5
"""Tangent of half the field of view of a camera whose camera_info has no image size."""


class CameraMarkers:
    """Makes a message of all cameras whose place is known."""

    def __init__(self, backend: Backend, session: Session) -> None:
        self._session, self._builder = session, CameraMarkersBuilder(backend)
        self._last = -math.inf

    def build(self, stamp_ns: int, now: float) -> Any | None:
        """Return the message; None if no place is known, or MARKERS_EVERY_S has not passed. now: s of any clock."""
        places = self._session.placement.places
        if places is None or now - self._last < MARKERS_EVERY_S:
            return None
        extrinsics = self._session.roster.extrinsics
        found = {}
        for name, pose in places.newest.items():
            view = self._session.cameras[name].camera.view
            if view is None or name in places.faults:
                continue
            pose = pose if extrinsics is None else extrinsics.corrected(pose)
            if not pose.known:
                continue
            half = 0.5 * np.array(view.size) / view.lens.focal
            quaternion = to_quaternion(pose.rotation.T[None])[0]
            found[name] = pose.centre, quaternion, np.where(half > 0, half, UNKNOWN_HALF)
        if not found:
            return None
        self._last = now
        return self._builder.fill(stamp_ns, places.base, found)


TRACKING, LOST, NOBODY = "tracking", "lost", "nobody"


class PresenceState:
    """Derives the state from the presence of people, and detects its changes.

    tracking: somebody was tracked less than `lost_after` ago. nobody: the images of the last `stale_after` show nobody.
    lost: otherwise, that is, the last frame of a person is less than `forget_after` ago, or no usable keypoints arrive,
    so that somebody may be there.
    """

    def __init__(self) -> None:
        self.value = LOST
        """The present state."""
        self._lost_ns: int | None = None

    def update(
        self, presence: Presence, now_ns: int, lost_after: float, forget_after: float, informed: bool = True
    ) -> bool:
        """Return True if the state has changed. now_ns: ns of the clock of arrivals; lost_after, forget_after: s.

        informed: see `Session.scene_known_empty`.
        """
        before, state = self.value, self._state(presence, now_ns, forget_after - lost_after)
        self.value = LOST if state == NOBODY and not informed else state
        return self.value != before

    def _state(self, presence: Presence, now_ns: int, patience_s: float) -> str:
        if presence.status is Status.TRACKING:
            return TRACKING
        if presence.status is Status.SEARCHING or presence.ids == []:
            return NOBODY
        if presence.ids is not None:  # several people: those present are not yet forgotten
            return LOST
        if self.value == TRACKING:
            self._lost_ns = now_ns
        remembered = self._lost_ns is not None and (now_ns - self._lost_ns) * 1e-9 < patience_s
        if not remembered:
            self._lost_ns = None
        return LOST if remembered else NOBODY
