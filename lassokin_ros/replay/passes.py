"""A recording in several passes, for one person or several, one camera or several, from a bag or from videos.

The first pass learns the people's lengths and the places of cameras that nobody tells. The second goes backward in
time, with each person alone. The last one goes forward, with the lengths from its first frame on, and publishes poses
between both tracks; see `lassokin_ros.core.recording`. Who is who is decided once, in the first pass.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from lassokin_ros.common.array_spool import ArraySpool, Record
from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import GIVEN, TrackerConfig
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.output.smoothing import Backward
from lassokin_ros.core.recording import track_backward
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.camera.placement import JUMPS
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.figures import height_in_words
from lassokin_ros.pipeline.outputs.saved_files import LEAST_MOTION
from lassokin_ros.pipeline.seen import key_of
from lassokin_ros.pipeline.session import Session
from lassokin_ros.replay.playback import Playback
from msg_adapters.output_messages.people import number_of

Bodies = Mapping[int | None, Skeleton]
"""Skeletons by the person's number; None if one person is followed."""
Play = Callable[[Playback, str], object]
"""Plays the whole recording; the text names the pass."""


class Make(Protocol):
    """Makes a session for the recording."""

    def __call__(self, config: TrackerConfig, bodies: Bodies | None = None) -> Session:
        """bodies: see `Session`."""
        ...


STILL = 0.01
"""m, and rad: a camera whose pose in TF changes by less stands still."""


class SpooledFrames(Mapping[int, Backward]):
    """Frames by stamp in ns, in a temporary file. Methods raise SpoolError if it cannot be written."""

    def __init__(self) -> None:
        self._spool = ArraySpool()
        self._places: dict[int, Record] = {}

    def add(self, stamp_ns: int, frame: Backward) -> None:
        """Store a frame."""
        arrays = {"rotations": frame.state.rotations, "translation": frame.state.translation}
        self._places[stamp_ns] = self._spool.append({**arrays, "cost": np.array(frame.cost)})

    def __getitem__(self, stamp_ns: int) -> Backward:
        found = self._spool.read(self._places[stamp_ns])
        return Backward(BodyState(found["rotations"], found["translation"]), float(found["cost"]))

    def __iter__(self) -> Iterator[int]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


Instant = tuple[int, list[tuple[str, Record]]]
"""Stamp in ns, and the camera's name and place in the file of each observation of one person."""


