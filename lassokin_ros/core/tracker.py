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

from dataclasses import dataclass, replace
from enum import Enum
from functools import partial

import numpy as np

from lassokin_ros.core.calibration import Calibration
from lassokin_ros.core.certificate import Certificate
from lassokin_ros.core.challengers import Challengers
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.doubt import doubt
from lassokin_ros.core.fixed_lag import FixedLag
from lassokin_ros.core.frame_rows import FrameRows, Rows
from lassokin_ros.core.initialisation import Fit, Initialiser
from lassokin_ros.core.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.landmarks import Layout
from lassokin_ros.core.lasso import Lasso, LassoSolution, LassoSolver
from lassokin_ros.core.limb_search import LimbSearch
from lassokin_ros.core.point_filter import PointFilter
from lassokin_ros.core.prior import PosePrior, PriorRows
from lassokin_ros.core.projection import project
from lassokin_ros.core.repeats import Repeats
from lassokin_ros.core.robust import huber_weights
from lassokin_ros.core.rotations import orthonormalised, right_jacobian
from lassokin_ros.core.skeleton import Skeleton
from lassokin_ros.core.steadying import Steadying
from lassokin_ros.core.uncertainty import JointUncertainty, UncertaintyModel
from lassokin_ros.core.upright import Upright

CHALLENGERS = 1
"""States that are followed beside the published one, see `challengers`. With the other side's turn first, a second one
found back from a wrong side no sooner."""

FOCAL_RANGE = 1e-3, 1e9
"""px: beyond, weights lose their digits."""

SMALLEST = 3.0
"""Height of the person in the image, in noise_px, below which nothing can be seen: nonsense fits far away best."""

STUCK_AFTER = 3
"""Frames in a row without a certificate, or with one for a body behind the camera, after which the state is found anew:
it is one that leads nowhere."""

ACCELERATION = 3.5
"""m/s^2: standard deviation of a body point's acceleration, typical of everyday motion."""


class Status(Enum):
    """What the tracker knows of the person."""

    SEARCHING = "searching"
    TRACKING = "tracking"
    LOST = "lost"


class Rejection(str, Enum):
    """Why a frame was not used."""

    WRONG_SHAPE = "wrong_shape"
    NOT_FINITE = "not_finite"
    OLD_STAMP = "old_stamp"
    TOO_FEW_LANDMARKS = "too_few_landmarks"
    NOT_CERTIFIED = "not_certified"
    TOO_SMALL = "too_small"


@dataclass(frozen=True, eq=False)
class Observation:
    """One frame's keypoints of one person.

    stamp: s; points: (l, 2) normalised image coordinates, distortion removed (NaN = missing); confidence: (l,) 0 to 1,
    0 = missing; focal: px per normalised unit, which turns `noise_px` into this frame's unit.
    """

    stamp: float
    points: np.ndarray
    confidence: np.ndarray
    focal: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """The tracker's answer to one observation. Fields below `status` are None when the frame was rejected.

    state, pose: what is to be published; solved: the state that the certificate is about, to which omega (3 n,) and
    translation_step (3,) led from the last frame's, before it was steadied; cost: its negative log-likelihood (see
    `doubt`); confidence: of an initialised frame, how likely the start is beside the next best, else NaN.
    """

    stamp: float
    status: Status
    rejection: Rejection | None = None
    state: BodyState | None = None
    pose: BodyPose | None = None
    omega: np.ndarray | None = None
    translation_step: np.ndarray | None = None
    certificate: Certificate | None = None
    reprojection_px: float = float("nan")
    initialised: bool = False
    problem: Lasso | None = None
    solution: LassoSolution | None = None
    solved: BodyState | None = None
    cost: float = float("nan")
    confidence: float = float("nan")
    repeated: float = 0.0

    @property
    def accepted(self) -> bool:
        """True when the frame was used and there is a state to publish."""
        return self.rejection is None

    @property
    def doubt(self) -> float:
        """0 to 1: how likely the pose is wrong, by more than 100 mm on average."""
        return doubt(self.cost)


