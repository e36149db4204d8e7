"""The time of each stage of a frame: the tracker's own calls, timed in place."""

from __future__ import annotations

import time
from importlib import import_module
from typing import Any, Callable, Sequence

import numpy as np

from benchmarks.common.report import Record
from benchmarks.data.motion import Motion
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker

CORE = "lassokin_ros.core"
STAGES = {
    "filter the keypoints": "image.keypoint_filter:KeypointFilter.update",
    "forward kinematics": "body.kinematics:Kinematics.pose",
    "project, Jacobian, assemble": "evidence.frame_model:FrameModel.linearise",
    "solve": "lasso.solver:LassoSolver.solve",
    "solve: eliminate the translation": "lasso.problem:eliminate_translation",
    "solve: QP": "lasso.dual:DualSolver.solve",
    "solve: predict the solution": "lasso.solver:predicted_solution",
    "solve: certify": "lasso.solver:certify",
    "depth network": "network.depth_estimator:DepthEstimator.update",
    "other pose": "hypotheses.start:OtherPose.better_state",
    "retract": "body.kinematics:BodyState.retract",
}
"""Stage -> module:function, looked up at the call. Stages that a version lacks are left out of the table."""


class Clock:
    """Adds up the time spent in one function, and counts its calls, frame by frame."""

    def __init__(self) -> None:
        self.seconds = self.calls = 0.0

    def around(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, timed."""

        def timed(*arguments: Any, **keywords: Any) -> Any:
            start = time.perf_counter()
            result = function(*arguments, **keywords)
            self.seconds += time.perf_counter() - start
            self.calls += 1
            return result

        return timed

    def take(self) -> tuple[float, float]:
        """(seconds, calls) since the last request."""
        taken = self.seconds, self.calls
        self.seconds = self.calls = 0.0
        return taken


def profile(tracker: Tracker, observations: Sequence[Observation], motion: Motion) -> list[Record]:
    """Time and calls per frame of every stage, over all frames except those that initialise."""
    clocks = {stage: Clock() for stage in STAGES}
    restore = [entry for stage, place in STAGES.items() if (entry := _install(place, clocks[stage]))]
    samples: dict[str, list[tuple[float, float]]] = {stage: [] for stage in (*STAGES, "whole core step")}
    try:
        for frame, observation in enumerate(observations):
            if frame in motion.starts:
                tracker.reset()
            start = time.perf_counter()
            estimate = tracker.track(observation)
            whole = time.perf_counter() - start
            taken = {stage: clock.take() for stage, clock in clocks.items()}
            if not estimate.initialised:
                for stage, sample in taken.items():
                    samples[stage].append(sample)
                samples["whole core step"].append((whole, 1))
    finally:
        for owner, name, original in restore:
            setattr(owner, name, original)
    return [
        {"part": "core", "what": stage, "calls": float(np.mean([calls for _, calls in values])),
         **percentiles([seconds for seconds, _ in values])}
        for stage, values in samples.items() if any(calls for _, calls in values)
    ]  # fmt: skip


def _install(place: str, clock: Clock) -> tuple[Any, str, Any] | None:
    """Time a function. Returns (owner, name, original) to restore it, or None if there is no such function."""
    module, _, path = place.partition(":")
    try:
        owner: Any = import_module(f"{CORE}.{module}")
    except ImportError:
        return None
    *outer, name = path.split(".")
    for part in outer:
        owner = getattr(owner, part, None)
    original = getattr(owner, name, None)
    if original is None:
        return None
    setattr(owner, name, clock.around(original))
    return owner, name, original


def percentiles(seconds: Sequence[float]) -> Record:
    """p50, p95 and p99 of wall times in microseconds, and the number of samples."""
    values = 1e6 * np.asarray(seconds, dtype=float)
    if len(values) == 0:
        return {"frames": 0, "p50_us": float("nan"), "p95_us": float("nan"), "p99_us": float("nan")}
    p50, p95, p99 = np.percentile(values, [50, 95, 99])
    return {"frames": len(values), "p50_us": float(p50), "p95_us": float(p95), "p99_us": float(p99)}
