"""The shipped tracker's frames with their errors, on clips and on real recordings, to test its own figures of error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy_run.experiment import Job, scene_of
from benchmarks.data.detections import JOINTS, DetectionJob, prepared
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.output.uncertainty import JointUncertainty
from lassokin_ros.core.tracker import Tracker


@dataclass(frozen=True, eq=False)
class FollowedFrame:
    """One accepted frame.

    errors: (j,) m, distance of each evaluated joint from the truth, relative to the root; NaN = unknown.
    deviations: (j,) m, what the tracker states of them.
    """

    estimate: Estimate
    uncertainty: JointUncertainty
    errors: np.ndarray
    deviations: np.ndarray


def followed_frames(job: Job | DetectionJob, every: int = 1) -> Iterator[FollowedFrame]:
    """Every n-th frame of a job, tracked with the shipped tracker."""
    return _of_recording(job, every) if isinstance(job, DetectionJob) else _of_clip(job, every)


def _of_clip(job: Job, every: int) -> Iterator[FollowedFrame]:
    scene = scene_of(job)
    tracker = Tracker(scene.config, scene.skeleton)
    truth = scene.view.truth - scene.view.root[:, None]
    for frame, observation in enumerate(scene.observations):
        estimate = tracker.track(observation)
        if frame % every or estimate.pose is None or frame / scene.view.fps < job.score_from:
            continue
        found = estimate.pose.positions[scene.evaluated] - estimate.pose.positions[0]
        yield _frame(tracker, estimate, found - truth[frame], scene.evaluated)


def _of_recording(job: DetectionJob, every: int) -> Iterator[FollowedFrame]:
    """Landmarks at joints, relative to the middle of the hips. Frames without reference hips are left out."""
    recording, config, skeleton = prepared(job)
    tracker = Tracker(config, skeleton)
    landmarks = [tracker.layout.index(name) for name in JOINTS.values()]
    hips = [tracker.layout.index(f"{side}_hip") for side in ("left", "right")]
    joints = [skeleton.index(name) for name in JOINTS.values()]
    truth = recording.reference[:, landmarks] - recording.reference[:, hips].mean(1, keepdims=True)
    for frame, observation in enumerate(recording.observations):
        estimate = tracker.track(observation)
        if frame % every or estimate.pose is None or np.isnan(recording.reference[frame, hips]).any():
            continue
        places = estimate.pose.landmarks
        yield _frame(tracker, estimate, places[landmarks] - places[hips].mean(0) - truth[frame], joints)


def _frame(tracker: Tracker, estimate: Estimate, errors: np.ndarray, joints: list[int]) -> FollowedFrame:
    uncertainty = tracker.uncertainty(estimate)
    return FollowedFrame(estimate, uncertainty, np.linalg.norm(errors, axis=-1), uncertainty.deviation[joints])
