"""The doubt about each frame of a recording, for the report and the output video."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.doubt.monitor import Doubt, DoubtMonitor, Signs
from lassokin_ros.core.doubt.recent import Recent
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.pipeline.frame_result import FrameResult

FAILURE, FAILURE_S = 0.3, 0.5
"""Mean of the stated failure probability over the last 0.5 s from which a frame is marked. On 48 recorded cameras 93 %
of the frames below 60 mm are unmarked, and 13 % of those beyond 150 mm are marked, see
benchmarks/accuracy_run/doubt.py."""


@dataclass(frozen=True)
class FrameDoubt:
    """The doubt about one frame. failure: mean failure probability of the last `FAILURE_S`."""

    doubt: Doubt
    failure: float

    @property
    def likely_wrong(self) -> bool:
        """Whether the frame is marked."""
        return self.doubt.likely_wrong or self.failure > FAILURE


class PeopleDoubts:
    """Follows every person of a recording."""

    def __init__(self, landmarks: tuple[str, ...]) -> None:
        """landmarks: names in layout order."""
        self._landmarks = landmarks
        self._people: dict[str, tuple[DoubtMonitor, Recent[float]]] = {}

    def of(self, frame: FrameResult) -> FrameDoubt:
        """Return the doubt about an accepted frame. Call it once for each frame of a person, in order."""
        assert frame.skeleton is not None
        if frame.person not in self._people:
            monitor = DoubtMonitor(self._landmarks, frame.skeleton.joint_names)
            self._people[frame.person] = monitor, Recent(FAILURE_S)
        monitor, failures = self._people[frame.person]
        signs = signs_of(frame)
        failures.add(signs.stamp, frame.uncertainty.failure_probability)
        return FrameDoubt(monitor.update(signs), float(np.mean(failures.values)))


def signs_of(frame: FrameResult) -> Signs:
    """Return what an accepted frame shows."""
    estimate, lens, skeleton = frame.estimate, frame.lens, frame.skeleton
    assert estimate is not None and estimate.pose is not None and estimate.visible is not None
    assert lens is not None and skeleton is not None and frame.detected is not None
    keypoints = np.where(estimate.visible[:, None], frame.detected, np.nan)
    positions = estimate.pose.positions
    height_px = skeleton.height * lens.focal / float(positions[0, 2])
    return Signs(
        frame.stamp_ns * 1e-9,
        keypoints,
        positions,
        estimate.reprojection_px / height_px,
        estimate.cost / max(estimate.measurements, 1),
        _optional(estimate, "prior_cost"),
        _optional(estimate, "network_distance"),
    )


def _optional(estimate: Estimate, name: str) -> float:
    """Return a figure that the tracker may state, NaN if it does not."""
    return float(getattr(estimate, name, math.nan))
