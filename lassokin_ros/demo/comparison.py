"""The demo's motion with measurements of a depth camera at the keypoints, and with a second camera from the side.

Both functions take the true motion `states` (f, ...), times (f,) s, and a detector's pixels (f, l, 2) px and confidence
(f, l). They return the joints (f, n, 3) m in the frame of the first camera; NaN before the first estimate.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import DISTANCE, WEBCAM, detections

NOISE, BIAS = 0.03, 0.02
"""m: standard deviations of the noise of a depth, and of its lasting part."""
OCCLUDED, NEARER = 0.1, (0.1, 0.5)
"""Share of the points that an occluder covers, and the range by which it is nearer, m."""


def track_with_depth(states: BodyState, times: np.ndarray, pixels: np.ndarray, confidence: np.ndarray) -> np.ndarray:
    """Track with simulated depths."""
    tracker, lens = Tracker(TrackerConfig()), WEBCAM.lens
    depth = measured(tracker.kinematics.pose(states).landmarks[..., 2], np.random.default_rng(2))
    return _joints(
        tracker,
        (
            [Observation(stamp, lens.normalise(found), sure, lens.focal, depth=metres)]
            for stamp, found, sure, metres in zip(times.tolist(), pixels, confidence, depth)
        ),
    )


def measured(depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return depths (f, l) m as a depth camera measures them."""
    result = depth + NOISE * random.normal(size=depth.shape) + BIAS * random.normal(size=depth.shape[1])
    hidden = random.random(depth.shape) < OCCLUDED
    return np.where(hidden, result - random.uniform(*NEARER, size=depth.shape), result)


def track_with_second_camera(
    states: BodyState, times: np.ndarray, pixels: np.ndarray, confidence: np.ndarray
) -> np.ndarray:
    """Track with the keypoints of a second camera, too, which has the same lens and detector."""
    tracker, lens = Tracker(TrackerConfig()), WEBCAM.lens
    front, side = CameraPose("front"), side_camera()
    seen = project(side.into_camera(tracker.kinematics.pose(states).landmarks))
    exact = lens.distort(seen.reshape(-1, 2)).reshape(seen.shape)
    views = [(front, pixels, confidence), (side, *detections(exact, 1 / float(np.diff(times).mean()), seed=2))]
    return _joints(
        tracker,
        (
            [
                Observation(stamp, lens.normalise(found[frame]), sure[frame], lens.focal, camera=camera)
                for camera, found, sure in views
            ]
            for frame, stamp in enumerate(times.tolist())
        ),
    )


def side_camera() -> CameraPose:
    """Return the pose of a camera that looks at the person from 90 degrees to the side, in the first one's frame."""
    turn, middle = exponential(np.array([[0.0, np.pi / 2, 0.0]]))[0], np.array([0.0, 0.0, DISTANCE])
    return CameraPose("side", turn, middle - turn @ middle)


def _joints(tracker: Tracker, instants: Iterable[Sequence[Observation]]) -> np.ndarray:
    """Track the instants; one without an estimate has the joints of the one before."""
    joints = [np.full((tracker.skeleton.joint_count, 3), np.nan)]
    for instant in instants:
        pose = tracker.track(instant).pose
        joints.append(joints[-1] if pose is None else pose.positions)
    return np.array(joints[1:])
