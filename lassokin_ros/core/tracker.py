"""The tracker: one observation in, one estimate out.

    tracker = Tracker(TrackerConfig(height=1.75))
    estimate = tracker.track(Observation(stamp, points, confidence, focal))

It follows the paper's method frame by frame in a closed loop: the observation is compared with the projection of the
present state (not with the last observation, which drifts), the model is linearised about it (12), the lasso is
solved for the increment of all joints and the translation, certified, and retracted onto SO(3). Each frame is
linearised anew `relinearisations` - 1 times about the answer, with the l1 penalty on the frame's total increment. What
is published is that state, steadied over a few frames (see `output_filter`); the next frame starts from it as solved.
With `smoothing_lag`, what `track` returns is still the newest frame's; `published` holds what has become due.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.core.batch import BatchedCall, Steps, run_batched, run_single
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import orthonormalised
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.body.symmetry import LARGEST_ASYMMETRY, asymmetry, limb_groups, symmetrised
from lassokin_ros.core.calibration import Calibration
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.adaptive_mean import AdaptiveMean
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.model_error import ModelError
from lassokin_ros.core.evidence.pose_prior import PoseDistribution, PosePrior
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.core.hypotheses.body_hypotheses import BodyHypotheses
from lassokin_ros.core.hypotheses.initialisation import Fit, Initialiser
from lassokin_ros.core.hypotheses.limb_hypotheses import LimbHypotheses
from lassokin_ros.core.hypotheses.reinitialisation import Reinitialisation
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.gating import gate_observation
from lassokin_ros.core.image.measurement import Measurement, MeasurementFilter
from lassokin_ros.core.increment import Increment, IncrementSolver
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.lasso.solver import LassoSolver
from lassokin_ros.core.observation import Observation, Rejection, Status
from lassokin_ros.core.output.fixed_lag import FixedLag
from lassokin_ros.core.output.output_filter import OutputFilter
from lassokin_ros.core.output.uncertainty import JointUncertainty, UncertaintyModel

CHALLENGERS = 1
"""States that are followed beside the published one, see `challengers`. With the other side's turn first, a second one
found back from a wrong side no sooner."""

SMALLEST = 3.0
"""Height of the person in the image, in noise_px, below which nothing can be seen: nonsense fits far away best."""

STUCK_AFTER = 3
"""Frames in a row without a certificate, or with one for a body that is behind the camera or too far away to be seen,
after which the state is found anew: it is one that leads nowhere."""

LEAST_MOTION = 0.003
"""rad a frame: no degree of freedom is taken to move less."""


class Tracker:
    """Follows one person: the body's state, and what was learned of person, keypoints and camera until `reset`."""

    def __init__(self, config: TrackerConfig | None = None, skeleton: Skeleton | None = None) -> None:
        """Raises a LassokinError (skeleton, layout, solver or setting) when the configuration cannot be used."""
        self.config = (config or TrackerConfig()).checked()
        self.skeleton = skeleton or Skeleton.load(self.config.skeleton, self.config.height)
        difference = asymmetry(self.skeleton)
        self.averaged = difference if self.config.calibrate and difference > LARGEST_ASYMMETRY else 0.0
        """How much left and right of the given skeleton differ, where this was too much, and calibration begins with
        their mean; else 0."""
        if self.averaged:
            self.skeleton = symmetrised(self.skeleton)
        self.layout = Layout.load(self.config.landmarks, self.skeleton)
        self.kinematics = Kinematics(self.skeleton, self.layout)
        prior = PoseDistribution.load(self.skeleton)
        self._upright = Upright(self.config.camera_roll, self.config.camera_pitch)
        self._rows = FrameModel(self.kinematics, PosePrior(prior, self.kinematics), self._upright)
        self._initialiser = Initialiser(self.kinematics, prior, self._rows)
        self._body_hypotheses = BodyHypotheses(self._initialiser, self._rows, CHALLENGERS)
        self._limbs = LimbHypotheses(self.kinematics, self._rows.prior, self._initialiser.mirroring, self._rows.balance)
        self._reinitialisation = Reinitialisation(self.kinematics.landmark_count)
        self._output_filter = OutputFilter(self.kinematics.joint_count)
        self._lag = FixedLag(self.kinematics)
        limbs = limb_groups(self.skeleton)[self.layout.joints]
        self._measurements = MeasurementFilter(self.layout.names, limbs, self.layout.surface, self.skeleton.height)
        self.model_error = ModelError(self.skeleton.height)
        self.calibration, self.adaptive_mean = Calibration(self._rows), AdaptiveMean(self._rows)
        self._uncertainty = UncertaintyModel(self.kinematics, prior)
        motion = np.maximum(prior.motion, LEAST_MOTION)[self._rows.live]
        self._increments = IncrementSolver(self._rows, LassoSolver(self.config.solver), motion)
        self.reset()

    def reset(self, same_camera: bool = False) -> None:
        """Forget the state; the next usable frame initialises anew.

        same_camera: True where somebody else comes before a camera that stays as it is: keep its learned vertical.
        """
        self._state: BodyState | None = None
        self._nowhere = 0
        self._status = Status.SEARCHING
        self._successor: BodyState | None = None
        self._another_body = False  # the successor differs by more than a limb
        self._cost = float("nan")
        self._increments.reset()
        self._measurements.reset()
        self._output_filter.reset()
        self._lag.reset()
        self.published: list[Estimate] = []
        """What became due with the last observation, in order: its own estimate, or with `smoothing_lag` earlier ones,
        smoothed, each under the stamp of its own frame."""
        if not same_camera:
            self._upright.reset()
        self._body_hypotheses.stop()
        self._reinitialisation.reset()
        self.calibration.reset()
        self.adaptive_mean.reset()
        self.model_error.reset()
        self._take_lengths()

    @property
    def state(self) -> BodyState | None:
        """The present state, None before the first usable frame."""
        return self._state

    def adopt_vertical(self, others: Iterable[Tracker]) -> None:
        """Take over the camera's vertical as trackers of other people in its images have learned it, if one has."""
        self._upright.adopt(other._upright for other in others)

    def tune(self, config: TrackerConfig) -> None:
        """Take over live settings; structure (height, skeleton, landmarks, solver) stays as it was built."""
        before, self.config = self.config, config.checked()
        if (config.camera_roll, config.camera_pitch) != (before.camera_roll, before.camera_pitch):
            self._upright.mounted(config.camera_roll, config.camera_pitch)

    def track(self, observation: Observation) -> Estimate:
        """Use one observation. Never raises for what a detector may send: see `Estimate.rejection`."""
        return run_single(self.steps(observation))

    @staticmethod
    def track_batch(trackers: Sequence[Tracker], observations: Sequence[Observation]) -> list[Estimate]:
        """Use one observation with each of several trackers, which is quicker than one after another.

        Their answers are those of `track`, but for rounding. Raises ConfigurationError for trackers of unlike layouts
        or trees of joints.
        """
        if len({(tracker.layout.names, tracker.skeleton.parents.tobytes()) for tracker in trackers}) > 1:
            raise ConfigurationError("trackers that go together must have one layout and one tree of joints")
        pairs = zip(trackers, observations, strict=True)
        return run_batched([tracker.steps(observation) for tracker, observation in pairs])

    def steps(self, observation: Observation) -> Steps[Estimate]:
        """What `track` does, to be run by itself or beside others of its kind, see `together`."""
        config = self.config
        rejection, weights = gate_observation(observation, self._measurements.newest, self.layout, config)
        if rejection is not None:
            return self._refused(observation, rejection)
        depth = None if self._state is None else float(self._state.translation[2])
        measurement = self._measurements.of(observation, weights, depth, self.model_error.deviation, config.lost_after)
        if np.count_nonzero(measurement.weights) < config.min_landmarks:
            return self._refused(observation, Rejection.TOO_FEW_LANDMARKS)
        fit = self._found_anew(measurement)
        start, increment = yield from self._follow(fit, measurement)
        rejection = self._against(start, increment, measurement.focal)
        if rejection is not None:
            return self._refused(observation, rejection, increment.solution.certificate)
        solved = yield from self._take(start, fit, increment, measurement)
        steady = self._output_filter.filtered(
            solved.state, solved.pose, increment.omega, increment.x, measurement.step, measurement.speed, config.smoothing
        )
        estimate = self._estimate(measurement, fit, increment, solved.state, steady)
        offsets = self.skeleton.offsets
        self._measurements.used(measurement)
        self._learn(measurement, start, fit, increment)
        assert self._output_filter.forward is not None
        self._lag.add(estimate, self._output_filter.forward, offsets, measurement.reprojection_px)
        self.published = self._lag.due(observation.stamp, config.smoothing_lag)
        return estimate

    def _estimate(
        self, measurement: Measurement, fit: Fit | None, increment: Increment, solved: BodyState, steady: BodyState
    ) -> Estimate:
        """The answer to a frame that was used; solved: the state of its lasso; steady: that to be published."""
        self._status = Status.TRACKING
        pose = self.kinematics.pose(steady)
        return Estimate(
            measurement.stamp,
            self._status,
            state=steady,
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
        )

    def _learn(self, measurement: Measurement, start: BodyState, fit: Fit | None, increment: Increment) -> None:
        """Let a frame speak about the bones' lengths, how the person holds themselves, and the keypoints' errors."""
        if self.config.calibrate and (fit is not None or not measurement.repeated):
            self._calibrate(measurement, fit is not None)
        if fit is None and not measurement.repeated and self.adaptive_mean.advance(measurement.stamp, start, increment.problem):
            self._body_hypotheses.refresh()
        if not measurement.repeated and self.model_error.due(measurement.stamp):
            depth = float(start.translation[2] + increment.x[2])
            weights = np.where(measurement.visible, measurement.weights, 0.0)  # what is not seen coasts
            self.model_error.advance(measurement.stamp, increment.problem, increment.solution.omega, weights, depth)

    def flush(self) -> list[Estimate]:
        """Those that still wait for their `smoothing_lag`, in order: no observation will come after them."""
        return self._lag.flush()

    def _found_anew(self, measurement: Measurement) -> Fit | None:
        """The state as one frame alone shows it, where there is none yet, or none to go on with."""
        if self._state is None or measurement.lost or self._nowhere >= STUCK_AFTER:
            return self._initialiser.fit(measurement.data)
        if measurement.repeated or not self._reinitialisation.due(measurement.stamp, self._cost):
            return None
        believed = self._upright.vertical
        fit = self._initialiser.fit(measurement.data)
        if self._reinitialisation.convinces(self._cost, float(fit.costs[0])):
            return fit
        self._upright.vertical = believed  # not that of an explanation which is not taken
        return None

    def _follow(self, fit: Fit | None, measurement: Measurement) -> Steps[tuple[BodyState, Increment]]:
        """Where the frame starts from, a state just found or the present one, and the increment from there."""
        frame = measurement.data
        if fit is not None:
            start = fit.best
            rows = self._increments.about(start, frame)
        else:
            assert self._state is not None
            start = self._successor or self._state
            rows = yield BatchedCall(self._body_hypotheses, "linearise", (frame,))
        config = self.config
        increment = self._increments.solve(
            start, rows, frame, config.sparsity, config.relinearisations, config.warm_start
        )
        return start, increment

    def _against(self, start: BodyState, increment: Increment, focal: float) -> Rejection | None:
        """The reason against an answer, if any; one that leads nowhere is counted."""
        depth = start.translation[2] + increment.x[2]
        rejection = None
        if not increment.solution.certified:
            rejection = Rejection.NOT_CERTIFIED
        elif self.skeleton.height * focal < SMALLEST * self.config.noise_px * depth or depth <= 0:
            rejection = Rejection.TOO_SMALL  # or behind the camera: from either no image leads back
        self._nowhere = 0 if rejection is None else self._nowhere + 1
        return rejection

    def _take(self, start: BodyState, fit: Fit | None, increment: Increment, measurement: Measurement) -> Steps[EvaluatedState]:
        """Make the state after a certified increment the present one, and let the challengers see the same points.

        fit: where the state was found anew, what it was found as.
        """
        omega, x, alpha = increment.omega, increment.x, increment.problem.alpha
        frame, news = measurement.data, measurement.news
        if fit is not None or self._another_body:
            self._output_filter.reset()  # where the last one was going says nothing of it
        elif self._successor is not None:
            assert self._state is not None
            self._output_filter.exchange(self._state, start)
        self._successor, self._another_body = None, False
        if fit is not None:
            state = start.retract(omega, x)
            self._state = state = replace(state, rotations=orthonormalised(state.rotations))
            self._body_hypotheses.start(state, frame)
            self._limbs.start(state)
            self._cost = float(fit.costs[0])
            return self._body_hypotheses.published
        self._state = state = yield BatchedCall(self._body_hypotheses, "advance", (omega, x, alpha))
        solved = self._body_hypotheses.published
        if news > 0:
            yield BatchedCall(self._body_hypotheses, "weigh", (frame,))
            self._successor = self._body_hypotheses.compete(frame, alpha)
            self._another_body = self._successor is not None
            if self._successor is not None:
                self._limbs.start(self._successor)
            else:
                yield from self._search_limbs(frame)
            self._cost = self._body_hypotheses.cost
            self._upright.learn(state.rotations[0], news)
        return solved

    def _search_limbs(self, frame: FrameData) -> Steps[None]:
        """Let a limb's other explanation follow, if it has become better than the one that is published."""
        published = self._body_hypotheses.published
        if self._limbs.count:
            yield BatchedCall(self._limbs, "advance", (published, frame, self._body_hypotheses.image_costs))
        self._successor = self._limbs.exchange(published)
        if self._successor is not None:
            self._body_hypotheses.replace_published(self._successor)

    def uncertainty(self, estimate: Estimate) -> JointUncertainty:
        """How far off each joint of an estimate may be, computed when asked; ValueError for one not accepted."""
        if estimate.pose is None or estimate.problem is None:
            raise ValueError("only an accepted estimate has an uncertainty; this frame was rejected")
        return self._uncertainty.of(estimate.pose, estimate.problem)

    def _calibrate(self, measurement: Measurement, initialised: bool) -> None:
        """Let a tracked frame speak about the bones' lengths; what is learned counts from the next frame on."""
        assert self._state is not None
        if initialised or self._another_body:
            self.calibration.restart_clock(measurement.stamp)
        elif self._successor is None and self.calibration.advance(
            measurement.stamp, self._state, measurement.data
        ):
            self._take_lengths()

    def _take_lengths(self) -> None:
        self.skeleton = self.calibration.skeleton
        self.kinematics.reshape(self.skeleton)
        self._body_hypotheses.refresh()

    def _refused(
        self, observation: Observation, rejection: Rejection, certificate: Certificate | None = None
    ) -> Estimate:
        """The answer to a frame that is not used: only the status may change, when too long nothing was usable."""
        if self._state is None:
            self._measurements.forget()
        self.published = []
        if rejection is not Rejection.NOT_FINITE:  # time goes on
            if self._state is not None and observation.stamp - self._measurements.newest > self.config.lost_after:
                self._status = Status.LOST
            self.published = self._lag.due(observation.stamp, self.config.smoothing_lag)
        return Estimate(observation.stamp, self._status, rejection, certificate=certificate)
