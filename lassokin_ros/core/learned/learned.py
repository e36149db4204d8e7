"""Everything that is learned about the person, the detector and the camera while a person is tracked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import GIVEN, LEARN, TrackerConfig
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.increment import Increment
from lassokin_ros.core.learned.adaptive_mean import AdaptiveMean
from lassokin_ros.core.learned.bone_lengths import Calibration
from lassokin_ros.core.learned.depth_noise import DepthNoise
from lassokin_ros.core.learned.extrinsics import Extrinsics
from lassokin_ros.core.learned.foot_contacts import FootContacts
from lassokin_ros.core.learned.height import HeightEstimator
from lassokin_ros.core.learned.model_error import ModelError
from lassokin_ros.core.learned.size_check import SizeCheck
from lassokin_ros.core.learned.vertical import Vertical


class Learned:
    """The learners of one tracker, each with `update` and `reset`.

    height: None if it is given. vertical: in the skeleton's frame. extrinsics: None if the cameras' given poses are not
    checked. feet: which stand still.
    """

    def __init__(self, frame_model: FrameModel, config: TrackerConfig, up: np.ndarray | None = None) -> None:
        """up: (3,) the vertical if it is given; it is learned otherwise."""
        skeleton, self._frame_model = frame_model.kinematics.skeleton, frame_model
        self.lengths, self.mean_pose = Calibration(frame_model), AdaptiveMean(frame_model.prior)
        self.model_error, self.depth_noise = ModelError(skeleton.height), DepthNoise()
        self.vertical = Vertical(config.camera_roll, config.camera_pitch, up)
        self.size_check = SizeCheck(frame_model.kinematics)
        self.extrinsics = None
        if config.extrinsics != GIVEN:
            self.extrinsics = Extrinsics(self.size_check, config.height > 0, config.extrinsics == LEARN)
        self.height = HeightEstimator() if config.height == 0 else None
        self.feet = FootContacts()

    def reset(self, same_camera: bool = False) -> None:
        """Forget what was learned. same_camera: keep the vertical and the corrections of the cameras' poses."""
        known = self.lengths, self.mean_pose, self.model_error, self.depth_noise, self.size_check, self.feet
        learners: tuple[Any, ...] = *known, self.height, None if same_camera else self.vertical
        for learner in filter(None, learners):
            learner.reset()
        if self.extrinsics is not None:
            self.extrinsics.reset(same_camera)

    def resize(self, ratio: float) -> None:
        """Scale what is known to a body that is taller by a factor."""
        self.lengths.resize(ratio)
        self.model_error.resize(ratio)
        self.size_check.use(self.lengths.proportions.given)
        self.feet.reset()  # they are elsewhere

    def use_body(self, given: Skeleton, measured: bool) -> None:
        """Use another given body with the same tree. measured: whether its height is to be measured."""
        self.resize(given.height / self.lengths.proportions.given.height)
        self.lengths.proportions.use(given)
        self.size_check.use(given)
        self.height = HeightEstimator() if measured else None
        if self.extrinsics is not None:
            self.extrinsics.size_known = not measured

    def update(
        self,
        measurement: Measurement,
        seen: Callable[[], FrameData],
        start: BodyState,
        initialised: bool,
        increment: Increment,
        solved: BodyState,
    ) -> bool:
        """Use a tracked frame for all but lengths and size. Returns True if the prior's mean has changed.

        seen: gives the frame with the landmarks that were seen. start, solved: before and after the `increment`.
        """
        stamp, problem, rows = measurement.stamp, increment.problem, increment.rows
        if measurement.repeated:
            return False
        if not initialised:
            self.vertical.update(solved.rotations[0], measurement.since_new_keypoints)
        if self.model_error.due(stamp):
            views, place = seen().views, solved.translation
            weights = np.concatenate([view.weights for view in views])
            depths = [np.full(len(view.weights), view.camera.into_camera(place)[2]) for view in views]
            image = self._frame_model.image_rows(rows)
            self.model_error.update(stamp, problem, image, increment.solution.omega, weights, np.concatenate(depths))
        return not initialised and self.mean_pose.update(stamp, start, problem, rows)
