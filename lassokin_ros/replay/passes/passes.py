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
from lassokin_ros.core.output.fixed_lag import Backward
from lassokin_ros.pipeline.camera.placement import JUMPS
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.description.skeleton_file import LEAST_MOTION
from lassokin_ros.pipeline.outputs.status.calibration_status import height_in_words
from lassokin_ros.pipeline.pipeline import Pipeline
from lassokin_ros.replay.passes.kept_observations import KeptObservations
from lassokin_ros.replay.playback import Playback
from msg_adapters.output_messages.people import number_of

Bodies = Mapping[int | None, Skeleton]
"""Skeletons by the person's number; None if one person is followed."""
Play = Callable[[Playback, str], None]
"""Plays the whole recording; the text names the pass."""


class Make(Protocol):
    """Makes a session for the recording."""

    def __call__(self, config: TrackerConfig, bodies: Bodies | None = None) -> Pipeline:
        """bodies: see `Pipeline`."""
        ...


@dataclass(frozen=True, eq=False)
class Known:
    """What the last pass uses.

    config: with the height of the only person. bodies: with learned lengths, of those who moved for LEAST_MOTION.
    backward: frames of each person by stamp, ns; none if the recording cannot be tracked backward. height: as the first
    pass measured it, in words; empty if `bodies` do not have it. first: the session of the first pass.
    """

    config: TrackerConfig
    bodies: Bodies
    backward: Mapping[int | None, Mapping[int, Backward]]
    height: str
    first: Pipeline
    identities: Mapping[tuple[str, bytes], int] | None

    def session(self, make: Make) -> Pipeline:
        """Return the session of the last pass."""
        pipeline = make(self.config, self.bodies)
        pipeline.tracker.adopt_cameras(self.first.tracker)
        pipeline.use_backward(self.backward)
        pipeline.identities = self.identities
        return pipeline


class _Learned:
    """The newest lengths of each person: a tracker forgets them when the person leaves."""

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self.bodies: dict[int | None, Skeleton] = {}

    def add(self, frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        """Keep those of the people in the frames; a listener of Playback."""
        trackers = self._pipeline.trackers
        for frame in frames:
            tracker = trackers.get(frame.person)
            if frame.accepted and tracker is not None and tracker.learned.lengths.kept_motion >= LEAST_MOTION:
                self.bodies[number_of(frame.person) if frame.person else None] = tracker.skeleton


def learn(make: Make, play: Play, config: TrackerConfig) -> Known:
    """Make the first two passes. Nothing is known of people who moved for less than LEAST_MOTION."""
    pipeline = make(config)
    first, learned, kept = Playback(pipeline), _Learned(pipeline), KeptObservations()
    first.listeners += [kept.add, learned.add]
    play(first, "first pass")
    several, bodies = pipeline.config.several_people, learned.bodies
    if not several and None in bodies:
        bodies = {None: pipeline.tracker.skeleton}  # with what was learned from the last frame
        config = replace(config, height=float(pipeline.tracker.skeleton.height))
    heights = "" if several or not bodies else "".join(map(height_in_words, pipeline.heights().values()))
    backward = _backward(kept, make, pipeline, config, bodies)
    return Known(config, bodies, backward, heights, pipeline, kept.identities if several else None)


def _backward(
    kept: KeptObservations, make: Make, pipeline: Pipeline, config: TrackerConfig, bodies: Bodies
) -> dict[int | None, Mapping[int, Backward]]:
    """The frames backward in time, of each person.

    None if the motion of the mount or the fixed frame is not in the observations, or if the height is not known yet:
    each track would have its own.
    """
    if pipeline.mount is not None or pipeline.counts[JUMPS] or config.height == 0 or not kept.usable:
        return {}
    extrinsics = pipeline.extrinsics

    def placed(observations: Sequence[Observation]) -> list[Observation]:
        """At the places of the cameras as they were known at the end."""
        if extrinsics is not None:
            observations = [replace(one, camera=extrinsics.corrected(one.camera)) for one in observations]
        return [one for one in observations if one.camera.known]

    found: dict[int | None, Mapping[int, Backward]] = {}
    for number in kept.numbers:
        body = {number: bodies[number]} if number in bodies else {}
        tracker = make(replace(config, extrinsics=GIVEN), body).tracker
        tracker.floor_below = pipeline.tracker.floor_below
        found[number] = kept.track_backward(number, tracker, placed)
    return found
