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

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.core.batch import BatchedCall, Steps, run_batched, run_single
from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.body.rotations import orthonormalised
from lassokin_ros.core.calibration.height import HeightEstimator
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.hypotheses.initialisation import Fit
from lassokin_ros.core.hypotheses.replacement import FIT_AFTER, reinitialisation_replaces
from lassokin_ros.core.image.depth_gating import of_own_surface
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.gating import gate_observation
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.increment import Increment, for_step
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.observation import Observation, Rejection, Status
from lassokin_ros.core.output.uncertainty import JointUncertainty
from lassokin_ros.core.tracker_parts import TrackerParts

SMALLEST = 3.0
"""Height of the person in the image, in noise_px, below which a body is rejected: random keypoints fit far away."""

STUCK_AFTER = 3
"""Consecutive frames without a usable answer (no certificate, behind the camera, too small) until the tracker
initialises anew."""

GOOD_FIT = 3.0
"""Cost per visible landmark up to which a fit that started from the network's pose is used without another search."""

VERTICAL_AFTER = 1.0
"""s for which the vertical must have been learned before it is input to the depth network."""


class Tracker(TrackerParts):
    """Tracks one person.

    Its state is the body's state and what was learned about the person, the keypoints and the camera until `reset`.
    """

    def track(self, observation: Observation) -> Estimate:
        """Process one observation. Bad input does not raise: see `Estimate.rejection`."""
        return run_single(self.steps(observation))

    @staticmethod
    def track_batch(trackers: Sequence[Tracker], observations: Sequence[Observation]) -> list[Estimate]:
        """Process one observation with each of several trackers. This is faster than one after another.

        The estimates equal those of `track` up to rounding. Raises ConfigurationError if the trackers have different
        layouts or different trees of joints.
        """
        if len({(tracker.layout.names, tracker.skeleton.parents.tobytes()) for tracker in trackers}) > 1:
            raise ConfigurationError("trackers of one batch must have the same layout and the same tree of joints")
        pairs = zip(trackers, observations, strict=True)
        return run_batched([tracker.steps(observation) for tracker, observation in pairs])

    def steps(self, observation: Observation) -> Steps[Estimate]:
        """The steps of the method for one frame, as a generator for `run_single` or `run_batched` (see `batch`)."""
        rejection, weights = gate_observation(observation, self._measurements.newest, self.layout, self.config)
        if rejection is not None:
            return self._reject(observation, rejection)
        measurement = self._filter_keypoints(observation, weights)
        if np.count_nonzero(measurement.used) < self.config.min_landmarks:
            return self._reject(observation, Rejection.TOO_FEW_LANDMARKS)
        frame = yield from self._with_learned_depth(measurement)
        fit = self._initialise(measurement, frame)
        if fit is None and measurement.news >= FIT_AFTER:
            self._fit_after_long_step(frame)
        start, increment = yield from self._solve_increment(fit, frame, measurement)
        rejection = self._check_answer(start, increment, measurement.focal)
        if rejection is not None:
            return self._reject(observation, rejection, increment.solution.certificate)
        solved = yield from self._accept_increment(start, fit, increment, measurement, frame)
        smoothed = self._smooth(solved, increment, measurement)
        estimate = self._estimate(measurement, frame, fit, increment, solved.state, smoothed)
        self._measurements.mark_used(measurement)
        offsets = self.skeleton.offsets
        self._learn(measurement, frame, start, fit, increment)
        self._publish(estimate, offsets, measurement)
        if self.height is not None:
            self._measure_height(self.height, measurement, frame)
        else:
            self.size_check.update(measurement)
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

    def _filter_keypoints(self, observation: Observation, weights: np.ndarray) -> Measurement:
        depth = None if self._state is None else float(self._state.translation[2])
        if depth is not None and observation.depth is not None and observation.depth_of_surface:
            observation = self._with_own_surface(observation, observation.depth)
        return self._measurements.filtered(
            observation,
            weights,
            depth,
            self.model_error.deviation,
            self.config.lost_after,
            self.config.depth_noise,
        )

    def _with_own_surface(self, observation: Observation, depth: np.ndarray) -> Observation:
        """The observation with the depths as the body in the last pose shows them, see `of_own_surface`."""
        pose, layout = self._body_hypotheses.published.pose, self.layout
        nearest = self._surface.depth_towards(pose, pose.landmarks)
        own = of_own_surface(depth, pose.landmarks[:, 2], nearest, layout.surface, self.skeleton.height)
        return replace(observation, depth=own)

    def _with_learned_depth(self, measurement: Measurement) -> Steps[FrameData]:
        """The frame's measurements, with the depths that the network estimates from this frame and earlier ones."""
        if self._depth is None:
            return self._with_measured_depth(measurement)
        if measurement.lost:
            self._depth.reset()
        if measurement.lost or not measurement.repeated:
            known = self._upright.configured or self._upright.learned_for > VERTICAL_AFTER
            up = self._upright.vertical if known else None
            points, seen, mount = measurement.points, measurement.used, self._upright.mount
            self._joint_depths = yield from self._depth.update(measurement.stamp, points, seen, up, mount)
        data = self._with_measured_depth(measurement)
        return FrameData(data.points, data.weights, data.depth, data.depth_weights, self._joint_depths)

    def _with_measured_depth(self, measurement: Measurement) -> FrameData:
        """The frame's measurements; without measured depth as long as the person's size is unknown."""
        if self.height is None or self.height.measured:
            return measurement.data
        return replace(measurement.data, depth=None, depth_weights=None)

    def _initialise(self, measurement: Measurement, frame: FrameData) -> Fit | None:
        """A state fitted to this frame alone, if there is no state yet or the present one must be replaced."""
        if self._state is None or measurement.lost or self._stuck_frames >= STUCK_AFTER:
            return self._fit_frame(frame)
        if measurement.repeated or not self._reinitialisation.due(measurement.stamp, self._cost, frame.depth_count):
            return None
        vertical = self._upright.vertical
        fit = self._fit_frame(frame)
        if reinitialisation_replaces(self._cost, float(fit.costs[0])):
            return fit
        self._upright.vertical = vertical  # the rejected fit may have set another one
        return None

    def _fit_frame(self, frame: FrameData) -> Fit:
        """A state from one frame: from the network's pose if that explains the frame, else from all start poses."""
        places = None if self._depth is None else self._depth.places()
        if places is None:
            return self._initialiser.fit(frame)
        vertical = self._upright.vertical
        near = self._initialiser.fit(frame, self._network_hypothesis.start(places, self.skeleton))
        if near.costs[0] <= GOOD_FIT * np.count_nonzero(frame.weights):
            return near
        chosen, self._upright.vertical = self._upright.vertical, vertical
        fit = self._initialiser.fit(frame)
        if fit.costs[0] <= near.costs[0]:
            return fit
        self._upright.vertical = chosen
        return near

    def _fit_after_long_step(self, frame: FrameData) -> None:
        """Start this frame from the better of two fits: one from the last state, one from the network's pose."""
        places = None if self._depth is None else self._depth.places()
        if places is None:
            return
        assert self._state is not None
        starts = self._successor or self._state, self._network_hypothesis.start(places, self.skeleton)
        fits = [self._initialiser.refine_start(start, frame) for start in starts]
        self._successor = min(fits, key=lambda fit: float(fit.costs[0])).best
        self._body_hypotheses.replace_published(self._successor)

    def _solve_increment(
        self, fit: Fit | None, frame: FrameData, measurement: Measurement
    ) -> Steps[tuple[BodyState, Increment]]:
        """The state from which the frame starts, and the increment from there."""
        config = self.config
        if fit is not None:
            start = fit.best
            rows = self._increments.about(start, frame)
        else:
            assert self._state is not None
            start = self._successor or self._state
            rows = yield BatchedCall(self._body_hypotheses, "linearise", (frame,))
        linearisations, sparsity = config.relinearisations, config.sparsity
        if self._depth is not None and fit is None:
            linearisations, sparsity = for_step(measurement.step, linearisations, sparsity)
        increment = self._increments.solve(start, rows, frame, sparsity, linearisations, config.warm_start)
        return start, increment

    def _check_answer(self, start: BodyState, increment: Increment, focal: float) -> Rejection | None:
        """The reason to reject an answer, None to accept it. Counts consecutive rejections."""
        depth = start.translation[2] + increment.x[2]
        rejection = None
        if not increment.solution.certified:
            rejection = Rejection.NOT_CERTIFIED
        elif self.skeleton.height * focal < SMALLEST * self.config.noise_px * depth or depth <= 0:
            rejection = Rejection.TOO_SMALL  # or behind the camera; the image cannot correct either
        self._stuck_frames = 0 if rejection is None else self._stuck_frames + 1
        return rejection

    def _accept_increment(
        self, start: BodyState, fit: Fit | None, increment: Increment, measurement: Measurement, frame: FrameData
    ) -> Steps[EvaluatedState]:
        """Retract a certified increment, which gives the present state, and update the hypotheses.

        fit: the fit from which the frame started, if the state was initialised in it.
        """
        if fit is not None or self._another_body:
            self._output_filter.reset()  # the motion of the replaced state does not go on
        elif self._successor is not None:
            assert self._state is not None
            self._output_filter.exchange(self._state, start)
        self._successor, self._another_body = None, False
        if fit is not None:
            return self._start_tracking(start, fit, increment, frame)
        alpha = increment.problem.alpha
        self._state = yield BatchedCall(self._body_hypotheses, "advance", (increment.omega, increment.x, alpha))
        solved = self._body_hypotheses.published
        if measurement.news > 0:
            yield BatchedCall(self._body_hypotheses, "compute_costs", (frame,))
            yield from self._compare_hypotheses(frame, alpha, measurement.stamp, solved.pose)
            self._cost = self._body_hypotheses.cost
            self._upright.learn(self._state.rotations[0], measurement.news)
        return solved

    def _start_tracking(self, start: BodyState, fit: Fit, increment: Increment, frame: FrameData) -> EvaluatedState:
        """Make the state after a first frame's increment the present one."""
        state = start.retract(increment.omega, increment.x)
        self._state = state = replace(state, rotations=orthonormalised(state.rotations))
        self._body_hypotheses.start(state, frame)
        if self._depth is None:
            self._limbs.start(state)
        self._cost = float(fit.costs[0])
        return self._body_hypotheses.published

    def _compare_hypotheses(self, frame: FrameData, alpha: np.ndarray, stamp: float, tracked: BodyPose) -> Steps[None]:
        """Choose the state from which the next frame starts, if another hypothesis explains this frame better.

        tracked: pose of the present state.
        """
        winner = self._body_hypotheses.select(frame, alpha)
        if self._depth is None:
            if winner is None:
                yield from self._compare_limbs(frame)
            else:
                self._limbs.start(winner)
        else:
            cost, places = self._body_hypotheses.cost, self._depth.places
            winner = self._network_hypothesis.better_state(stamp, frame, places, self.skeleton, tracked, cost)
            if winner is not None:
                self._body_hypotheses.replace_published(winner)
        if winner is not None:
            self._successor, self._another_body = winner, True

    def _compare_limbs(self, frame: FrameData) -> Steps[None]:
        """Use another hypothesis of a limb from the next frame on, if its mean cost has become lower."""
        published = self._body_hypotheses.published
        if self._limbs.count:
            yield BatchedCall(self._limbs, "advance", (published, frame, self._body_hypotheses.image_costs))
        self._successor = self._limbs.exchange(published)
        if self._successor is not None:
            self._body_hypotheses.replace_published(self._successor)

    def _smooth(self, solved: EvaluatedState, increment: Increment, measurement: Measurement) -> BodyState:
        """The state to publish."""
        return self._output_filter.filtered(
            solved.state,
            solved.pose,
            increment.omega,
            increment.x,
            measurement.step,
            measurement.speed,
            self.config.smoothing,
        )

    def _estimate(
        self,
        measurement: Measurement,
        frame: FrameData,
        fit: Fit | None,
        increment: Increment,
        solved: BodyState,
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
            initialised=fit is not None,
            problem=increment.problem,
            solution=increment.solution,
            solved=solved,
            cost=self._cost,
            excess=self.model_error.excess,
            confidence=float("nan") if fit is None else fit.confidence,
            repeated=measurement.repeated,
            visible=measurement.visible & measurement.used,
            measurements=measurement.count,
            depth_measured=frame.depth_weights is not None,
            depth_covers=bool(frame.depth_covers),
            length_deviation=self.calibration.spread,
            joint_depths=self._joint_depths,
        )

    def _learn(
        self, measurement: Measurement, frame: FrameData, start: BodyState, fit: Fit | None, increment: Increment
    ) -> None:
        """Update bone lengths, the person's mean pose, and the keypoints' model error."""
        stamp, new = measurement.stamp, not measurement.repeated
        if self.config.calibrate and (fit is not None or new):
            self._calibrate(stamp, frame, fit is not None)
        if fit is None and new and self.adaptive_mean.advance(stamp, start, increment.problem):
            self._body_hypotheses.refresh()
        if new and self.model_error.due(stamp):
            depth = float(start.translation[2] + increment.x[2])
            weights = np.where(measurement.visible, measurement.weights, 0.0)  # a landmark not seen is extrapolated
            self.model_error.advance(stamp, increment.problem, increment.solution.omega, weights, depth)

    def _calibrate(self, stamp: float, frame: FrameData, initialised: bool) -> None:
        """Update the bone lengths from a tracked frame. New lengths are used from the next frame on."""
        assert self._state is not None
        if initialised or self._another_body:
            self.calibration.restart_clock(stamp)
        elif self._successor is None and self.calibration.advance(stamp, self._state, frame):
            self._adopt_lengths()

    def _measure_height(self, height: HeightEstimator, measurement: Measurement, frame: FrameData) -> None:
        """Update the height from an accepted frame, and adopt it from the next frame on if it has changed."""
        assert self._state is not None
        pose = self.kinematics.pose(self._state)
        height.update(measurement, pose.landmarks, self._state.translation, self.skeleton.height)
        if height.due(measurement.stamp, self.skeleton.height):
            self._adopt_height(height.height, frame)

    def _adopt_height(self, height: float, frame: FrameData) -> None:
        """Scale the body and its distance. The proportions are learned anew."""
        assert self._state is not None
        ratio, depth, waiting = height / self.skeleton.height, self._depth, self._lag.flush()
        self._resize(height)
        if self._depth is not None and depth is not None:
            self._depth.adopt_history(depth)
        self.published = [*self.published, *waiting]
        self._successor, self._another_body = None, False
        self._state = BodyState(self._state.rotations, self._state.translation * ratio)
        self._body_hypotheses.start(self._state, frame)
        if self._depth is None:
            self._limbs.start(self._state)

    def _publish(self, estimate: Estimate, offsets: np.ndarray, measurement: Measurement) -> None:
        """Collect the estimates that are due; offsets: (n, 3) m, of the skeleton that the estimate was made with."""
        if self.config.smoothing_lag == 0 and self._lag.empty:
            self.published = [estimate]
            return
        assert self._output_filter.forward is not None
        self._lag.add(estimate, self._output_filter.forward, offsets, measurement.reprojection_px)
        self.published = self._lag.due(estimate.stamp, self.config.smoothing_lag)

    def _reject(
        self, observation: Observation, rejection: Rejection, certificate: Certificate | None = None
    ) -> Estimate:
        """The estimate for a rejected frame. The state stays; the status becomes LOST after too long a time."""
        if self._state is None:
            self._measurements.forget()
        self.published = []
        if rejection is not Rejection.NOT_FINITE:  # the stamp can be used
            if self._state is not None and observation.stamp - self._measurements.newest > self.config.lost_after:
                self._status = Status.LOST
            self.published = self._lag.due(observation.stamp, self.config.smoothing_lag)
        return Estimate(observation.stamp, self._status, rejection, certificate=certificate)
