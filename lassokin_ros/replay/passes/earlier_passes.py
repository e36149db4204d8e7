"""The first two of three passes over a recording: the person's lengths, and a track backward in time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lassokin_ros.core.config import GIVEN, TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.output.fixed_lag import Backward
from lassokin_ros.pipeline.outputs.description.skeleton_file import LEAST_MOTION, save_all
from lassokin_ros.pipeline.outputs.status.calibration_status import height_in_words
from lassokin_ros.pipeline.pipeline import JUMPS, Pipeline
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.passes.kept_observations import KeptObservations
from lassokin_ros.replay.playback import Playback

Inputs = Mapping[str, Callable[[Any, int], None]]
"""By the topic's name, what processes its messages."""


@dataclass(frozen=True)
class KnownPerson:
    """What the last pass uses.

    config: with the lengths. backward: frames by stamp in ns, see `TrackedPerson.use_backward`; none if the recording
    cannot be tracked backward. height: as the first pass measured it, in words; empty if `config` does not have it.
    """

    config: TrackerConfig
    backward: Mapping[int, Backward]
    height: str = ""


def check_two_passes(tracker: TrackerConfig, node: NodeSettings) -> None:
    """Raise ConfigurationError if several passes make no sense with these settings."""
    if node.several_people:
        raise ConfigurationError("--two-pass is for one person; expected max_people 1 and rep155 false")
    if not tracker.calibrate:
        raise ConfigurationError("--two-pass needs calibration; add -p calibrate:=true")


def learn_person(
    messages: Iterator[tuple[str, int, Any]], inputs: Inputs, tracker: Playback, config: TrackerConfig, folder: Path
) -> KnownPerson:
    """Track all messages (topic, recording time in ns, message), and then their observations backward in time.

    tracker: a Playback that is used for this alone. The lengths are written to a file in `folder`. The settings
    are unchanged if the person moved for less than LEAST_MOTION.
    """
    kept = KeptObservations()
    tracker.listeners.append(kept.add)
    for topic, time_ns, message in messages:
        inputs[topic](message, time_ns)
    tracker.finish()
    calibrations = tracker.pipeline.calibrations()
    (calibration,) = calibrations.values()
    height = ""
    if calibration.kept_motion >= LEAST_MOTION:
        path = folder / "skeleton.yaml"
        save_all(calibrations, path, tracker.newest_ns)
        config = replace(config, skeleton=str(path), height=float(calibration.skeleton.height))
        height = "".join(map(height_in_words, tracker.pipeline.heights().values()))
    return KnownPerson(config, _backward(kept, tracker.pipeline, config), height)


def _backward(kept: KeptObservations, pipeline: Pipeline, config: TrackerConfig) -> Mapping[int, Backward]:
    """The frames backward in time.

    None if the motion of the mount or the fixed frame is not in the observations, or if the height is not known yet:
    each track would have its own.
    """
    if pipeline.mount is not None or pipeline.counts[JUMPS] or config.height == 0:
        return {}
    tracker = Pipeline(replace(config, extrinsics=GIVEN), pipeline.config).tracker
    tracker.floor_below = pipeline.tracker.floor_below
    extrinsics = pipeline.tracker.learned.extrinsics

    def placed(observations: Sequence[Observation]) -> list[Observation]:
        """At the places of the cameras as they were known at the end."""
        if extrinsics is not None:
            observations = [replace(one, camera=extrinsics.corrected(one.camera)) for one in observations]
        return [one for one in observations if one.camera.known]

    return kept.track_backward(tracker, placed)
