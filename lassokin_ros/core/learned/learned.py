"""Everything that is learned about the person, the detector and the camera while a person is tracked."""

from __future__ import annotations

import math
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from lassokin_ros.core.body.roles import ANKLES, PELVIS
from lassokin_ros.core.body.skeleton import Skeleton, has_built_in_proportions
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.image.frame_data import FrameData, triangulate
from lassokin_ros.core.learned.adaptive_mean import AdaptiveMean
from lassokin_ros.core.learned.bone_lengths import OBSERVED_STATURE_DEVIATION, Calibration
from lassokin_ros.core.learned.errors import ModelError
from lassokin_ros.core.learned.extrinsics import Extrinsics
from lassokin_ros.core.learned.foot_contacts import FootContacts, on_floor
from lassokin_ros.core.learned.height import (
    LARGEST_FLOOR_DEVIATION,
    PEOPLE_DEVIATION,
    FloorSize,
    HeightEstimator,
    SizeCheck,
    floor_size,
)
from lassokin_ros.core.learned.vertical import Vertical

if TYPE_CHECKING:
    from lassokin_ros.core.answer import Answer

MOVED_CAMERA = "a camera was moved"
"""Doubt about a place."""


class Learned:
    """The learners of one tracker. The tracker calls `update` with each answer, `reset` and `resize`.

    height: None if it is given. vertical: in the skeleton's frame. feet: which stand still.
    """

    def __init__(self, frame_model: FrameModel, config: TrackerConfig, up: np.ndarray | None = None) -> None:
        """up: (3,) the vertical if it is given; it is learned otherwise."""
        self._frame_model, kinematics = frame_model, frame_model.kinematics
        self._built_in = has_built_in_proportions(kinematics.skeleton)
        self._upright = kinematics.skeleton.joint_names[0] == PELVIS
        self.lengths, self.mean_pose = Calibration(frame_model), AdaptiveMean(frame_model.prior)
        self.model_error = ModelError(kinematics.skeleton.height)
        self.vertical = Vertical(config.camera_roll, config.camera_pitch, up)
        self.size_check = SizeCheck(kinematics)
        self.extrinsics = Extrinsics(self.size_check, config.height > 0, config.extrinsics)
        self.height = HeightEstimator() if config.height == 0 else None
        self.feet = FootContacts()
        named = ANKLES if frame_model.foot_contact else ()
        self._ankles = np.array([kinematics.skeleton.index(ankle) for ankle in named], dtype=int)
        self._ankle_points = np.equal.outer(self._ankles, kinematics.layout.joints)  # (2, l)

    def reset(self, same_camera: bool = False) -> None:
        """Forget what was learned. same_camera: keep the vertical and the corrections of the cameras' poses."""
        for learner in (self.lengths, self.mean_pose, self.model_error, self.size_check, self.feet, self.height):
            if learner is not None:
                learner.reset()
        if not same_camera:
            self.vertical.reset()
        self.extrinsics.reset(same_camera)

    def begin_take(self) -> None:
        """Forget where the camera and the feet are; what is known of the person and the detector stays."""
        self.feet.reset()
        self.vertical.reset()

    def resize(self, ratio: float, centre: np.ndarray | None = None) -> None:
        """Scale what is known to a body that is taller by a factor.

        centre: (3,) m, of the only camera; None if several observe where the body is.
        """
        self.lengths.resize(ratio)
        self.model_error.resize(ratio)
        self.size_check.use(self.lengths.proportions.given)
        self.feet.reset()  # they are elsewhere
        self.extrinsics.resize(ratio, centre)

    def use_body(self, given: Skeleton, measured: bool) -> None:
        """Use another given body with the same tree. measured: whether its height is to be measured."""
        self.resize(given.height / self.lengths.proportions.given.height)
        self.lengths.proportions.use(given)
        self.size_check.use(given)
        self._built_in = has_built_in_proportions(given)
        self.height = HeightEstimator() if measured else None
        self.extrinsics.size_known = not measured

    @property
    def is_sized(self) -> bool:
        """Whether the person's height is given or measured."""
        return self.height is None or self.height.measured

    @property
    def size_deviation(self) -> float:
        """Standard deviation of the logarithm of a measured height; of a given one 0, or its error if it is wrong."""
        if self.height is None:
            return abs(math.log(self.size_check.ratio)) if self.size_check.wrong else 0.0
        return self.height.deviation / self.height.height

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the place or the size of the body is doubted, in words; empty if they are not."""
        found = []
        if self.height is None and self.size_check.wrong:
            found.append(f"the height of {self.lengths.proportions.given.height:.2f} m does not fit")
        if self.extrinsics.lately.contradicting:
            found.append(MOVED_CAMERA)
        return tuple(found)

    @property
    def lengths_for_network(self) -> tuple[Skeleton, bool]:
        """The body whose lengths are input to the depth network, and whether they are known."""
        body = self.lengths.skeleton if self._built_in else self.lengths.proportions.given
        return body, self.lengths.certain or not self._built_in

    @property
    def still(self) -> np.ndarray:
        """(n,) bool: the ankles of the feet that stand still."""
        still = np.zeros(self._frame_model.kinematics.joint_count, dtype=bool)
        if any(self.feet.standing):
            still[self._ankles] = self.feet.standing
        return still

    def contacts(self, positions: np.ndarray) -> np.ndarray:
        """(n,) bool: those of them that are on the floor. positions: (n, 3) m, of the joints."""
        contacts = self.still
        if any(self.feet.standing):
            contacts[self._ankles] &= on_floor(positions[self._ankles], self.vertical.direction)
        return contacts

    def place_covariance(self, answer: Answer) -> np.ndarray | None:
        """(3, 3) m^2: what is unsure in the place by the poses of the cameras, see `Estimate`."""
        found = answer.place_covariance
        if len(answer.cameras) > 1:
            moved = self.extrinsics.place_covariance(answer.solved.state.translation)
            found = moved if found is None else found if moved is None else found + moved
        return found

    def follow_feet(self, answer: Answer, replaced: bool, held: bool) -> None:
        """Note which feet stand still. replaced: whether the pose does not continue the last one. held: see
        `hold_feet`.
        """
        held = held and len(self._ankles) > 0
        if replaced or not held:
            self.feet.reset()
        if held and not answer.repeated:
            ankles = answer.solved.pose.positions.take(self._ankles, axis=0)
            speeds = reduce(np.fmax, [camera.speeds(ankles, self._ankle_points) for camera in answer.measured])
            self.feet.update(answer.stamp, ankles, speeds)

    def update(self, answer: Answer, restarted: bool, config: TrackerConfig) -> tuple[bool, float]:
        """Use an answer. Returns whether body or prior have changed, and the ratio of a new height to the one in use.

        restarted: see `Calibration.update`.
        """
        changed, problem, frame = False, answer.increment.problem, answer.frame
        if self.height is not None and self._of_known_size(frame).seen_by > 1:
            self.lengths.stature_deviation = PEOPLE_DEVIATION
        elif self.height is None and (frame.observes_depth or frame.floor is not None):
            self.lengths.stature_deviation = OBSERVED_STATURE_DEVIATION
        if config.calibrate and (answer.start.initialised or not answer.repeated):
            changed = self.lengths.update(answer.stamp, answer.solved.state, frame, restarted)
        if not answer.repeated:
            if not answer.start.initialised and self._upright:
                root, step = answer.solved.state.rotations[0], answer.together.since_new_keypoints
                self.vertical.update(root, step)
            if self.model_error.due(answer.stamp):
                self._update_model_error(answer)
            if not answer.start.initialised:
                start, rows = answer.start.state.state, answer.increment.rows
                changed |= self.mean_pose.update(answer.stamp, start, problem, rows)
        if self.height is None:
            self._check_size(answer, config.tilt_deviation)
            return changed, 1.0
        return changed, self._new_height(answer, config.tilt_deviation)

    def _update_model_error(self, answer: Answer) -> None:
        views, place = answer.seen().views, answer.solved.state.translation
        weights = np.concatenate([view.weights for view in views])
        depths = np.concatenate([np.full(len(view.weights), view.camera.into_camera(place)[2]) for view in views])
        increment = answer.increment
        image, omega = self._frame_model.image_rows(increment.rows), increment.solution.omega
        self.model_error.update(answer.stamp, increment.problem, image, omega, weights, depths)

    def _new_height(self, answer: Answer, tilt_deviation: float) -> float:
        """Ratio of a newly measured height to the one in use, 1 if it stays."""
        assert self.height is not None
        limbs, floor, height = None, None, self._frame_model.kinematics.skeleton.height
        if not answer.several and not answer.repeated:
            floor = self._floor_size(answer, height, tilt_deviation)
        elif not answer.repeated:
            places = self._triangulated(answer)
            limbs = self.size_check.lengths(places, np.isfinite(places[:, 0]))
        camera, one = max(answer.measured.items(), key=lambda item: item[1].depth_count > 0)
        changed = self.height.update(one, answer.solved, camera.pose, height, limbs, floor)
        return self.height.height / height if changed else 1.0

    def _check_size(self, answer: Answer, tilt_deviation: float) -> None:
        """Compare a given height with what depth, several cameras or a known floor say."""
        for one in answer.measured.values():
            self.size_check.update(one)
        if answer.repeated or answer.frame.depth_measured or not self.size_check.is_due(answer.stamp):
            return
        if answer.several:
            if self.extrinsics.lately.contradicting:
                return
            places = self._triangulated(answer)
            self.size_check.add(answer.stamp, self.size_check.ratios(places, np.isfinite(places[:, 0])))
        elif (floor := self._floor_size(answer, self.lengths.proportions.given.height, tilt_deviation)) is not None:
            if floor.deviation < LARGEST_FLOOR_DEVIATION:
                self.size_check.add(answer.stamp, np.array([floor.ratio]))

    def _triangulated(self, answer: Answer) -> np.ndarray:
        """(l, 3) m: where cameras of known size see the landmarks; NaN for those of fewer than two."""
        lately = [camera.seen_lately(answer.stamp) for camera in answer.cameras]
        return triangulate(answer.seen(self._of_known_size(answer.frame), lately).views)

    def _of_known_size(self, frame: FrameData) -> FrameData:
        """The frame without the points of cameras that were found from the person, whose size sets their distances."""
        found = self.extrinsics.found
        if not found:
            return frame
        return frame.with_weights([(view.camera.name not in found) * view.weights for view in frame.views])

    def _floor_size(self, answer: Answer, height: float, tilt_deviation: float) -> FloorSize | None:
        """The size by the feet that stand on the floor; None if it is not asked for, or none does."""
        if answer.frame.floor is None or not tilt_deviation:
            return None
        positions, centre = answer.solved.pose.positions, answer.frame.seeing.camera.centre
        ankles = positions[self.contacts(positions)]
        return floor_size(ankles, answer.frame.floor, centre, height, tilt_deviation)
