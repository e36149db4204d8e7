"""Track one sequence of keypoints with one method, and collect the estimates."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Protocol, Sequence

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.recording import WHOLE_FILE, track_recording
from lassokin_ros.core.tracker import Tracker


class Follower(Protocol):
    """Interface of a method that turns observations into estimates: the tracker and the baselines."""

    def track(self, observation: Observation) -> Estimate:
        """Use one observation."""
        ...


@dataclass(frozen=True, eq=False)
class Track:
    """The estimates of a method for f frames. Before the first estimate: NaN; in a rejected frame: the last estimate.

    positions: (f, n, 3) m joint centres; landmarks: (f, l, 3) m; reprojection_px: (f,), NaN where rejected; rejected:
    (f,) bool; frame_ms: (f,); init_ms: time of the frame that gave the first estimate. height_m: as measured at the
    end, NaN if it was given. skeleton: of the tracker at the end, None for methods that have none of their own.
    """

    positions: np.ndarray
    landmarks: np.ndarray
    reprojection_px: np.ndarray
    rejected: np.ndarray
    frame_ms: np.ndarray
    init_ms: float
    height_m: float = float("nan")
    skeleton: Skeleton | None = None

    @property
    def first(self) -> int:
        """The first frame with an estimate, or the number of frames if there is none."""
        known = np.isfinite(self.positions[:, 0, 0])
        return int(np.argmax(known)) if known.any() else len(known)


def follow(follower: Follower, observations: Sequence[Observation], joints: int, landmarks: int) -> Track:
    """Process the observations in order. An estimate belongs to the frame with its stamp."""
    count = len(observations)
    frame_of = {observation.stamp: frame for frame, observation in enumerate(observations)}
    positions, points = np.full((count, joints, 3), np.nan), np.full((count, landmarks, 3), np.nan)
    reprojection, frame_ms = np.full(count, np.nan), np.full(count, np.nan)
    rejected = np.ones(count, dtype=bool)
    init_ms = np.nan

    def take(estimates: Sequence[Estimate]) -> None:
        nonlocal init_ms
        for estimate in estimates:
            if not estimate.accepted or estimate.pose is None:
                continue
            target = frame_of[estimate.stamp]
            positions[target], points[target] = estimate.pose.positions, estimate.pose.landmarks
            reprojection[target], rejected[target] = estimate.reprojection_px, False
            if np.isnan(init_ms):
                init_ms = frame_ms[target]

    for frame, observation in enumerate(observations):
        start = time.perf_counter()
        estimate = follower.track(observation)
        frame_ms[frame] = 1000 * (time.perf_counter() - start)
        take(follower.published if isinstance(follower, Tracker) else [estimate])
    if isinstance(follower, Tracker):
        take(follower.flush())
    estimator = follower.learned.height if isinstance(follower, Tracker) else None
    height = np.nan if estimator is None or not estimator.measured else estimator.height
    learned = follower.skeleton if isinstance(follower, Tracker) else None
    return Track(
        held(positions), held(points), reprojection, rejected, frame_ms, float(init_ms), float(height), learned
    )


def follow_file(
    config: TrackerConfig, skeleton: Skeleton, observations: Sequence[Observation], landmarks: int
) -> Track:
    """Process the observations as those of a file, whose later frames are known. `init_ms` is unknown."""
    count = len(observations)
    frame_of = {observation.stamp: frame for frame, observation in enumerate(observations)}
    positions, points = np.full((count, skeleton.joint_count, 3), np.nan), np.full((count, landmarks, 3), np.nan)
    reprojection = np.full(count, np.nan)
    start = time.perf_counter()
    for estimate in track_recording(replace(config, **WHOLE_FILE), [[one] for one in observations], skeleton):
        frame, pose = frame_of[estimate.stamp], estimate.pose
        assert pose is not None
        positions[frame], points[frame] = pose.positions, pose.landmarks
        reprojection[frame] = estimate.reprojection_px
    frame_ms = np.full(count, 1000 * (time.perf_counter() - start) / count)
    return Track(held(positions), held(points), reprojection, np.isnan(reprojection), frame_ms, float("nan"))


def held(values: np.ndarray) -> np.ndarray:
    """NaN frames replaced by the last known one."""
    known = np.isfinite(values[:, 0, 0])
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.where((last >= 0)[:, None, None], values[np.maximum(last, 0)], np.nan)
