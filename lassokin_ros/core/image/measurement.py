"""What a frame shows, and what is new in it: an gate_observation observation beside those before it.

Keypoints that come again are no evidence (`repeats`), and in the image each keypoint follows a track (`keypoint_filter`).
Stamps are kept of the last frame that was used and of the last that told something new.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose
from lassokin_ros.core.image.depth_gating import gate_depth
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.keypoint_filter import KeypointFilter
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.image.repeated_frames import RepeatedFrames
from lassokin_ros.core.observation import Observation

ACCELERATION = 3.5
"""m/s^2: standard deviation of a body point's acceleration, typical of everyday motion."""

TYPICAL_DEPTH = 3.5
"""m: of somebody of whom nothing is known yet."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """One frame's keypoints as the tracker uses them; all points are normalised image coordinates.

    detected: (l, 2) as the detector gave them, left and right changed back, 0 where not visible; visible: (l,) bool;
    focal: px per normalised unit.
    points: (l, 2) and weights: (l,), 1 / standard deviation, 0 = missing: what the keypoints' tracks make of them.
    speed: m/s, of the keypoints' tracks on average. repeated: s for which the keypoints have been the same, 0 where
    they are new. step: s since the last frame that was used; news: s since the last one that told something new, 0
    where this one tells nothing; lost: too long ago.
    depth: (l,) m and depth_weights: (l,) 1/m, see `gate_depth`; None without a measured depth.
    """

    stamp: float
    detected: np.ndarray
    visible: np.ndarray
    focal: float
    points: np.ndarray
    weights: np.ndarray
    speed: float
    repeated: float
    step: float
    news: float
    lost: bool
    depth: np.ndarray | None = None
    depth_weights: np.ndarray | None = None

    @cached_property
    def data(self) -> FrameData:
        """The filtered keypoints in the form that all pieces of evidence read."""
        return FrameData(self.points, self.weights, self.depth, self.depth_weights)

    def reprojection_px(self, pose: BodyPose) -> float:
        """px: root of the mean squared distance of the visible points from the pose's landmarks."""
        error = (self.detected - project(pose.landmarks)) * self.visible[:, None]
        return self.focal * math.sqrt(np.vdot(error, error) / np.count_nonzero(self.visible))


class MeasurementFilter:
    """Makes a Measurement of each gate_observation observation; the caller says which of them were used."""

    def __init__(
        self, names: Sequence[str], limbs: Sequence[int], surface: np.ndarray | float = 0.0, reach: float = 2.0
    ) -> None:
        """names: of the landmarks; limbs: which of them are of the same pair of limbs, see `limb_groups`.

        surface, reach: m, see `gate_depth`.
        """
        self._surface, self._reach = surface, reach
        self._repeats, self._filter = RepeatedFrames(), KeypointFilter(names, limbs)
        self.reset()

    def reset(self) -> None:
        """Begin anew: nothing was seen yet."""
        #: s: the stamp of the last frame that was used, -inf before the first.
        self.newest = -np.inf
        self._informed = -np.inf
        self.forget()

    def forget(self) -> None:
        """Forget the keypoints, not the time."""
        self._repeats.reset()
        self._filter.reset()

    def of(
        self, observation: Observation, weights: np.ndarray, depth: float | None, model_error: float, lost_after: float
    ) -> Measurement:
        """What an observation shows that `gate_observation` gave the weights (l,).

        depth: m, the person's, None where it is not known; model_error: m, standard deviation of the places that keypoints
        show from the landmarks'; lost_after: s without news after which the tracks are of no use any more.
        """
        stamp, focal, visible = observation.stamp, observation.focal, weights > 0
        repeated = self._repeats.age(stamp, observation.points, observation.confidence)
        lost = stamp - (self.newest if repeated else self._informed) > lost_after
        if lost:
            self._filter.reset()
            repeated = 0.0
        known_depth = depth
        if lost or depth is None:
            depth = TYPICAL_DEPTH
        measured = gate_depth(observation, visible, self._surface, None if lost else known_depth, self._reach)
        detected = np.where(visible[:, None], observation.points, 0.0)
        if repeated:  # teaches the tracks nothing, least of all a standstill
            points, weights = self._filter.expected(stamp)
        else:
            points, weights = self._filter.update(stamp, detected, weights, ACCELERATION / depth, model_error / depth)
        order = self._filter.order
        if order is not None:
            detected, visible = detected[order], visible[order]
            measured = None if measured is None else (measured[0][order], measured[1][order])
        speed = depth * self._filter.speed()
        news = 0.0 if repeated else stamp - self._informed
        step = stamp - self.newest
        depths = measured or (None, None)
        return Measurement(stamp, detected, visible, focal, points, weights, speed, repeated, step, news, lost, *depths)

    def used(self, measurement: Measurement) -> None:
        """The state follows this one now."""
        self.newest = measurement.stamp
        if not measurement.repeated:
            self._informed = measurement.stamp