class KeptObservations:
    """What the tracker was given of each person, in a temporary file. Methods raise SpoolError if that is full."""

    def __init__(self) -> None:
        self._spool = ArraySpool()
        self._people: dict[int | None, dict[str, list[Instant]]] = {}
        """By number, None if one person is followed: the ids in order; of each the instants at which the person was
        seen under it."""
        self.identities: dict[tuple[str, bytes], int] = {}
        """The number of each of several people by what was seen, see `Session.identities`."""
        self._first_ns = 0
        self._newest_ns: dict[int | None, int] = {}  # of the accepted frames, by number
        self._cameras: dict[str, CameraPose] = {}  # first pose of each, by name
        self._in_order, self._moving, self._alone = True, False, False

    @property
    def numbers(self) -> list[int | None]:
        """The numbers of the people; None alone if one person is followed."""
        return list(self._people)

    @property
    def usable(self) -> bool:
        """False if it cannot be tracked backward.

        Either a stamp was before the last one, as in a recording that was looped. Or several cameras move, and their
        images are of different times, so that nothing here says where the others were.
        """
        return self._in_order and not (self._moving and self._alone and len(self._cameras) > 1)

    def add(self, frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        """Keep the observations of a message; a listener of Playback."""
        for frame in frames:
            number = number_of(frame.person) if frame.person else None
            newest_ns = self._newest_ns.get(number)
            newer = newest_ns is None or frame.stamp_ns > newest_ns
            if frame.accepted:
                self._in_order = self._in_order and newer
                self._newest_ns[number] = frame.stamp_ns
            if number is not None:
                self.identities |= {(one.camera.name, key_of(one.points)): number for one in frame.images}
            if frame.observations and (frame.accepted or newer):  # not one that was refused because it is late
                self._first_ns = self._first_ns or frame.stamp_ns
                self._follow_cameras([one.camera for one in frame.observations if one.camera.known])
                kept = [(one.camera.name, self._spool.append(_arrays(one))) for one in frame.observations]
                instants = self._people.setdefault(number, {}).setdefault(frame.label or frame.person, [])
                instants.append((frame.stamp_ns, kept))

    def _follow_cameras(self, poses: Sequence[CameraPose]) -> None:
        for pose in poses:
            first = self._cameras.setdefault(pose.name, pose)
            turned, moved = np.abs(first.rotation - pose.rotation).max(), math.dist(first.centre, pose.centre)
            self._moving = self._moving or max(turned, moved) > STILL
        self._alone = self._alone or len(poses) == 1

    def track_backward(
        self, number: int | None, tracker: Tracker, placed: Callable[[Sequence[Observation]], list[Observation]]
    ) -> Mapping[int, Backward]:
        """Track a person backward in time, and return the frames by stamp in ns.

        tracker: a new one, with the person's lengths. placed: gives the observations of an instant their cameras.
        """
        frames = SpooledFrames()
        for instants in reversed(self._people[number].values()):
            tracker.reset(same_camera=True)
            seen = (placed(instant) for instant in self._latest_first(instants))
            for stamp, found in track_backward(tracker, (instant for instant in seen if instant)):
                frames.add(self._first_ns + round(1e9 * stamp), found)
        return frames

    def _latest_first(self, instants: Sequence[Instant]) -> Iterator[list[Observation]]:
        """Yield the observations of each instant. Their stamps are in s since the first one."""
        for stamp_ns, kept in sorted(instants, key=lambda instant: instant[0], reverse=True):
            stamp = 1e-9 * (stamp_ns - self._first_ns)
            yield [_observation(stamp, name, self._spool.read(place)) for name, place in kept]


def _arrays(one: Observation) -> dict[str, np.ndarray]:
    """Return what an observation of the session holds, by name."""
    numbers = np.array([one.focal, one.depth_of_surface, one.depth_age])
    arrays = {"points": one.points, "confidence": one.confidence, "numbers": numbers}
    if one.depth is not None:
        arrays["depth"] = one.depth
    if one.camera.known:
        arrays |= {"rotation": one.camera.rotation, "translation": one.camera.translation}
    return arrays


def _observation(stamp: float, name: str, arrays: Mapping[str, np.ndarray]) -> Observation:
    """Return the observation whose `_arrays` these are. name: of the camera."""
    camera, (focal, of_surface, age) = CameraPose(name, known=False), arrays["numbers"].tolist()
    if "rotation" in arrays:
        camera = CameraPose(name, arrays["rotation"], arrays["translation"])
    points, confidence, depth = arrays["points"], arrays["confidence"], arrays.get("depth")
    return Observation(stamp, points, confidence, focal, depth, None, bool(of_surface), age, camera=camera)


@dataclass(frozen=True, eq=False)
class Known:
    """What the last pass uses.

    bodies: with learned lengths, of those who moved for LEAST_MOTION; without a given height also of the others, as
    tall as the first pass has measured or assumed. backward: frames of each person by stamp, ns; none if the recording
    cannot be tracked backward. heights: as the first pass measured them, in words, by id; none if they were given.
    first: the session of the first pass. identities: see `Session.identities`.
    """

    config: TrackerConfig
    bodies: Bodies
    backward: Mapping[int | None, Mapping[int, Backward]]
    heights: Mapping[str, str]
    first: Session
    identities: Mapping[tuple[str, bytes], int] | None

    def session(self, make: Make) -> Session:
        """Return the session of the last pass."""
        session = make(self.config, self.bodies)
        session.tracker.learned.extrinsics.adopt(self.first.tracker.learned.extrinsics)
        session.use_backward(self.backward)
        session.identities = self.identities
        return session


def learn(make: Make, play: Play, config: TrackerConfig) -> Known:
    """Make the first two passes. Nothing is known of people who moved for less than LEAST_MOTION but their height."""
    session = make(config)
    first, kept = Playback(session), KeptObservations()
    bodies, heights = dict[int | None, Skeleton](), dict[str, str]()

    def keep_bodies(frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        """Keep the newest body of each person: a tracker forgets it when the person leaves."""
        trackers = session.roster.trackers
        for person in sorted({frame.person for frame in frames if frame.accepted} & trackers.keys()):
            tracker = trackers[person]
            height, body = tracker.learned.height, tracker.skeleton
            if tracker.learned.lengths.kept_motion < LEAST_MOTION:
                if height is None:
                    continue
                body = tracker.given_skeleton.at_height(body.height)
            bodies[number_of(person) if person else None] = body
            if height is not None:
                heights[person] = height_in_words(height)

    first.listeners += [kept.add, keep_bodies]
    play(first, "first pass")
    backward = _backward(kept, make, session, config, bodies)
    identities = kept.identities if session.config.several_people else None
    return Known(config, bodies, backward, heights, session, identities)


def _backward(
    kept: KeptObservations, make: Make, session: Session, config: TrackerConfig, bodies: Bodies
) -> dict[int | None, Mapping[int, Backward]]:
    """Return the frames backward in time, of each person; none if the fixed frame's motion is not in what was kept."""
    if session.counts[JUMPS] or not kept.usable:
        return {}
    extrinsics = session.roster.extrinsics

    def placed(observations: Sequence[Observation]) -> list[Observation]:
        """At the places of the cameras as they were known at the end."""
        if extrinsics is not None:
            observations = [replace(one, camera=extrinsics.corrected(one.camera)) for one in observations]
        return [one for one in observations if one.camera.known]

    found: dict[int | None, Mapping[int, Backward]] = {}
    for number in kept.numbers:
        if number not in bodies and config.height == 0:
            continue  # never tracked; each track would have another height
        body = {number: bodies[number]} if number in bodies else {}
        tracker = make(replace(config, extrinsics=GIVEN), body).tracker
        tracker.floor_below = session.tracker.floor_below
        found[number] = kept.track_backward(number, tracker, placed)
    return found
