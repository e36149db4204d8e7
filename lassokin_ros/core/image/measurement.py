"""The measurement of one frame: keypoints after gating and filtering.

Keypoints equal to the last ones are no new evidence. Each keypoint's track in the image is filtered (see
`keypoint_filter`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.proportions import limb_groups
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.gating import gate_depth
from lassokin_ros.core.image.keypoint_filter import PREDICTED_WEIGHT, KeypointFilter
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import HERE, CameraPose, Observation, is_longer

ACCELERATION = 3.5
"""m/s^2: standard deviation of a body point's acceleration, typical of everyday motion."""
TYPICAL_DEPTH = 3.5
"""m: assumed depth of a person before the first fit."""


@dataclass(eq=False)
class Measurement:
    """One frame's keypoints as the tracker uses them; all points are normalised image coordinates.

    detected: (l, 2) the detector's points, with swapped sides corrected, 0 where not visible. visible: (l,) bool.
    focal: px per normalised unit. points: (l, 2) filtered points; weights: (l,) 1 / standard deviation, 0 = missing.
    speed: m/s, mean speed of the keypoints' tracks. repeated: s since the keypoints last changed, 0 for new ones. step:
    s since the last used frame. since_new_keypoints: s since the last frame with new keypoints, 0 if this one has none.
    lost: whether the last new keypoints are too old, so that the tracks were dropped. depth: (l,) m and depth_weights:
    (l,) 1/m, see `gate_depth`; None without a measured depth.
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
    since_new_keypoints: float
    lost: bool
    depth: np.ndarray | None = None
    depth_weights: np.ndarray | None = None

    @cached_property
    def used(self) -> np.ndarray:
        """(l,) bool: keypoints that have a weight."""
        return self.weights > 0

    @property
    def depth_count(self) -> int:
        """Number of measured depths that are used."""
        return 0 if self.depth_weights is None else int(np.count_nonzero(self.depth_weights))

    @property
    def count(self) -> int:
        """Number of keypoints and depths that are used."""
        return int(np.count_nonzero(self.weights)) + self.depth_count

    def reprojection_px(self, pose: BodyPose, camera: CameraPose = HERE) -> float:
        """Root mean square distance of the visible points from the pose's landmarks, px."""
        error = (self.detected - project(camera.into_camera(pose.landmarks))) * self.visible[:, None]
        return self.focal * math.sqrt(np.vdot(error, error) / np.count_nonzero(self.visible))


class MeasurementFilter:
    """Turns gated observations into measurements. The caller reports which of them were used."""

    def __init__(self, kinematics: Kinematics) -> None:
        """kinematics: its layout and skeleton may change their size later."""
        self._kinematics = kinematics
        limbs = limb_groups(kinematics.skeleton)[kinematics.layout.joints]
        self.filter = KeypointFilter(kinematics.layout.names, limbs)
        self.reset()

    def reset(self) -> None:
        """Start again, as before the first frame."""
        #: s: stamps of the last frame that was used, and of the last one with new keypoints, -inf before the first.
        self.newest = self.last_new_stamp = -np.inf
        self.forget()

    def forget(self) -> None:
        """Forget the keypoints, but not the stamps."""
        self._last, self._since = b"", 0.0  # the last keypoints, and the stamp of their first occurrence
        self.filter.reset()

    def _age(self, observation: Observation) -> float:
        """Time in s since the same keypoints were first received; 0 if they are new.

        Keypoints are repeated if the detector is slower than the camera, or the image is frozen. The comparison is
        bitwise: keypoints detected in another image never agree in all digits.
        """
        these = observation.points.tobytes() + observation.confidence.tobytes()
        if these != self._last:
            self._last, self._since = these, observation.stamp
        return max(observation.stamp - self._since, 0.0)

    def filtered(
        self,
        observation: Observation,
        weights: np.ndarray,
        depth: float | None,
        model_error: float,
        config: TrackerConfig,
    ) -> Measurement:
        """The measurement of an observation with the weights (l,) of `gate_observation`.

        depth: m, of the person, None if unknown. model_error: m, see `ModelError`. The tracks are dropped if there were
        no new keypoints for `lost_after`.
        """
        stamp, focal, visible = observation.stamp, observation.focal, weights > 0
        repeated = self._age(observation)
        lost = is_longer(stamp - (self.newest if repeated else self.last_new_stamp), config.lost_after)
        if lost:
            self.filter.reset()
            repeated = 0.0
        known_depth = None if lost else depth
        depth = known_depth or TYPICAL_DEPTH
        layout, reach = self._kinematics.layout, self._kinematics.skeleton.height
        measured = gate_depth(observation, visible, layout.surface, known_depth, reach, config.depth_noise)
        detected = np.where(visible[:, None], observation.points, 0.0)
        if repeated:  # the same keypoints do not mean that the person stands still
            points, weights = self.filter.expected(stamp)
        else:
            points, weights = self.filter.update(stamp, detected, weights, ACCELERATION / depth, model_error / depth)
        assignment = self.filter.assignment
        if assignment is not None:
            detected, visible = detected[assignment], visible[assignment]
            measured = None if measured is None else (measured[0][assignment], measured[1][assignment])
        if measured is not None and repeated:
            measured = measured[0], PREDICTED_WEIGHT * measured[1]
        speed, step = depth * self.filter.speed(), stamp - self.newest
        since_new = 0.0 if repeated else stamp - self.last_new_stamp
        times, depths = (speed, repeated, step, since_new, lost), measured or (None, None)
        return Measurement(stamp, detected, visible, focal, points, weights, *times, *depths)

    def predicted(self, stamp: float, depth: float | None, model_error: float) -> tuple[np.ndarray, np.ndarray]:
        """Points (l, 2) and weights (l,) predicted for a stamp, s. depth, model_error: m, as in `filtered`."""
        depth = depth or TYPICAL_DEPTH
        return self.filter.ahead(stamp, ACCELERATION / depth, model_error / depth)

    def mark_used(self, measurement: Measurement) -> None:
        """Note that the state was updated with this measurement."""
        self.newest = measurement.stamp
        if not measurement.repeated:
            self.last_new_stamp = measurement.stamp
