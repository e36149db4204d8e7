"""A recording in several passes, for one person or several, one camera or several, from a bag or from videos.

The first pass learns the people's lengths and the places of cameras that nobody tells. The second goes backward in
time, with each person alone. The last one goes forward, with the lengths from its first frame on, and publishes poses
between both tracks; see `lassokin_ros.core.recording`. Who is who is decided once, in the first pass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import GIVEN, TrackerConfig
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.output.smoothing import Backward
from lassokin_ros.pipeline.camera.placement import JUMPS
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.description.skeleton_file import LEAST_MOTION
from lassokin_ros.pipeline.outputs.status.calibration_status import height_in_words
from lassokin_ros.pipeline.session import Session
from lassokin_ros.replay.passes.kept_observations import KeptObservations
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
        if (extrinsics := session.tracker.learned.extrinsics) is not None:
            extrinsics.adopt(self.first.tracker.learned.extrinsics)
        session.use_backward(self.backward)
        session.identities = self.identities
        return session


class _Learned:
    """The newest body of each person: a tracker forgets it when the person leaves. heights: see `Known`."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.bodies: dict[int | None, Skeleton] = {}
        self.heights: dict[str, str] = {}

    def add(self, frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        """Keep those of the people in the frames; a listener of Playback."""
        for person in sorted({frame.person for frame in frames if frame.accepted} & self._session.trackers.keys()):
            tracker = self._session.trackers[person]
            height, body = tracker.learned.height, tracker.skeleton
            if tracker.learned.lengths.kept_motion < LEAST_MOTION:
                if height is None:
                    continue
                body = tracker.given_skeleton.at_height(body.height)
            self.bodies[number_of(person) if person else None] = body
            if height is not None:
                self.heights[person] = height_in_words(height)


def learn(make: Make, play: Play, config: TrackerConfig) -> Known:
    """Make the first two passes. Nothing is known of people who moved for less than LEAST_MOTION but their height."""
    session = make(config)
    first, learned, kept = Playback(session), _Learned(session), KeptObservations()
    first.listeners += [kept.add, learned.add]
    play(first, "first pass")
    backward = _backward(kept, make, session, config, learned.bodies)
    identities = kept.identities if session.config.several_people else None
    return Known(config, learned.bodies, backward, learned.heights, session, identities)


def _backward(
    kept: KeptObservations, make: Make, session: Session, config: TrackerConfig, bodies: Bodies
) -> dict[int | None, Mapping[int, Backward]]:
    """The frames backward in time, of each person.

    None if the motion of the fixed frame is not in the observations.
    """
    if session.counts[JUMPS] or not kept.usable:
        return {}
    extrinsics = session.extrinsics

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
