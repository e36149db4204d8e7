"""The tracker: one observation in, one estimate out.

    tracker = Tracker(TrackerConfig(height=1.75))
    estimate = tracker.track(Observation(stamp, points, confidence, focal))

The tracker follows the paper's method frame by frame in a closed loop. It compares the observation with the projection
of the present state (not with the last observation, which would drift), linearises the model about that state (12),
solves the lasso for the increment of all joints and the translation, certifies the answer, and retracts it onto SO(3).
With `relinearisations` above 1 it linearises again about the answer, with the l1 penalty on the total increment.
The published pose is the solved state, smoothed over a few frames (`output_filter`); the next frame starts from the
state as solved. With `smoothing_lag`, `track` still returns the newest frame's estimate, and `published` holds the
estimates that have become due.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.roles import missing_roles
from lassokin_ros.core.body.rotations import orthonormalised
from lassokin_ros.core.body.skeleton import Skeleton, has_built_in_proportions
from lassokin_ros.core.body.symmetry import symmetric_skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.initialisation import Fit, Initialiser
from lassokin_ros.core.hypotheses.mirrored_limbs import MirroredLimbs
from lassokin_ros.core.hypotheses.network_pose import NetworkPose
from lassokin_ros.core.hypotheses.other_pose import OtherPose
from lassokin_ros.core.hypotheses.reinitialisation import COST_SHARE, Reinitialisation
from lassokin_ros.core.image.depth_gating import depth_of_own_surface
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.gating import gate_observation
from lassokin_ros.core.image.measurement import Measurement, MeasurementFilter
from lassokin_ros.core.increment import Increment, IncrementSolver
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.learned.learned import Learned
from lassokin_ros.core.network.depth_estimator import DepthEstimator
from lassokin_ros.core.network.depth_network import shipped_network
from lassokin_ros.core.observation import Observation, Rejection, Status
from lassokin_ros.core.output.fixed_lag import FixedLag
from lassokin_ros.core.output.observed import ObservedJoints
from lassokin_ros.core.output.output_filter import OutputFilter
from lassokin_ros.core.output.uncertainty import JointUncertainty, UncertaintyModel

SMALLEST_PX = 3.0
"""Height of the person in the image, in noise_px, below which a body is rejected: random keypoints fit far away."""
STUCK_AFTER = 3
"""Consecutive frames without a usable answer (no certificate, behind the camera, too small) until the tracker
initialises anew."""
GOOD_FIT = 3.0
"""Cost per visible landmark up to which a fit that started from the network's pose is used without another search."""
FIT_AFTER = 0.15
"""s since the last new keypoints from which the frame starts from a fit, because the last state is too old. Without it,
validation people at 5 Hz have 51.0 instead of 49.3 mm."""


