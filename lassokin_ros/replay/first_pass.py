"""The first of two passes over a recording: learn the person's lengths over the whole of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.pipeline.outputs.description.skeleton_file import LEAST_MOTION, save_all
from lassokin_ros.pipeline.settings import NodeSettings

WHOLE_FILE: Mapping[str, float] = {"smoothing": 0.03, "smoothing_lag": 0.25}
"""Settings for a file that is tracked in two passes: later frames are known, so the pose is smoothed with them."""

Inputs = Mapping[str, Callable[[Any, int], Iterator[tuple[str, str, Any]]]]
"""By the topic's name, what processes its messages and yields the outputs."""


def check_two_passes(tracker: TrackerConfig, node: NodeSettings) -> None:
    """Raise ConfigurationError if two passes make no sense with these settings."""
    if node.several_people:
        raise ConfigurationError("--two-pass is for one person; expected max_people 1 and rep155 false")
    if not tracker.calibrate:
        raise ConfigurationError("--two-pass needs calibration; add -p calibrate:=true")


def learn_lengths(
    messages: Iterator[tuple[str, int, Any]], inputs: Inputs, tracker: Any, config: TrackerConfig, folder: Path
) -> TrackerConfig:
    """Track all messages (topic, recording time in ns, message); return the settings for the second pass.

    tracker: an OfflineTracker that is used for this pass only. The lengths are written to a file in `folder`. The
    settings are unchanged if the person moved for less than LEAST_MOTION.
    """
    for topic, time_ns, message in messages:
        for _ in inputs[topic](message, time_ns):
            pass  # the outputs are those of the second pass
    for _ in tracker.finish():
        pass
    calibrations = tracker.pipeline.calibrations()
    (calibration,) = calibrations.values()
    if calibration.kept_motion < LEAST_MOTION:
        return config
    path = folder / "skeleton.yaml"
    save_all(calibrations, path, tracker.newest_ns)
    return replace(config, skeleton=str(path), height=float(calibration.skeleton.height))
