"""Track a whole recording, whose later frames are known.

    estimates = track_recording(TrackerConfig(height=1.75, **WHOLE_FILE), instants)

Three passes: the first learns the person's lengths. The second goes backward in time, with these lengths. The third
goes forward, smooths each pose with the next ones, and publishes a pose between the two tracks (`smoothing`), which
remember different frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.output.smoothing import Backward
from lassokin_ros.core.tracker import Tracker

WHOLE_FILE: Mapping[str, Any] = {"smoothing": 0.03, "smoothing_lag": 0.25}
"""Settings for a recording whose later frames are known, so that a pose is smoothed with them."""

Instant = Sequence[Observation]
"""The observations of one instant, one of each camera that has one."""


def track_recording(
    config: TrackerConfig,
    instants: Sequence[Instant],
    skeleton: Skeleton | None = None,
    up: np.ndarray | None = None,
) -> list[Estimate]:
    """Track one person; return the accepted estimates, in the order of their stamps.

    config: `WHOLE_FILE` has the smoothing for it. skeleton, up: see `Tracker`. The lengths are learned if `calibrate`
    is set. Raises a LassokinError for a configuration that cannot be used.
    """
    first = Tracker(replace(config, smoothing_lag=0.0), skeleton, up=up)
    for instant in instants:
        first.track(instant)
    config = replace(config, height=first.skeleton.height)
    backward, tracker = (Tracker(config, first.skeleton, up=up) for _ in range(2))
    tracker.backward = dict(track_backward(backward, reversed(instants))).get
    return list(published(tracker, instants))


def track_backward(tracker: Tracker, instants: Iterable[Instant]) -> Iterator[tuple[float, Backward]]:
    """The frames by a new tracker backward in time, by each stamp of the instant, s; the last instant first."""
    stamps: dict[float, set[float]] = {}

    def turned() -> Iterator[Instant]:
        for instant in instants:
            own = {one.stamp for one in instant}
            if own:
                stamps[-max(own)] = own
            yield [replace(one, stamp=-max(own)) for one in instant]

    for estimate in published(tracker, turned()):
        assert estimate.state is not None
        frame = Backward(estimate.state, estimate.cost)
        yield from ((stamp, frame) for stamp in sorted(stamps[estimate.stamp], reverse=True))


def published(tracker: Tracker, instants: Iterable[Instant]) -> Iterator[Estimate]:
    """Track all instants; yield the accepted estimates, at the end those that wait for `smoothing_lag`."""
    for instant in instants:
        tracker.track(instant)
        yield from tracker.published
    yield from tracker.flush()
