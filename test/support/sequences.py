"""Good frames for the core's tracker, with the true motion."""

from dataclasses import replace

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import WEBCAM, detections, exact_pixels, motion

FOCAL, RATE, NOISE_PX = 1000.0, 30.0, 2.0
CONFIG = TrackerConfig(height=1.75, noise_px=NOISE_PX)
"""The default configuration, with the noise of `observations`."""
WITHOUT_NETWORK = replace(CONFIG, depth_prior=False)
"""The same without the depth network, for what the tracker does only then, or what the network hides."""
TRACKED_WITHIN = 0.15
"""Largest mean error of the joints, pelvis on pelvis, of a tracked state, m; a lost one has 0.3 m."""


def observations(tracker, seconds=2.0, start=0.0, noise_px=NOISE_PX, seed=0):
    """(true pelvis-aligned pose, observation) of each frame of the synthetic motion."""
    random = np.random.default_rng(seed)
    times = start + np.arange(round(seconds * RATE)) / RATE
    truth = tracker.kinematics.pose(motion(tracker.skeleton, times))
    points = project(truth.landmarks)
    points = points + random.normal(size=points.shape) * noise_px / FOCAL
    return [
        (truth.positions[i], Observation(t, points[i], np.ones(points.shape[1]), FOCAL)) for i, t in enumerate(times)
    ]


def detected(seconds, seed=1):
    """(tracker, observations) of the demo's person with its simulated detector."""
    tracker, lens = Tracker(TrackerConfig(height=1.75)), WEBCAM.lens
    times = np.arange(round(seconds * RATE)) / RATE
    pixels, confidence = detections(exact_pixels(tracker.kinematics, motion(tracker.skeleton, times)), RATE, seed=seed)
    return tracker, [
        Observation(float(t), lens.normalise(p.astype(float)), c.astype(float), lens.focal)
        for t, p, c in zip(times, pixels, confidence)
    ]


def frame(tracker, stamp=0.0):
    return replace(observations(tracker, 1 / RATE)[0][1], stamp=stamp)


def aligned_error(estimate, truth):
    """Mean distance of the joints with the pelvises aligned, m."""
    mine = estimate.pose.positions
    return np.linalg.norm((mine - mine[0]) - (truth - truth[0]), axis=-1).mean()


def same(a: BodyState, b: BodyState) -> bool:
    return np.array_equal(a.rotations, b.rotations) and np.array_equal(a.translation, b.translation)
