"""The tracker: one observation in, one estimate out.

    tracker = Tracker(TrackerConfig(height=1.75))
    estimate = tracker.track(Observation(stamp, points, confidence, focal))

The tracker follows the paper's method frame by frame in a closed loop. It compares the observation with the projection
of the present state (not with the last observation, which would drift), linearises the model about that state (12),
solves the lasso for the increment of all joints and the translation, certifies the answer, and retracts it onto SO(3).
After a long step it linearises again about the answer, with the l1 penalty on the total increment.
The published pose is the solved state, smoothed over a few frames (`smoothing`); the next frame starts from the
state as solved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lassokin_ros.core.answer import Answer
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.proportions import symmetric_skeleton
from lassokin_ros.core.body.roles import missing_roles
from lassokin_ros.core.body.rotations import orthonormalised
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.cameras import Cameras
from lassokin_ros.core.config import GIVEN, LEARN, TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.start import FIT_AFTER, Start, Starts
from lassokin_ros.core.image.frame_data import FrameData, View
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.image.projection import squared_norm
from lassokin_ros.core.increment import Increment, IncrementSolver
from lassokin_ros.core.learned.camera_finder import UnplacedCameras
from lassokin_ros.core.learned.learned import Learned
from lassokin_ros.core.observation import HERE, CameraPose, Observation, Rejection, StampUnit, Status, is_longer
from lassokin_ros.core.output.smoothing import Backward, Smoothing
from lassokin_ros.core.output.uncertainty import JointUncertainty, UncertaintyModel

SMALLEST_PX = 3.0
"""Height of the person in the image, in noise_px, below which a body is rejected: random keypoints fit far away."""
FARTHEST_FLOOR = 1e12
"""m: largest distance of a floor from the origin. With larger ones the computations overflow."""


class Tracker:
    """Tracks one person. Its state is that of the body, and what was learned until `reset`."""

    def __init__(
        self,
        config: TrackerConfig | None = None,
        skeleton: Skeleton | None = None,
        evidence: Sequence[Evidence] = (),
        up: np.ndarray | None = None,
    ) -> None:
        """Build the tracker for one skeleton and one landmark layout.

        skeleton: in place of the configured one. evidence: further pieces of evidence for each frame's lasso, see
        docs/extending.md. up: (3,) the vertical of the fixed frame in which the cameras' places are given, of any
        length; None if the skeleton is kept in the first camera's optical frame, whose mount the settings give. Raises
        a LassokinError (skeleton, layout, solver or setting) for a configuration that cannot be used.
        """
        self.config = (config or TrackerConfig()).checked()
        self.given_skeleton = skeleton or Skeleton.load(self.config.skeleton, self.config.assumed_height)
        """The body before anything is learned, at the configured height."""
        body, _ = symmetric_skeleton(self.given_skeleton, self.config.calibrate)
        prior = PoseDistribution.load(body)
        self.frame_model = FrameModel(Kinematics(body, Layout.load(self.config.landmarks, body)), prior, evidence)
        self.learned = Learned(self.frame_model, self.config, None if up is None else _unit_vertical(up))
        self._cameras = Cameras(self.kinematics, self.config.depth_prior, self.learned, self.frame_model.add_camera)
        self._increments = IncrementSolver(self.frame_model, prior, self.config.solver)
        places = None if self._cameras[0].network is None else self._cameras.network_places
        self._starts = Starts(self.frame_model, prior, self.learned.vertical, places, self.config.depth_prior)
        self._unplaced, self._smoothing = UnplacedCameras(self._alone), Smoothing(self.kinematics)
        self.floor_below = None
        self._uncertainty = UncertaintyModel(self.frame_model, prior, self.learned.lengths.proportions)
        self.backward: Callable[[float], Backward | None] | None = None
        """The frame at a stamp, s, by a track backward in time; `published` is then between both, see `recording`."""
        self._stamp_unit = StampUnit()
        self.reset()

    def reset(self, same_camera: bool = False) -> None:
        """Forget the state; the next usable frame initialises anew.

        same_camera: True if the cameras stay as they are and only the person changes: the learned vertical and the
        corrections of the cameras' poses are kept.
        """
        self._forget_state()
        if self.learned.height is not None and self.learned.height.measured:
            self.learned.resize(self.given_skeleton.height / self.skeleton.height)
        self.learned.reset(same_camera)
        self._use_body()

    def begin_take(self) -> None:
        """Forget the state: the next frame shows the same person from elsewhere. What is known of the person stays."""
        self._forget_state()
        self.learned.begin_take()

    def _forget_state(self) -> None:
        self._solved: EvaluatedState | None = None
        self._status = Status.SEARCHING
        parts: list[Any] = [*self._cameras, self._increments, self._starts, self._smoothing, self._unplaced]
        for part in parts:
            part.reset()
        self.published: list[Estimate] = []
        """Estimates that became due with the last observation, in order: that observation's own, or with
        `smoothing_lag` earlier ones, smoothed, each with the stamp of its own frame."""

    @property
    def state(self) -> BodyState | None:
        """The present state; None before the first usable frame."""
        return None if self._solved is None else self._solved.state

    @property
    def kinematics(self) -> Kinematics:
        """The body in use."""
        return self.frame_model.kinematics

    @property
    def averaged(self) -> float:
        """Difference of left and right of the given skeleton if calibration starts with their mean, else 0."""
        return symmetric_skeleton(self.given_skeleton, self.config.calibrate)[1]

    @property
    def skeleton(self) -> Skeleton:
        """The body with the lengths as they are known now."""
        return self.kinematics.skeleton

    @property
    def floor_below(self) -> float | None:
        """m: how far a flat floor is below the origin of the skeleton's frame; None for `camera_height`.

        Raises ConfigurationError, when it is set, for a number that is not finite or beyond `FARTHEST_FLOOR`.
        """
        return self._floor_below

    @floor_below.setter
    def floor_below(self, below: float | None) -> None:
        if below is not None and not abs(below) <= FARTHEST_FLOOR:
            raise ConfigurationError(f"floor_below is {below}; expected metres, up to {FARTHEST_FLOOR:g}, or None")
        self._floor_below = below

    @property
    def floor(self) -> np.ndarray | None:
        """See `FrameData.floor`. The learned vertical is not used: it is off by 5 degrees in the median."""
        up, below = self.learned.vertical.mount, self.floor_below
        if below is None and self.config.camera_height:
            below = self.config.camera_height - float(up @ self._cameras[0].pose.centre)
        return None if below is None else np.append(up, below)

    @property
    def layout(self) -> Layout:
        """The landmarks, on this body."""
        return self.kinematics.layout

    @property
    def limitations(self) -> str:
        """What is off because joints or landmarks are missing, in one line; empty if nothing is."""
        off = missing_roles(self.skeleton.joint_names)
        if not off and self.config.depth_prior and self._starts.network_pose is None:
            return f"layout '{self.layout.name}' has too few of the points that the depth network needs; it is off"
        return off

    def place_cameras(self, poses: Sequence[CameraPose]) -> None:
        """Tell where cameras without an image of the next instant are then: their keypoints are predicted to it."""
        self._cameras.place(poses)

    def move_frame(self, rotation: np.ndarray, translation: np.ndarray) -> None:
        """Keep the body where it is although its frame has moved: x is at rotation x + translation from now on.

        rotation: (3, 3), about the vertical; translation: (3,) m.
        """
        for camera in self._cameras:
            camera.move_frame(rotation, translation)
        self.learned.extrinsics.move_frame(CameraPose("", rotation, translation))
        if self._solved is None:
            return
        state = self._solved.state
        rotations = np.concatenate([rotation @ state.rotations[:1], state.rotations[1:]])
        self._solved = self.frame_model.evaluate(BodyState(rotations, rotation @ state.translation + translation))
        self._starts.replaced = True

    def tune(self, config: TrackerConfig) -> None:
        """Use new live settings; the others stay as they are.

        A new height scales the given body, and makes the tracker forget the person; so does `calibrate` if another body
        results, see `averaged`. Raises ConfigurationError, before anything is changed, for a setting out of its range.
        """
        before, averaged_before, config = self.config, self.averaged, self.config.with_live_of(config)
        given = self.given_skeleton.at_height(config.assumed_height)  # raises for a height out of range
        body, averaged = symmetric_skeleton(given, config.calibrate)
        self.config = config
        if config.height != before.height or averaged != averaged_before:
            self.reset()
            self.given_skeleton = given
            self.learned.use_body(body, config.height == 0)
            self._use_body()
        if (config.camera_roll, config.camera_pitch) != (before.camera_roll, before.camera_pitch):
            self.learned.vertical.set_mount(config.camera_roll, config.camera_pitch)

    def track(self, observation: Observation | Sequence[Observation]) -> Estimate:
        """Process one observation, or those of several cameras, which are solved jointly.

        Observations that are given together are of one instant: their stamps differ by 5 ms at most. Other cameras take
        part with keypoints predicted to that instant. Bad input does not raise: see `Estimate.rejection`.
        """
        observations = [observation] if isinstance(observation, Observation) else list(observation)
        self.published = []
        if not observations:
            return Estimate(self._cameras.newest, self._status, Rejection.TOO_FEW_LANDMARKS)
        self._stamp_unit.add(observations[0].stamp)
        extrinsics, known = self.learned.extrinsics, all(one.camera.known for one in observations)
        if len(observations) > 1 or len(self._cameras) > 1 or not known:
            observations = [replace(one, camera=extrinsics.received(one.camera)) for one in observations]
        placed = [one for one in observations if one.camera.known]
        estimate = self._track(placed) if placed else self._reject(observations[0], Rejection.UNPLACED)
        if self.config.extrinsics == LEARN and len(placed) < len(observations):
            self._unplaced.find([one for one in observations if not one.camera.known], self, extrinsics)
        return estimate

    def _track(self, observations: Sequence[Observation]) -> Estimate:
        """Process the observations of placed cameras, of one instant."""
        cameras, first = self._cameras, observations[0]
        body = None if self._solved is None else self._solved.pose
        measured, rejection = cameras.measure(observations, body, self.config)
        if rejection is not None:
            return self._reject(first, rejection)
        together = cameras.together(measured, self.config.lost_after)
        frame = cameras.frame(measured, together.stamp, body, self.floor, first.extra)
        if len(cameras) > 1 and not together.repeated:  # also if the lasso has no answer
            self.learned.extrinsics.update(together.stamp, frame)
        if frame.point_count < self.config.min_landmarks:
            return self._reject(first, Rejection.TOO_FEW_LANDMARKS)
        start = self._starts.start(self._solved, together, frame)
        increment = self._solve(start, frame, together)
        rejection = self._check(start.state.state, increment, frame, together.focal)
        self._starts.note(rejection is None)
        if rejection is not None:
            return self._reject(first, rejection, increment)
        moved = start.state.state.retract(increment.omega, increment.x)
        rotations = self.kinematics.on_axes(orthonormalised(moved.rotations))
        solved = self.frame_model.evaluate(BodyState(rotations, moved.translation))
        answer = Answer(cameras, measured, together, frame, start, increment, solved)
        smoothed = self._smoothing.smoothed(answer, self.config.smoothing)
        better = self._starts.better(answer)
        restarted = start.initialised or better is not None
        self.learned.follow_feet(answer, restarted or start.replaced, self.config.hold_feet)
        estimate = self._estimate(answer, smoothed)
        for camera, one in measured.items():
            camera.measurements.mark_used(one)
        backward = None if self.backward is None else self.backward(estimate.stamp)
        self.published = self._smoothing.publish(estimate, answer, self.config.smoothing_lag, backward)
        self._solved = better or solved
        changed, ratio = self.learned.update(answer, restarted, self.config)
        if ratio != 1.0:
            self._resize(ratio, None if answer.several else frame.seeing.camera.centre)
        elif changed:
            self._use_body()
        return estimate

    def flush(self) -> list[Estimate]:
        """The estimates that still wait for `smoothing_lag`, in order. Call it after the last observation."""
        return self._smoothing.flush()

    def uncertainty(self, estimate: Estimate) -> JointUncertainty:
        """The uncertainty of an accepted estimate, computed on request. Raises ValueError for a rejected frame."""
        if not estimate.accepted:
            raise ValueError("only an accepted estimate has an uncertainty; this frame was rejected")
        return self._uncertainty.evaluate(estimate)

    def seen_at(self, stamp: float) -> tuple[View, np.ndarray] | None:
        """What a camera sees of the person at a stamp, s, and the joints (n, 3) m; None if the last image is older."""
        if self._solved is None or is_longer(stamp - self._cameras.newest, FIT_AFTER):
            return None
        return self._cameras.seen_at(stamp, self._solved.pose), self._solved.pose.positions

    def observed(self, estimate: Estimate) -> np.ndarray:
        """Return (n,) bool, the joints that keypoints observe. Raises ValueError for a rejected frame."""
        if estimate.visible is None:
            raise ValueError("this frame was rejected; only an accepted estimate has observed joints")
        return self._uncertainty.observed.from_visible(estimate.visible)

    def _alone(self) -> Tracker:
        """A tracker of the same person by one camera without a pose; settings of the mount are about the first one."""
        body = self.learned.lengths.proportions.given
        config = replace(self.config, extrinsics=GIVEN, height=body.height)
        return Tracker(replace(config, camera_roll=0.0, camera_pitch=0.0, camera_height=0.0, tilt_deviation=0.0), body)

    def _solve(self, start: Start, frame: FrameData, measurement: Measurement) -> Increment:
        """The frame's increment, with the feet that stand still held unless the pose does not continue the last one."""
        step = measurement.step if self._starts.network_pose is not None and not start.initialised else 0.0
        feet = self.learned.feet
        if any(feet.standing) and not (start.initialised or start.replaced or measurement.repeated):
            frame = frame.held(feet.anchors, feet.stiffness)
        return self._increments.solve(start.state, frame, step, self.config)

    def _check(self, start: BodyState, increment: Increment, frame: FrameData, focal: float) -> Rejection | None:
        """The reason to reject an answer, None to accept it."""
        place = start.translation + increment.x
        depth = min(float(view.camera.into_camera(place)[2]) for view in frame.views if view.weights.any())
        if not increment.solution.certified:
            return Rejection.NOT_CERTIFIED
        if self.skeleton.height * focal < SMALLEST_PX * self.config.noise_px * depth or depth <= 0:
            return Rejection.TOO_SMALL  # or behind the camera; the image cannot correct either
        return None

    def _estimate(self, answer: Answer, smoothed: BodyState) -> Estimate:
        """The estimate for an accepted frame. smoothed: the state to publish."""
        self._status, pose = Status.TRACKING, self.kinematics.pose(smoothed)
        solved = answer.solved
        network_pose = self._starts.network_pose
        return Estimate(
            answer.stamp,
            self._status,
            state=smoothed,
            pose=pose,
            solved=solved.state,
            increment=answer.increment,
            frame=answer.frame,
            initialised=answer.start.initialised,
            repeated=answer.together.repeated,
            reprojection_px=answer.reprojection_px(pose),
            cost=self._starts.cost,
            visible=answer.visible,
            keypoint_error_ratio=self.learned.model_error.ratio,
            length_deviation=self.learned.lengths.deviation,
            size_deviation=self.learned.size_deviation,
            place_covariance=self.learned.place_covariance(answer),
            still=self.learned.still,
            contacts=self.learned.contacts(pose.positions),
            up=self.learned.vertical.direction,
            prior_cost=0.5 * float(squared_norm(solved.posture.residual[self.frame_model.prior.body_rows])),
            network_distance=math.nan if network_pose is None else network_pose.distance(solved.pose),
        )

    def _resize(self, ratio: float, centre: np.ndarray | None) -> None:
        """Scale the body and what was learned, and its distance from the centre (3,) m of the only camera.

        centre: None if several cameras observe where the body is.
        """
        self.learned.resize(ratio, centre)
        for alone in self._unplaced.trackers.values():
            alone._resize(ratio, HERE.centre)
        if centre is not None and self._solved is not None:
            self._solved = replace(self._solved, state=self._solved.state.scaled_about(centre, ratio))
        self._smoothing.filter.reset()
        self._use_body()

    def _use_body(self) -> None:
        """Use the lengths and the prior as they are known now."""
        self.kinematics.set_skeleton(self.learned.lengths.skeleton)
        self._cameras.use_lengths()
        if self._solved is not None:
            self._solved = self.frame_model.evaluate(self._solved.state)

    def _reject(self, observation: Observation, rejection: Rejection, increment: Increment | None = None) -> Estimate:
        """The estimate for a rejected frame. The state stays; the status becomes LOST after too long a time."""
        if self._solved is None:
            for camera in self._cameras:
                camera.measurements.forget()
        if rejection is not Rejection.NOT_FINITE:  # the stamp can be used
            if self._solved is not None and is_longer(observation.stamp - self._cameras.newest, self.config.lost_after):
                self._status = Status.LOST
            self.published = self._smoothing.due(observation.stamp, self.config.smoothing_lag)
        return Estimate(observation.stamp, self._status, rejection, increment=increment)


def _unit_vertical(up: np.ndarray) -> np.ndarray:
    """Return the vertical (3,) with length 1. Raises ConfigurationError."""
    found = np.asarray(up)
    length = np.linalg.norm(found) if found.shape == (3,) and found.dtype.kind in "fiu" else 0.0
    if not 0.0 < length < np.inf:
        raise ConfigurationError(
            f"up is {found.tolist()}; expected the vertical of the fixed frame, (3,) finite numbers that are not all "
            "0, such as [0, 0, 1]"
        )
    return np.asarray(found / length)
