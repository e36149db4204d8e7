"""The shipped tracker's frames with their errors, on clips and on real recordings, to test its own figures of error."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.accuracy_run.experiment import Job, Scene, scene_of
from benchmarks.data.detections import JOINTS, DetectionJob, prepared
from benchmarks.data.mocap import true_state
from benchmarks.data.simulated_camera import step_for
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.output.uncertainty import JointUncertainty
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.doubt.doubt import signs_of
from lassokin_ros.doubt.monitor import DoubtMonitor


@dataclass(frozen=True, eq=False)
class FollowedFrame:
    """One accepted frame.

    errors: (j,) m, distance of each evaluated joint from the truth, relative to the root; NaN = unknown.
    rotation_errors: (n,) rad, angle between the estimated and the true rotation of each joint relative to its parent,
    of the root in the camera frame; None for a recording.
    deviations: (j,) m, what the tracker states of them. likely_wrong: probability as in `FrameResult.likely_wrong`.
    """

    estimate: Estimate
    uncertainty: JointUncertainty
    errors: np.ndarray
    deviations: np.ndarray
    likely_wrong: float
    rotation_errors: np.ndarray | None = None


def followed_frames(job: Job | DetectionJob, every: int = 1) -> Iterator[FollowedFrame]:
    """Every n-th frame of a job, tracked with the shipped tracker."""
    return _of_recording(job, every) if isinstance(job, DetectionJob) else _of_clip(job, every)


def _of_clip(job: Job, every: int) -> Iterator[FollowedFrame]:
    scene = scene_of(job)
    tracker = Tracker(scene.config, scene.skeleton)
    stated = _Stated(tracker)
    truth = scene.view.truth - scene.view.root[:, None]
    rotations = _true_rotations(scene, tracker.kinematics)
    for frame, observation in enumerate(scene.observations):
        estimate = tracker.track(observation)
        likely_wrong = stated.of(estimate, observation)
        if frame % every or estimate.pose is None or frame / scene.view.fps < job.score_from:
            continue
        found = estimate.pose.positions[scene.evaluated] - estimate.pose.positions[0]
        result = _frame(tracker, estimate, found - truth[frame], scene.evaluated, likely_wrong)
        assert estimate.state is not None
        turns = rotations[frame].swapaxes(-1, -2) @ estimate.state.rotations
        yield replace(result, rotation_errors=np.linalg.norm(logarithm(turns), axis=-1))


def _true_rotations(scene: Scene, kinematics: Kinematics) -> np.ndarray:
    """(f, n, 3, 3) of each joint relative to its parent, of the root in the camera frame."""
    step = step_for(scene.clip.fps, scene.view.fps)
    rotations = true_state(scene.clip, kinematics).rotations[::step].copy()
    rotations[:, 0] = scene.view.orientation @ rotations[:, 0]
    return rotations


def _of_recording(job: DetectionJob, every: int) -> Iterator[FollowedFrame]:
    """Landmarks at joints, relative to the middle of the hips. Frames without reference hips are left out."""
    recording, config, skeleton = prepared(job)
    tracker = Tracker(config, skeleton)
    stated = _Stated(tracker)
    landmarks = [tracker.layout.index(name) for name in JOINTS.values()]
    hips = [tracker.layout.index(f"{side}_hip") for side in ("left", "right")]
    joints = [skeleton.index(name) for name in JOINTS.values()]
    truth = recording.reference[:, landmarks] - recording.reference[:, hips].mean(1, keepdims=True)
    for frame, observation in enumerate(recording.observations):
        estimate = tracker.track(observation)
        likely_wrong = stated.of(estimate, observation)
        if frame % every or estimate.pose is None or np.isnan(recording.reference[frame, hips]).any():
            continue
        places = estimate.pose.landmarks
        yield _frame(tracker, estimate, places[landmarks] - places[hips].mean(0) - truth[frame], joints, likely_wrong)


class _Stated:
    """What the session states of the frames of one person."""

    def __init__(self, tracker: Tracker) -> None:
        self._tracker, self._monitor = tracker, DoubtMonitor(tracker.layout.names, tracker.skeleton.joint_names)

    def of(self, estimate: Estimate, observation: Observation) -> float:
        """The probability that a pose is wrong; NaN if it is not known by the doubt's figures."""
        if estimate.pose is None:
            return math.nan
        height = self._tracker.skeleton.height
        return self._monitor.update(signs_of(estimate, observation.points, observation.focal, height)).probability


def _frame(
    tracker: Tracker, estimate: Estimate, errors: np.ndarray, joints: list[int], likely_wrong: float
) -> FollowedFrame:
    uncertainty, sizes = tracker.uncertainty(estimate), np.linalg.norm(errors, axis=-1)
    if math.isnan(likely_wrong):
        likely_wrong = uncertainty.failure_probability
    return FollowedFrame(estimate, uncertainty, sizes, uncertainty.deviation[joints], likely_wrong)
