"""The tracker: one observation in, one estimate out.

    tracker = Tracker(TrackerConfig(height=1.75))
    estimate = tracker.track(Observation(stamp, points, confidence, focal))

It follows the paper's method frame by frame in a closed loop: the observation is compared with the projection of the
present state (not with the last observation, which drifts), the model is linearised about it (12), the lasso is
solved for the increment of all joints and the translation, certified, and retracted onto SO(3). Each frame is
linearised anew `relinearisations` - 1 times about the answer, with the l1 penalty on the frame's total increment. What
is published is that state, steadied over a few frames (see `steadying`); the next frame starts from it as solved.
With `smoothing_lag`, what `track` returns is still the newest frame's; `published` holds what has become due.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.core.admission import admitted
from lassokin_ros.core.calibration import Calibration
from lassokin_ros.core.certificate import Certificate
from lassokin_ros.core.challengers import Challengers
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.estimate import Estimate, Observation, Rejection, Status
from lassokin_ros.core.fixed_lag import FixedLag
from lassokin_ros.core.frame_rows import FrameRows, Hypotheses
from lassokin_ros.core.habit import Habit
from lassokin_ros.core.increment import Increment, IncrementSolver
from lassokin_ros.core.initialisation import Fit, Initialiser
from lassokin_ros.core.kinematics import BodyState, Kinematics
from lassokin_ros.core.landmarks import Layout
from lassokin_ros.core.lasso import LassoSolver
from lassokin_ros.core.likeness import Likeness
from lassokin_ros.core.limb_search import LimbSearch
from lassokin_ros.core.prior import PosePrior, PriorRows
from lassokin_ros.core.rotations import orthonormalised
from lassokin_ros.core.second_look import SecondLook
from lassokin_ros.core.sighting import Sighting, Sightings
from lassokin_ros.core.skeleton import Skeleton
from lassokin_ros.core.steadying import Steadying
from lassokin_ros.core.symmetry import LARGEST_ASYMMETRY, asymmetry, limb_groups, symmetrised
from lassokin_ros.core.together import Steps, Work, alone, side_by_side
from lassokin_ros.core.uncertainty import JointUncertainty, UncertaintyModel
from lassokin_ros.core.upright import Upright

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
        prior = PosePrior.load(self.skeleton)
        self._upright = Upright(self.config.camera_roll, self.config.camera_pitch)
        self._rows = FrameRows(self.kinematics, PriorRows(prior, self.kinematics), self._upright)
        self._initialiser = Initialiser(self.kinematics, prior, self._rows)
        self._challengers = Challengers(self._initialiser, self._rows, CHALLENGERS)
        self._limbs = LimbSearch(self.kinematics, self._rows.prior, self._initialiser.mirroring, self._rows.balance)
        self._second_look = SecondLook(self.kinematics.landmark_count)
        self._steadying = Steadying(self.kinematics.joint_count)
        self._lag = FixedLag(self.kinematics)
        limbs = limb_groups(self.skeleton)[self.layout.joints]
        self._sightings, self.likeness = Sightings(self.layout.names, limbs), Likeness(self.skeleton.height)
        self.calibration, self.habit = Calibration(self._rows), Habit(self._rows)
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
        self._sightings.reset()
        self._steadying.reset()
        self._lag.reset()
        self.published: list[Estimate] = []
        """What became due with the last observation, in order: its own estimate, or with `smoothing_lag` earlier ones,
        smoothed, each under the stamp of its own frame."""
        if not same_camera:
            self._upright.reset()
        self._challengers.stop()
        self._second_look.reset()
        self.calibration.reset()
        self.habit.reset()
        self.likeness.reset()
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
        return alone(self.steps(observation))

    @staticmethod
    def track_together(trackers: Sequence[Tracker], observations: Sequence[Observation]) -> list[Estimate]:
        """Use one observation with each of several trackers, which is quicker than one after another.

        Their answers are those of `track`, but for rounding. Raises ConfigurationError for trackers of unlike layouts
        or trees of joints.
        """
        if len({(tracker.layout.names, tracker.skeleton.parents.tobytes()) for tracker in trackers}) > 1:
            raise ConfigurationError("trackers that go together must have one layout and one tree of joints")
        pairs = zip(trackers, observations, strict=True)
        return side_by_side([tracker.steps(observation) for tracker, observation in pairs])

    def steps(self, observation: Observation) -> Steps[Estimate]:
        """What `track` does, to be run by itself or beside others of its kind, see `together`."""
        config = self.config
        rejection, weights = admitted(observation, self._sightings.newest, self.layout, config)
        if rejection is not None:
            return self._refused(observation, rejection)
        depth = None if self._state is None else float(self._state.translation[2])
        sighting = self._sightings.of(observation, weights, depth, self.likeness.deviation, config.lost_after)
        if np.count_nonzero(sighting.weights) < config.min_landmarks:
            return self._refused(observation, Rejection.TOO_FEW_LANDMARKS)
        fit = self._found_anew(sighting)
        start, increment = yield from self._follow(fit, sighting)
        rejection = self._against(start, increment, sighting.focal)
        if rejection is not None:
            return self._refused(observation, rejection, increment.solution.certificate)
        solved = yield from self._take(start, fit, increment, sighting)
        steady = self._steadying.steadied(
            solved.state, solved.pose, increment.omega, increment.x, sighting.step, sighting.speed, config.smoothing
        )
        estimate = self._estimate(sighting, fit, increment, solved.state, steady)
        offsets = self.skeleton.offsets
        self._sightings.used(sighting)
        self._learn(sighting, start, fit, increment)
        assert self._steadying.forward is not None
        self._lag.add(estimate, self._steadying.forward, offsets, sighting.reprojection_px)
        self.published = self._lag.due(observation.stamp, config.smoothing_lag)
        return estimate

    def _estimate(
        self, sighting: Sighting, fit: Fit | None, increment: Increment, solved: BodyState, steady: BodyState
    ) -> Estimate:
        """The answer to a frame that was used; solved: the state of its lasso; steady: that to be published."""
        self._status = Status.TRACKING
        pose = self.kinematics.pose(steady)
        return Estimate(
            sighting.stamp,
            self._status,
            state=steady,
            pose=pose,
            omega=increment.omega,
            translation_step=increment.x,
            certificate=increment.solution.certificate,
            reprojection_px=sighting.reprojection_px(pose),
            initialised=fit is not None,
            problem=increment.problem,
            solution=increment.solution,
            solved=solved,
            cost=self._cost,
            excess=self.likeness.excess,
            confidence=float("nan") if fit is None else fit.confidence,
            repeated=sighting.repeated,
        )

    def _learn(self, sighting: Sighting, start: BodyState, fit: Fit | None, increment: Increment) -> None:
        """Let a frame speak about the bones' lengths, how the person holds themselves, and the keypoints' errors."""
        if self.config.calibrate and (fit is not None or not sighting.repeated):
            self._calibrate(sighting, fit is not None)
        if fit is None and not sighting.repeated and self.habit.advance(sighting.stamp, start, increment.problem):
            self._challengers.refresh()
        if not sighting.repeated and self.likeness.due(sighting.stamp):
            depth = float(start.translation[2] + increment.x[2])
            weights = np.where(sighting.visible, sighting.weights, 0.0)  # what is not seen coasts
            self.likeness.advance(sighting.stamp, increment.problem, increment.solution.omega, weights, depth)

    def flush(self) -> list[Estimate]:
        """Those that still wait for their `smoothing_lag`, in order: no observation will come after them."""
        return self._lag.flush()

    def _found_anew(self, sighting: Sighting) -> Fit | None:
        """The state as one frame alone shows it, where there is none yet, or none to go on with."""
        if self._state is None or sighting.lost or self._nowhere >= STUCK_AFTER:
            return self._initialiser.fit(sighting.points, sighting.weights)
        if sighting.repeated or not self._second_look.due(sighting.stamp, self._cost):
            return None
        believed = self._upright.vertical
        fit = self._initialiser.fit(sighting.points, sighting.weights)
        if self._second_look.convinces(self._cost, float(fit.costs[0])):
            return fit
        self._upright.vertical = believed  # not that of an explanation which is not taken
        return None

    def _follow(self, fit: Fit | None, sighting: Sighting) -> Steps[tuple[BodyState, Increment]]:
        """Where the frame starts from, a state just found or the present one, and the increment from there."""
        points, weights = sighting.points, sighting.weights
        if fit is not None:
            start = fit.best
            rows = self._increments.about(start, points, weights)
        else:
            assert self._state is not None
            start = self._successor or self._state
            rows = yield Work(self._challengers, "linearise", (points, weights))
        config = self.config
        increment = self._increments.solve(
            start, rows, points, weights, config.sparsity, config.relinearisations, config.warm_start
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

    def _take(self, start: BodyState, fit: Fit | None, increment: Increment, sighting: Sighting) -> Steps[Hypotheses]:
        """Make the state after a certified increment the present one, and let the challengers see the same points.

        fit: where the state was found anew, what it was found as.
        """
        omega, x, alpha = increment.omega, increment.x, increment.problem.alpha
        points, weights, news = sighting.points, sighting.weights, sighting.news
        if fit is not None or self._another_body:
            self._steadying.reset()  # where the last one was going says nothing of it
        elif self._successor is not None:
            assert self._state is not None
            self._steadying.exchange(self._state, start)
        self._successor, self._another_body = None, False
        if fit is not None:
            state = start.retract(omega, x)
            self._state = state = replace(state, rotations=orthonormalised(state.rotations))
            self._challengers.start(state, points, weights)
            self._limbs.start(state)
            self._cost = float(fit.costs[0])
            return self._challengers.published
        self._state = state = yield Work(self._challengers, "advance", (omega, x, alpha))
        solved = self._challengers.published
        if news > 0:
            yield Work(self._challengers, "weigh", (points, weights))
            self._successor = self._challengers.compete(points, weights, alpha)
            self._another_body = self._successor is not None
            if self._successor is not None:
                self._limbs.start(self._successor)
            else:
                yield from self._search_limbs(points, weights)
            self._cost = self._challengers.cost
            self._upright.learn(state.rotations[0], news)
        return solved

    def _search_limbs(self, points: np.ndarray, weights: np.ndarray) -> Steps[None]:
        """Let a limb's other explanation follow, if it has become better than the one that is published."""
        published = self._challengers.published
        if self._limbs.count:
            yield Work(self._limbs, "advance", (published, points, weights, self._challengers.image_costs))
        self._successor = self._limbs.exchange(published)
        if self._successor is not None:
            self._challengers.replace_published(self._successor)

    def uncertainty(self, estimate: Estimate) -> JointUncertainty:
        """How far off each joint of an estimate may be, computed when asked; ValueError for one not accepted."""
        if estimate.pose is None or estimate.problem is None:
            raise ValueError("only an accepted estimate has an uncertainty; this frame was rejected")
        return self._uncertainty.of(estimate.pose, estimate.problem)

    def _calibrate(self, sighting: Sighting, initialised: bool) -> None:
        """Let a tracked frame speak about the bones' lengths; what is learned counts from the next frame on."""
        assert self._state is not None
        if initialised or self._another_body:
            self.calibration.restart_clock(sighting.stamp)
        elif self._successor is None and self.calibration.advance(
            sighting.stamp, self._state, sighting.points, sighting.weights
        ):
            self._take_lengths()

    def _take_lengths(self) -> None:
        self.skeleton = self.calibration.skeleton
        self.kinematics.reshape(self.skeleton)
        self._challengers.refresh()

    def _refused(
        self, observation: Observation, rejection: Rejection, certificate: Certificate | None = None
    ) -> Estimate:
        """The answer to a frame that is not used: only the status may change, when too long nothing was usable."""
        if self._state is None:
            self._sightings.forget()
        self.published = []
        if rejection is not Rejection.NOT_FINITE:  # time goes on
            if self._state is not None and observation.stamp - self._sightings.newest > self.config.lost_after:
                self._status = Status.LOST
            self.published = self._lag.due(observation.stamp, self.config.smoothing_lag)
        return Estimate(observation.stamp, self._status, rejection, certificate=certificate)
