"""The demo's motion with simulated measurements of a depth camera at the keypoints."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import WEBCAM

NOISE, BIAS = 0.03, 0.02
"""m: standard deviations of the noise of a depth, and of its lasting part."""
OCCLUDED, NEARER = 0.1, (0.1, 0.5)
"""Share of the points that an occluder covers, and the range by which it is nearer, m."""


def track_with_depth(states: BodyState, times: np.ndarray, pixels: np.ndarray, confidence: np.ndarray) -> np.ndarray:
    """Return the joints (f, n, 3) m, camera frame, tracked with simulated depths.

    states: the true motion (f, ...); times: (f,) s; pixels: (f, l, 2) px and confidence (f, l) of the detector.
    """
    tracker, random, lens = Tracker(TrackerConfig()), np.random.default_rng(2), WEBCAM.lens
    depth = measured(tracker.kinematics.pose(states).landmarks[..., 2], random)
    joints = np.full((len(times), tracker.skeleton.joint_count, 3), np.nan)
    for frame, stamp in enumerate(times.tolist()):
        points = lens.normalise(pixels[frame])
        observation = Observation(stamp, points, confidence[frame], lens.focal, depth=depth[frame])
        estimate = tracker.track(observation)
        if estimate.pose is not None:
            joints[frame] = estimate.pose.positions
        elif frame:
            joints[frame] = joints[frame - 1]
    return joints


def measured(depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return depths (f, l) m as a depth camera measures them."""
    result = depth + NOISE * random.normal(size=depth.shape) + BIAS * random.normal(size=depth.shape[1])
    hidden = random.random(depth.shape) < OCCLUDED
    return np.where(hidden, result - random.uniform(*NEARER, size=depth.shape), result)