class Tracker:
    """Follows one person; its only state is the body's, and the stamp at which it was last seen."""

    def __init__(self, config: TrackerConfig | None = None, skeleton: Skeleton | None = None) -> None:
        """Raises a LassokinError (skeleton, layout, solver or setting) when the configuration cannot be used."""
        self.config = (config or TrackerConfig()).checked()
        self.skeleton = skeleton or Skeleton.load(self.config.skeleton, self.config.height)
        self.layout = Layout.load(self.config.landmarks, self.skeleton)
        self.kinematics = Kinematics(self.skeleton, self.layout)
        prior = PosePrior.load(self.skeleton)
        self._upright = Upright()
        self._rows = FrameRows(self.kinematics, PriorRows(prior, self.kinematics), self._upright)
        self._initialiser = Initialiser(self.kinematics, prior, self._rows)
        self._challengers = Challengers(self._initialiser, self._rows, CHALLENGERS)
        self._limbs = LimbSearch(self.kinematics, self._rows.prior, self._initialiser.mirroring)
        self._steadying = Steadying(self.kinematics.joint_count)
        self._lag = FixedLag(self.kinematics)
        self._repeats, self._filter = Repeats(), PointFilter(self.layout.names)
        self.calibration = Calibration(self._rows)
        self._uncertainty = UncertaintyModel(self.kinematics, prior)
        self._solver = LassoSolver(self.config.solver)
        self._live = np.flatnonzero(self.kinematics.live)
        self._motion = np.maximum(prior.motion, 0.003)[self._live]
        self.reset()

    def reset(self) -> None:
        """Forget the state; the next usable frame initialises anew."""
        self._state: BodyState | None = None
        self._seen = self._informed = -np.inf  # stamps of the last frame that was used, of the last with new keypoints
        self._uncertified = 0
        self._status = Status.SEARCHING
        self._successor: BodyState | None = None
        self._another_body = False  # the successor differs by more than a limb
        self._cost = float("nan")
        self._guess: np.ndarray | None = None
        self._repeats.reset()
        self._filter.reset()
        self._steadying.reset()
        self._lag.reset()
        self.published: list[Estimate] = []
        """What became due with the last observation, in order: its own estimate, or with `smoothing_lag` earlier ones,
        smoothed, each under the stamp of its own frame."""
        self._upright.reset()
        self._challengers.stop()
        self.calibration.reset()
        self._take_lengths()

    @property
    def state(self) -> BodyState | None:
        """The present state, None before the first usable frame."""
        return self._state

    def tune(self, config: TrackerConfig) -> None:
        """Take over live settings; structure (height, skeleton, landmarks, solver) stays as it was built."""
        self.config = config.checked()

    def track(self, observation: Observation) -> Estimate:
        """Use one observation. Never raises for what a detector may send: see `Estimate.rejection`."""
        rejection, weights = self._admit(observation)
        if rejection is not None:
            return self._refused(observation, rejection)
        repeated = self._repeats.age(observation.stamp, observation.points, observation.confidence)
        lost = observation.stamp - (self._seen if repeated else self._informed) > self.config.lost_after
        if lost:
            self._filter.reset()
            repeated = 0.0
        visible = weights > 0
        seen = np.where(visible[:, None], observation.points, 0.0)
        points, weights = self._filtered(observation.stamp, seen, weights, repeated > 0)
        if np.count_nonzero(weights) < self.config.min_landmarks:
            return self._refused(observation, Rejection.TOO_FEW_LANDMARKS)
        initialised = self._state is None or lost or self._uncertified >= STUCK_AFTER
        fit = self._initialiser.fit(points, weights) if initialised else None
        start = fit.best if fit is not None else self._successor or self._state
        assert start is not None
        rows = self._rows_about(start, points, weights) if initialised else self._challengers.linearise(points, weights)
        problem, solution, omega = self._follow(start, rows, points, weights)
        if not solution.certified:
            self._uncertified += 1
            return self._refused(observation, Rejection.NOT_CERTIFIED, solution.certificate)
        depth = start.translation[2] + solution.x[2]
        if depth <= 0:  # behind the camera: an answer to nonsense, from where no image leads back
            self._uncertified += 1
            return self._refused(observation, Rejection.TOO_SMALL, solution.certificate)
        self._uncertified = 0
        if self.skeleton.height * observation.focal < SMALLEST * self.config.noise_px * depth:
            return self._refused(observation, Rejection.TOO_SMALL, solution.certificate)
        step = observation.stamp - self._seen
        news = observation.stamp - self._informed if repeated == 0 else 0.0
        state = self._take(start, fit, omega, solution.x, points, weights, problem.alpha, news)
        steady = self._steadying.steadied(state, omega, solution.x, step, self.config.smoothing)
        pose = self.kinematics.pose(steady)
        reprojection_px = partial(_reprojection_px, seen, visible, observation.focal)
        offsets = self.skeleton.offsets
        self._seen, self._status = observation.stamp, Status.TRACKING
        if repeated == 0:
            self._informed = observation.stamp
        if self.config.calibrate and (initialised or repeated == 0):
            self._calibrate(observation.stamp, initialised, points, weights)
        estimate = Estimate(
            observation.stamp,
            self._status,
            None,
            steady,
            pose,
            omega,
            solution.x,
            solution.certificate,
            reprojection_px(pose),
            initialised,
            problem,
            solution,
            state,
            self._cost,
            float("nan") if fit is None else fit.confidence,
            repeated,
        )
        assert self._steadying.forward is not None
        self._lag.add(estimate, self._steadying.forward, offsets, reprojection_px)
        self.published = self._lag.due(observation.stamp, self.config.smoothing_lag)
        return estimate

    def flush(self) -> list[Estimate]:
        """Those that still wait for their `smoothing_lag`, in order: no observation will come after them."""
        return self._lag.flush()

    def _filtered(
        self, stamp: float, points: np.ndarray, weights: np.ndarray, repeated: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """What the points' tracks make of a frame; a repeated one teaches them nothing, least of all a standstill."""
        if repeated:
            return self._filter.expected(stamp)
        depth = 3.5 if self._state is None else self._state.translation[2]
        return self._filter.update(stamp, points, weights, ACCELERATION / depth)

    def _take(
        self,
        start: BodyState,
        fit: Fit | None,
        omega: np.ndarray,
        x: np.ndarray,
        points: np.ndarray,
        weights: np.ndarray,
        alpha: np.ndarray,
        news: float,
    ) -> BodyState:
        """Make the state after a certified increment the present one, and let the challengers see the same points.

        fit: where the state was found anew, what it was found as; news: s since there were new keypoints before these;
        0 where these are repeated, and no further evidence.
        """
        if fit is not None or self._successor is not None:
            self._steadying.reset()  # it is another explanation: where the last one was going says nothing of it
        self._successor = None
        if fit is not None:
            state = start.retract(omega, x)
            self._state = state = replace(state, rotations=orthonormalised(state.rotations))
            self._challengers.start(state, points, weights)
            self._limbs.start(state)
            self._cost = float(fit.costs[0])
            return state
        self._state = state = self._challengers.advance(omega, x, alpha, news > 0)
        if news > 0:
            self._successor = self._challengers.compete(points, weights, alpha)
            self._another_body = self._successor is not None
            if self._successor is not None:
                self._limbs.start(self._successor)
            else:
                self._search_limbs(points, weights)
            self._cost = self._challengers.cost
            self._upright.learn(state.rotations[0], news)
        return state

    def _search_limbs(self, points: np.ndarray, weights: np.ndarray) -> None:
        """Let a limb's other explanation follow, if it has become better than the one that is published."""
        published = self._challengers.published
        self._limbs.advance(published, points, weights)
        self._successor = self._limbs.exchange(published)
        if self._successor is not None:
            self._challengers.replace_published(self._successor)

    def uncertainty(self, estimate: Estimate) -> JointUncertainty:
        """How far off each joint of an estimate may be, computed when asked; ValueError for one not accepted."""
        if estimate.pose is None or estimate.problem is None:
            raise ValueError("only an accepted estimate has an uncertainty; this frame was rejected")
        return self._uncertainty.of(estimate.pose, estimate.problem)

    def _calibrate(self, stamp: float, initialised: bool, points: np.ndarray, weights: np.ndarray) -> None:
        """Let a tracked frame speak about the bones' lengths; what is learned counts from the next frame on."""
        assert self._state is not None
        if initialised or self._another_body:
            self.calibration.restart_clock(stamp)
        elif self._successor is None and self.calibration.advance(stamp, self._state, points, weights):
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
            self._repeats.reset()
            self._filter.reset()
        elif observation.stamp - self._seen > self.config.lost_after:
            self._status = Status.LOST
        self.published = []
        if rejection is not Rejection.NOT_FINITE:  # time goes on for those that wait
            self.published = self._lag.due(observation.stamp, self.config.smoothing_lag)
        return Estimate(observation.stamp, self._status, rejection, certificate=certificate)

    def _admit(self, observation: Observation) -> tuple[Rejection | None, np.ndarray]:
        """The reason against this observation, if any, and the landmarks' weights (l,), 1 / standard deviation."""
        count = self.kinematics.landmark_count
        none = np.zeros(count)
        if observation.points.shape != (count, 2) or observation.confidence.shape != (count,):
            return Rejection.WRONG_SHAPE, none
        if not (np.isfinite(observation.stamp) and FOCAL_RANGE[0] < observation.focal < FOCAL_RANGE[1]):
            return Rejection.NOT_FINITE, none
        if observation.stamp <= self._seen:
            return Rejection.OLD_STAMP, none
        near = np.abs(observation.points) < 10
        usable = near[:, 0] & near[:, 1] & (observation.confidence >= max(self.config.min_confidence, 1e-9))
        if np.count_nonzero(usable) < self.config.min_landmarks:
            return Rejection.TOO_FEW_LANDMARKS, none
        deviation = self.config.noise_px / observation.focal * self.layout.noise
        confidence = np.minimum(np.where(usable, observation.confidence, 0.0), 1.0)
        return None, np.sqrt(confidence) / deviation

    def _follow(
        self, start: BodyState, rows: Rows, points: np.ndarray, weights: np.ndarray
    ) -> tuple[Lasso, LassoSolution, np.ndarray]:
        """One frame's lassos, the first with the rows about `start`: last problem and solution, total Omega (3 n,)."""
        omega = np.zeros(3 * self.kinematics.joint_count)
        x = np.zeros(3)
        for number in range(self.config.relinearisations):
            if number > 0:
                rows = self._rows_about(start.retract(omega, x), points, weights, omega)
            problem = self._problem(rows, omega, x)
            solution = self._solver.solve(problem, self._guess if self.config.warm_start else None)
            if not (solution.exact or solution.certified):  # the last one, which is published, is certified below
                break
            self._guess = solution.omega  # of the next problem, or of the next frame's first
            omega[self._live], x = solution.omega, solution.x
        return problem, solution, omega

    def _rows_about(
        self, state: BodyState, points: np.ndarray, weights: np.ndarray, omega: np.ndarray | None = None
    ) -> Rows:
        """The frame's rows about a state; in the total increment where it was moved already, start * exp(omega).

        With exp(omega + d) = exp(omega) exp(J_r(omega) d), the axes of all columns are turned by J_r.
        """
        turn = None if omega is None else right_jacobian(omega.reshape(-1, 3))
        return self._rows.linearise(self._rows.hypotheses(state), points, weights, huber_weights, turn)

    def _problem(self, rows: Rows, omega: np.ndarray, x: np.ndarray) -> Lasso:
        """The lasso in the frame's total increment: what has been moved already, (omega, x), is added back to z."""
        A, B = rows.columns[:-3].T, rows.columns[-3:].T
        return Lasso(A, B, rows.z + A @ omega[self._live] + B @ x, self.config.sparsity / self._motion)


def _reprojection_px(points: np.ndarray, visible: np.ndarray, focal: float, pose: BodyPose) -> float:
    """px: root of the mean squared distance of the visible points (l, 2) from the pose's landmarks."""
    error = (points - project(pose.landmarks))[visible] * focal
    return float(np.sqrt(np.vdot(error, error) / len(error)))