class Tracker:
    """Tracks one person.

    Its state is the body's state and what was learned about the person, the keypoints and the camera until `reset`.
    """

    def __init__(
        self, config: TrackerConfig | None = None, skeleton: Skeleton | None = None, evidence: Sequence[Evidence] = ()
    ) -> None:
        """Build the tracker for one skeleton and one landmark layout.

        skeleton: in place of the configured one. evidence: further pieces of evidence for each frame's lasso, see
        docs/extending.md. Raises a LassokinError (skeleton, layout, solver or setting) for a configuration that cannot
        be used.
        """
        self.config = (config or TrackerConfig()).checked()
        self.given_skeleton = skeleton or Skeleton.load(self.config.skeleton, self.config.assumed_height)
        """The body before anything is learned, at the configured height."""
        body, self.averaged = symmetric_skeleton(self.given_skeleton, self.config.calibrate)
        self.kinematics = Kinematics(body, Layout.load(self.config.landmarks, body))
        prior = PoseDistribution.load(body)
        self.frame_model = FrameModel(self.kinematics, prior, evidence)
        self.learned = Learned(self.frame_model, self.config)
        self._measurements = MeasurementFilter(self.kinematics)
        self._network = self._depth_estimator()
        self._increments = IncrementSolver(self.frame_model, prior, self.config.solver)
        self._initialiser = Initialiser(self.kinematics, prior, self.frame_model)
        self._network_pose = None
        propose = MirroredLimbs(self.kinematics).propose
        if self._network is not None:
            mean_pose = self._initialiser.mean_pose
            self._network_pose = NetworkPose(self._network, self.kinematics, mean_pose)
            propose = self._network_pose.propose
        self._other_pose = OtherPose(self._initialiser, self.frame_model, propose)
        self._reinitialisation = Reinitialisation()
        self._output_filter, self._lag = OutputFilter(self.kinematics.joint_count), FixedLag(self.kinematics)
        self._observed = ObservedJoints(body, self.layout.joints)
        self._uncertainty = UncertaintyModel(self.frame_model, prior, self.learned.lengths.proportions, self._observed)
        self.reset()

    def _depth_estimator(self) -> DepthEstimator | None:
        """The depth network's estimator; None if it is switched off or cannot be used with this skeleton and layout."""
        if not (self.config.depth_prior and DepthEstimator.fits(self.kinematics)):
            return None
        return DepthEstimator(shipped_network(), self.kinematics)

    def reset(self, same_camera: bool = False) -> None:
        """Forget the state; the next usable frame initialises anew.

        same_camera: True if the camera stays as it is and only the person changes: the learned vertical is kept.
        """
        self._solved: EvaluatedState | None = None
        self._replaced = False  # whether the next frame starts from another state than the last one solved
        self._status, self._stuck_frames, self._cost = Status.SEARCHING, 0, float("nan")
        self._measurements.reset()
        self._increments.reset()
        self._reinitialisation.reset()
        self._output_filter.reset()
        self._lag.reset()
        self._other_pose.reset()
        if self._network is not None:
            self._network.reset()
        if self.learned.height is not None and self.learned.height.measured:
            self.learned.resize(self.given_skeleton.height / self.skeleton.height)
        self.learned.reset(same_camera)
        self.published: list[Estimate] = []
        """Estimates that became due with the last observation, in order: that observation's own, or with
        `smoothing_lag` earlier ones, smoothed, each with the stamp of its own frame."""
        self._adopt_lengths()

    @property
    def state(self) -> BodyState | None:
        """The present state; None before the first usable frame."""
        return None if self._solved is None else self._solved.state

    @property
    def skeleton(self) -> Skeleton:
        """The body with the lengths as they are known now."""
        return self.kinematics.skeleton

    @property
    def layout(self) -> Layout:
        """The landmarks, on this body."""
        return self.kinematics.layout

    @property
    def limitations(self) -> str:
        """What is off because joints or landmarks are missing, in one line; empty if nothing is."""
        off = missing_roles(self.skeleton.joint_names)
        if not off and self.config.depth_prior and self._network is None:
            return f"layout '{self.layout.name}' has too few of the points that the depth network needs; it is off"
        return off

    def adopt_vertical(self, others: Iterable[Tracker]) -> None:
        """Copy the camera's vertical from trackers of other people in the same images, if one has learned it."""
        self.learned.vertical.adopt(other.learned.vertical for other in others)

    def move_camera(self, roll: float, pitch: float) -> None:
        """Use a measured mount of the camera, rad, from the next frame on; see `camera_roll` and `camera_pitch`.

        The state stays: the camera may be on a head that moves.
        """
        self.learned.vertical.move_mount(roll, pitch)

    def tune(self, config: TrackerConfig) -> None:
        """Use new live settings. The others (skeleton, landmarks, depth_prior, solver) stay as they are.

        A new height scales the given body, and makes the tracker forget the person. Raises ConfigurationError, before
        anything is changed, for a setting out of its range.
        """
        before, config = self.config, self.config.with_live_of(config)
        given = self.given_skeleton.at_height(config.assumed_height)  # raises for a height out of range
        self.config = config
        if config.height != before.height:
            self.reset()
            self.given_skeleton = given
            self.learned.use_body(symmetric_skeleton(given, self.averaged > 0)[0], config.height == 0)
            self._adopt_lengths()
        if (config.camera_roll, config.camera_pitch) != (before.camera_roll, before.camera_pitch):
            self.learned.vertical.set_mount(config.camera_roll, config.camera_pitch)

    def track(self, observation: Observation) -> Estimate:
        """Process one observation. Bad input does not raise: see `Estimate.rejection`."""
        rejection, weights = gate_observation(observation, self._measurements.newest, self.layout, self.config)
        if rejection is not None:
            return self._reject(observation, rejection)
        measurement = self._filter(observation, weights)
        if np.count_nonzero(measurement.used) < self.config.min_landmarks:
            return self._reject(observation, Rejection.TOO_FEW_LANDMARKS)
        frame = self._frame_data(measurement, observation)
        start, initialised = self._start(measurement, frame)
        increment = self._solve(start, initialised, frame, measurement)
        rejection = self._check(start.state, increment, measurement.focal)
        if rejection is not None:
            return self._reject(observation, rejection, increment.solution.certificate)
        solved = self._retract(start.state, increment)
        smoothed = self._smooth(solved, increment, measurement, initialised)
        better = self._better_state(solved, frame, measurement, initialised)
        estimate = self._estimate(measurement, frame, initialised, increment, solved, smoothed)
        self._measurements.mark_used(measurement)
        self._publish(estimate, measurement)
        self._solved, self._replaced = better or solved, better is not None
        self._learn(measurement, frame, start, initialised, increment, solved)
        return estimate

    def flush(self) -> list[Estimate]:
        """The estimates that still wait for `smoothing_lag`, in order. Call it after the last observation."""
        return self._lag.flush()

    def uncertainty(self, estimate: Estimate) -> JointUncertainty:
        """The uncertainty of an accepted estimate, computed on request. Raises ValueError for a rejected frame."""
        if estimate.pose is None or estimate.problem is None:
            raise ValueError("only an accepted estimate has an uncertainty; this frame was rejected")
        return self._uncertainty.evaluate(estimate)

    def observed(self, estimate: Estimate) -> np.ndarray:
        """Return (n,) bool, the joints that keypoints observe. Raises ValueError for a rejected estimate."""
        if estimate.visible is None:
            raise ValueError("this frame was rejected; only an accepted estimate has observed joints")
        return self._observed.from_visible(estimate.visible)

    def _filter(self, observation: Observation, weights: np.ndarray) -> Measurement:
        """The frame's keypoints and depths after the filter of their tracks."""
        depth = None
        if self._solved is not None:
            depth = float(self._solved.state.translation[2])
            if observation.depth is not None and observation.depth_of_surface:
                own = depth_of_own_surface(observation.depth, self._solved.pose, self.kinematics)
                observation = replace(observation, depth=own)
        error = self.learned.model_error.deviation
        measurement = self._measurements.filtered(observation, weights, depth, error, self.config)
        return self.learned.depth_noise.update(measurement, observation.depth_age)

    def _frame_data(self, measurement: Measurement, observation: Observation) -> FrameData:
        """The frame's measurements, with the depths that the network estimates from this frame and earlier ones.

        Measured depths are left out as long as the person's size is unknown.
        """
        sized = self.learned.height is None or self.learned.height.measured
        depth, depth_weights = (measurement.depth, measurement.depth_weights) if sized else (None, None)
        vertical, joint_depths = self.learned.vertical, None
        if self._network is not None:
            if measurement.lost:
                self._network.reset()
            if measurement.lost or not measurement.repeated:
                up = vertical.direction if vertical.known else None
                self._network.update(measurement.stamp, measurement.points, measurement.used, up, vertical.mount)
            joint_depths = self._network.joint_depths
        points, weights = measurement.points, measurement.weights
        return FrameData(points, weights, vertical.direction, depth, depth_weights, joint_depths, observation.extra)

    def _start(self, measurement: Measurement, frame: FrameData) -> tuple[EvaluatedState, bool]:
        """The state about which the frame is linearised, and whether it is a first one, fitted to this frame alone."""
        if self._solved is None or measurement.lost or self._stuck_frames >= STUCK_AFTER:
            fit = self._first_fit(frame)
            self._cost = fit.cost
            return self.frame_model.evaluate(fit.state), True
        if self._network_pose is None:
            return self._start_without_network(self._solved, measurement, frame)
        if measurement.since_new_keypoints < FIT_AFTER:
            return self._solved, False
        starts = self._solved.state, self._network_pose.state()
        fits = [self._initialiser.fit_near(start, frame) for start in starts if start is not None]
        self._replaced = True
        return self.frame_model.evaluate(min(fits, key=lambda fit: fit.cost).state), False

    def _start_without_network(
        self, tracked: EvaluatedState, measurement: Measurement, frame: FrameData
    ) -> tuple[EvaluatedState, bool]:
        """The tracked state, or a newly fitted one if the cost stays high and that one explains the frame better."""
        count = self.kinematics.landmark_count + measurement.depth_count
        if measurement.repeated or not self._reinitialisation.due(measurement.stamp, self._cost, count):
            return tracked, False
        fit = self._initialiser.fit(frame)
        if not fit.cost < COST_SHARE * self._cost:
            return tracked, False
        self._cost = fit.cost
        return self.frame_model.evaluate(fit.state), True

    def _first_fit(self, frame: FrameData) -> Fit:
        """A state from one frame: from the network's pose if that explains the frame, else from all start poses."""
        start = None if self._network_pose is None else self._network_pose.state()
        if start is None:
            return self._initialiser.fit(frame)
        near = self._initialiser.fit_near(start, frame)
        if near.cost <= GOOD_FIT * np.count_nonzero(frame.weights):
            return near
        return min(self._initialiser.fit(frame), near, key=lambda fit: fit.cost)

    def _solve(self, start: EvaluatedState, initialised: bool, frame: FrameData, measurement: Measurement) -> Increment:
        """The increment from the start state, by the frame's lasso."""
        step = 0.0 if initialised or self._network is None else measurement.step
        return self._increments.solve(start, frame, step, self.config)

    def _check(self, start: BodyState, increment: Increment, focal: float) -> Rejection | None:
        """The reason to reject an answer, None to accept it. Counts consecutive rejections."""
        depth = start.translation[2] + increment.x[2]
        rejection = None
        if not increment.solution.certified:
            rejection = Rejection.NOT_CERTIFIED
        elif self.skeleton.height * focal < SMALLEST_PX * self.config.noise_px * depth or depth <= 0:
            rejection = Rejection.TOO_SMALL  # or behind the camera; the image cannot correct either
        self._stuck_frames = 0 if rejection is None else self._stuck_frames + 1
        return rejection

    def _retract(self, start: BodyState, increment: Increment) -> EvaluatedState:
        """The state after a certified increment."""
        moved = start.retract(increment.omega, increment.x)
        return self.frame_model.evaluate(BodyState(orthonormalised(moved.rotations), moved.translation))

    def _smooth(
        self, solved: EvaluatedState, increment: Increment, measurement: Measurement, initialised: bool
    ) -> BodyState:
        """The state to publish."""
        if initialised or self._replaced:
            self._output_filter.reset()  # the motion of the replaced state does not go on
        smoothing = self.config.smoothing
        return self._output_filter.filtered(solved, increment, measurement.step, measurement.speed, smoothing)

    def _better_state(
        self, solved: EvaluatedState, frame: FrameData, measurement: Measurement, initialised: bool
    ) -> EvaluatedState | None:
        """The state from which the next frame starts, if another pose explains this frame better."""
        if initialised or measurement.repeated:
            return None
        self._cost = float(self.frame_model.cost(solved, frame))
        better = self._other_pose.better_state(measurement.stamp, frame, solved, self._cost)
        return None if better is None else self.frame_model.evaluate(better)

    def _estimate(
        self,
        measurement: Measurement,
        frame: FrameData,
        initialised: bool,
        increment: Increment,
        solved: EvaluatedState,
        smoothed: BodyState,
    ) -> Estimate:
        """The estimate for an accepted frame. solved: the state of its lasso; smoothed: the state to publish."""
        self._status = Status.TRACKING
        pose = self.kinematics.pose(smoothed)
        return Estimate(
            measurement.stamp,
            self._status,
            state=smoothed,
            pose=pose,
            omega=increment.omega,
            translation_step=increment.x,
            certificate=increment.solution.certificate,
            reprojection_px=measurement.reprojection_px(pose),
            initialised=initialised,
            problem=increment.problem,
            rows=increment.rows,
            solution=increment.solution,
            solved=solved.state,
            cost=self._cost,
            keypoint_error_ratio=self.learned.model_error.ratio,
            repeated=measurement.repeated,
            visible=measurement.visible & measurement.used,
            measurements=measurement.count,
            depth_measured=frame.depth_weights is not None,
            depth_covers=frame.depth_covers,
            length_deviation=self.learned.lengths.deviation,
            joint_depths=frame.joint_depths,
        )

    def _learn(
        self,
        measurement: Measurement,
        frame: FrameData,
        start: EvaluatedState,
        initialised: bool,
        increment: Increment,
        solved: EvaluatedState,
    ) -> None:
        """Update all that is learned from an accepted frame, and use it from the next frame on."""
        if self.config.calibrate and (initialised or not measurement.repeated):
            if self.learned.lengths.update(measurement.stamp, solved.state, frame, initialised or self._replaced):
                self._adopt_lengths()
        if self.learned.update(measurement, start.state, initialised, increment, solved.state):
            self._solved = self._evaluated_again()  # the prior's mean has changed
        height = self.learned.height
        if height is not None and height.update(measurement, solved, self.skeleton.height):
            self._adopt_height(height.height / self.skeleton.height)

    def _adopt_lengths(self) -> None:
        """Use the lengths as they are known now."""
        lengths = self.learned.lengths
        self.kinematics.set_skeleton(lengths.skeleton)
        if self._network is not None and has_built_in_proportions(self.given_skeleton):
            self._network.use_lengths(self.skeleton, lengths.certain)
        self._solved = self._evaluated_again()

    def _adopt_height(self, ratio: float) -> None:
        """Scale the body, its distance, and what was learned."""
        assert self._solved is not None
        self.learned.resize(ratio)
        state = self._solved.state
        self._solved = replace(self._solved, state=BodyState(state.rotations, ratio * state.translation))
        self._output_filter.reset()
        self._adopt_lengths()

    def _evaluated_again(self) -> EvaluatedState | None:
        """The present state with the present body and prior."""
        return None if self._solved is None else self.frame_model.evaluate(self._solved.state)

    def _publish(self, estimate: Estimate, measurement: Measurement) -> None:
        """Collect the estimates that are due."""
        if self.config.smoothing_lag == 0 and self._lag.empty:
            self.published = [estimate]
            return
        assert self._output_filter.forward is not None
        self._lag.add(estimate, self._output_filter.forward, self.skeleton.offsets, measurement.reprojection_px)
        self.published = self._lag.due(estimate.stamp, self.config.smoothing_lag)

    def _reject(
        self, observation: Observation, rejection: Rejection, certificate: Certificate | None = None
    ) -> Estimate:
        """The estimate for a rejected frame. The state stays; the status becomes LOST after too long a time."""
        if self._solved is None:
            self._measurements.forget()
        self.published = []
        if rejection is not Rejection.NOT_FINITE:  # the stamp can be used
            if self._solved is not None and observation.stamp - self._measurements.newest > self.config.lost_after:
                self._status = Status.LOST
            self.published = self._lag.due(observation.stamp, self.config.smoothing_lag)
        return Estimate(observation.stamp, self._status, rejection, certificate=certificate)
