"""Calibration: learn the bone proportions during tracking. The height stays about as given, see STATURE_DEVIATION.

The unknowns are about a dozen log-lengths, the same left and right (see `proportions`). Some tracked frames, spread
over time, are kept. For each, the rows of all evidence are linearised in (pose, translation, log-lengths), and pose
and translation are eliminated (Schur complement). The sum of the normal equations that are left, a prior and a row that
fixes the stature are solved for the lengths. Kept frames are relinearised in turn: this is Gauss-Newton, distributed
over time (Triggs et al., Bundle adjustment: a modern synthesis, 2000, sec. 6).

The prior of the log-lengths is a mixture of Gaussians, one for each origin that the given lengths may have: they are
measured, or good guesses, or those of another person. With the built-in proportions there are four cases: the person
has about these lengths, or other ones, or lengths that differ from them as those of people do
(priors/people_lengths.yaml, written by training/people.py), or as those of motion capture (priors/capture_lengths.yaml,
written by training/lengths.py), whose joints are other points of the body than those that detectors mark. The keypoints
determine the probability of each case.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton, has_built_in_proportions
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import huber_weights
from lassokin_ros.core.kernel import lapack
from lassokin_ros.core.lasso.problem import WEAKEST
from lassokin_ros.core.observation import has_passed
from lassokin_ros.core.yaml_files import shipped_mapping

MEASURED, GUESSED, ANOTHER = 0.003, 0.05, 0.12
"""Standard deviation of a log-length about the given one in these cases."""
POPULATIONS = ("priors/people_lengths.yaml", "priors/capture_lengths.yaml")
"""Files of people's lengths: as detectors see them, and between the joints of motion capture."""


@dataclass(eq=False)
class LengthModel:
    """A Gaussian of the log-lengths, which have no unit.

    mean: (p,); precision: (p, p); odds: prior probability of this case. measured: whether the given lengths are right.
    """

    mean: np.ndarray
    precision: np.ndarray
    odds: float
    measured: bool = False


@cache
def population(file: str) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """(names, mean (k,), covariance (k, k)) of people's log-lengths about the built-in proportions."""
    data = shipped_mapping("lassokin_ros.core.evidence", file)
    rows = data["covariance"]
    lower = np.array([row + [0.0] * (len(rows) - len(row)) for row in rows])
    return tuple(data["names"]), np.array(data["mean"]), lower + np.tril(lower, -1).T


def length_models(proportions: Proportions) -> list[LengthModel]:
    """The cases for the skeleton of some proportions, with (p,) log-lengths in the order of `proportions.names`.

    The odds of given lengths say that treating a guess as measured costs more than the opposite error.
    """

    def about_given(deviation: float, odds: float, measured: bool = False) -> LengthModel:
        count = proportions.count
        return LengthModel(np.zeros(count), np.eye(count) / deviation**2, odds, measured)

    if not has_built_in_proportions(proportions.given):
        return [about_given(MEASURED, 0.3, measured=True), about_given(GUESSED, 0.6), about_given(ANOTHER, 0.1)]
    populations = (_about_population(proportions, file, odds) for file, odds in zip(POPULATIONS, (0.4, 0.2)))
    return [about_given(GUESSED, 0.3), about_given(ANOTHER, 0.1), *populations]


def _about_population(proportions: Proportions, file: str, odds: float) -> LengthModel:
    """The case of a person like those of a shipped population. Other lengths are good guesses."""
    names, mean, covariance = population(file)
    index = [names.index(name) if name in names else -1 for name in proportions.names]
    known = np.flatnonzero(np.array(index) >= 0)
    chosen = [index[i] for i in known]
    own_mean, own = np.zeros(proportions.count), np.eye(proportions.count) * GUESSED**2
    own_mean[known], own[np.ix_(known, known)] = mean[chosen], covariance[np.ix_(chosen, chosen)]
    return LengthModel(own_mean, np.linalg.inv(own), odds)


@dataclass(eq=False)
class LengthPosterior:
    """odds: (m,) of the cases; means: (m, p) and covariances: (m, p, p) of the log-lengths in each of them."""

    odds: np.ndarray
    means: np.ndarray
    covariances: np.ndarray

    def deviation(self, about: np.ndarray) -> np.ndarray:
        """(p,) standard deviation of the mixture about a value."""
        within, between = np.diagonal(self.covariances, axis1=1, axis2=2), (self.means - about) ** 2
        return np.asarray(np.sqrt(self.odds @ (within + between)))


def initial_deviation(models: Sequence[LengthModel]) -> np.ndarray:
    """(p,) standard deviation of the log-lengths about the given ones before any measurement."""
    count = len(models[0].mean)
    if any(model.measured for model in models):
        return np.full(count, GUESSED)
    odds, means = np.array([model.odds for model in models]), np.array([model.mean for model in models])
    return LengthPosterior(odds, means, np.linalg.inv([model.precision for model in models])).deviation(np.zeros(count))


def posterior(models: Sequence[LengthModel], H: np.ndarray, g: np.ndarray, common: np.ndarray) -> LengthPosterior:
    """Cases and lengths after measurements.

    H: (p, p) and g: (p,) normal equations of the measurements, about zero. common: (p, p) further information about the
    differences from each case's mean, such as that of the stature. The odds follow from the marginal likelihoods.
    """
    about = np.array([model.mean for model in models])
    prior = common + np.array([model.precision for model in models])
    covariances = np.linalg.inv(H + prior)
    pulls = (prior @ about[..., None])[..., 0]
    means = (covariances @ (g + pulls)[..., None])[..., 0]
    volume = np.linalg.slogdet(prior)[1] + np.linalg.slogdet(covariances)[1]
    evidence = 0.5 * (((g + pulls) * means).sum(-1) - (pulls * about).sum(-1) + volume)
    likely = np.array([model.odds for model in models]) * np.exp(evidence - evidence.max())
    return LengthPosterior(likely / likely.sum(), means, covariances)


STATURE_DEVIATION, OBSERVED_STATURE_DEVIATION = 0.005, 0.02
"""Standard deviation of the logarithm of the stature at rest: with one camera, which does not observe size; and with
several, measured depth or the floor, for the difference between a stated height and that of the limbs."""
KEEP, WORK, UPDATE = (0.05, 0.08, 0.25), (0.05, 0.05, 0.13), (0.2, 0.25, 1.0)
"""Schedules, see `_is_due`: between kept frames, by the duration that they cover; between two pieces of work, which are
to keep one frame or to relinearise one; and between two updates of the skeleton."""
CERTAIN_MEAN, CERTAIN = 0.04, 0.012
"""Deviations of the log-lengths: mean below which they are input to the depth network, as given ones are; and of the
least certain one below which the calibration ends."""
SHORTEST_S, LONGEST_S = 8.0, 20.0
"""s of kept motion: minimum, and the duration after which the calibration ends in any case."""


@dataclass(eq=False)
class KeptFrame:
    """A kept frame: its measurements, its pose, and its normal equations in the lengths.

    share: factor on its information, for frames at shorter intervals than the last one of `KEEP`. information: (p, p),
    and pull: (p,), the negative gradient, both about `lengths`, those of the last linearisation.
    """

    state: BodyState
    data: FrameData
    share: float
    lengths: np.ndarray = field(init=False)
    information: np.ndarray = field(init=False)
    pull: np.ndarray = field(init=False)
    cost: float = np.inf


class Calibration:
    """Learns the lengths of one person. Call `update` with every tracked frame; `skeleton` is the result."""

    def __init__(self, frame_model: FrameModel) -> None:
        self._frame_model, kinematics = frame_model, frame_model.kinematics
        self.proportions = Proportions(kinematics)
        self._models = length_models(self.proportions)
        self._live, self._joint_count = kinematics.live_index, kinematics.joint_count
        self.reset()

    def reset(self) -> None:
        """Return to the given lengths."""
        count = self.proportions.count
        self.lengths = np.zeros(count)
        self.deviation = initial_deviation(self._models)
        self.frozen = count == 0
        self.kept_motion = 0.0
        self._frames: list[KeptFrame] = []
        self._next_relinearised = 0
        self._last_work_stamp = -math.inf
        self._kept_at = self._updated_at = np.nan
        self.stature_deviation = STATURE_DEVIATION

    def resize(self, ratio: float) -> None:
        """Use a given body that is taller by a factor. The log-lengths stay. Kept frames of one camera move away from
        it, so that their images stay. The network's depths in them are those of the taller body.
        """
        self.proportions.use(self.proportions.given.scaled(ratio))
        for frame in self._frames:
            if frame.data.seen_by == 1:
                frame.state = frame.state.scaled_about(frame.data.seeing.camera.centre, ratio)
            frame.data = frame.data.for_size(ratio)

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton with the present lengths."""
        return self.proportions.skeleton(self.lengths)

    @property
    def certain(self) -> bool:
        """Whether lengths have been learned, and are known well enough for the depth network."""
        return bool(self.lengths.any()) and bool(self.deviation.mean() < CERTAIN_MEAN)

    @property
    def progress(self) -> float:
        """Progress from 0 to 1; at 1 the lengths no longer change."""
        return 1.0 if self.frozen else min(self.kept_motion / LONGEST_S, 0.99)

    def update(self, stamp: float, state: BodyState, data: FrameData, restarted: bool) -> bool:
        """Use a tracked frame. Returns True if the lengths have changed.

        stamp: s. restarted: whether the state was initialised in this frame, or is replaced after it. No frames are
        kept until the next state has settled.
        """
        if restarted or np.isnan(self._kept_at):
            self._kept_at = stamp + 0.05  # s, until it has settled
        if restarted or self.frozen or not _is_due(WORK, stamp - self._last_work_stamp, self.kept_motion):
            return False
        self._last_work_stamp = stamp
        if np.isnan(self._updated_at):
            self._updated_at = stamp
        since = min(stamp - self._kept_at, KEEP[2])
        if _is_due(KEEP, since, self.kept_motion):
            self.kept_motion += since
            self._kept_at, frame = stamp, KeptFrame(state, data, since / KEEP[2])
            self._linearise(frame)
            if math.isfinite(frame.cost):  # otherwise the linearisation failed
                self._frames.append(frame)
        elif self._frames:
            self._next_relinearised = (self._next_relinearised + 1) % len(self._frames)
            self._linearise(self._frames[self._next_relinearised])
        if not _is_due(UPDATE, stamp - self._updated_at, self.kept_motion) or len(self._frames) < 4:
            return False
        self._updated_at = stamp
        self._solve()
        return True

    def _linearise(self, frame: KeptFrame) -> None:
        """Recompute a frame's normal equations at the present lengths, and do one Gauss-Newton step of its pose.

        The frame's rows are || z - J [Omega, x] - C dlengths ||^2.
        """
        model, data = self._frame_model, frame.data
        about = model.evaluate(frame.state)
        linearised = model.linearise(about, data, huber_weights)
        J, z = linearised.columns.T, linearised.z
        C = model.length_rows(linearised, about, data, self.proportions.motion(about.pose, self.lengths))
        H = J.T @ J
        H.reshape(-1)[:: len(H) + 1] += WEAKEST
        right = np.column_stack([J.T @ C, J.T @ z])
        _, solved, failed = lapack.dposv(H, right)
        if failed:
            return
        eliminated = right[:, :-1].T @ solved
        frame.information = C.T @ C - eliminated[:, :-1]
        frame.pull = C.T @ z - eliminated[:, -1]
        images = sum(piece.uncapped_cost(about, data) for piece in model.image_pieces if piece.present(data))
        frame.lengths, frame.cost = self.lengths, float(images + model.prior.cost(about, data))
        frame.state = self._moved(frame.state, solved[:, -1])

    def _moved(self, state: BodyState, step: np.ndarray) -> BodyState:
        """The state after a step (live + 3,), with rotations limited to 0.5 rad."""
        omega = np.zeros(3 * self._joint_count)
        omega[self._live] = step[:-3]
        omega *= 0.5 / max(float(np.abs(omega).max()), 0.5)
        return BodyState(state.rotations @ exponential(omega.reshape(-1, 3)), state.translation + step[-3:])

    def _solve(self) -> None:
        """Solve for the lengths with all kept frames, and end the calibration if they are certain."""
        shares = self.proportions.stature_shares * np.exp(self.lengths)
        excess = float(self.proportions.stature_shares @ np.expm1(self.lengths))
        stature = np.outer(shares, shares) / self.stature_deviation**2
        H, g = self._normal_equations()
        g += shares * (shares @ self.lengths - excess) / self.stature_deviation**2
        found = posterior(self._models, H, g, stature)
        best = self._best(found)
        # The poses of the kept frames can follow a change of 0.1.
        self.lengths = self.lengths + np.clip(best - self.lengths, -0.1, 0.1)
        self.deviation = found.deviation(best)
        certain = self.kept_motion >= SHORTEST_S and bool(self.deviation.max() < CERTAIN)
        self.frozen = certain or self.kept_motion >= LONGEST_S
        if self.frozen:
            self._frames = []

    def _best(self, found: LengthPosterior) -> np.ndarray:
        """The mean log-lengths, computed without the case that the given lengths are measured.

        While its probability is above 0.5, the given lengths stay bitwise equal, so that the track does not change.
        """
        guessed = np.array([not model.measured for model in self._models])
        if found.odds[guessed].sum() < 0.5:
            return np.zeros(self.proportions.count)
        odds = found.odds * guessed
        prior = np.array([model.mean for model in self._models])
        limited = np.clip(found.means, prior - 0.3, prior + 0.3)  # nobody's lengths differ more
        return np.asarray(odds / odds.sum() @ limited)

    def _normal_equations(self) -> tuple[np.ndarray, np.ndarray]:
        """(H (p, p), g (p,)) of all kept frames, about the given lengths.

        The errors of the prior and of the tracks are not independent, hence the factor 0.6. The weight of a frame is
        halved at a robust cost (image and prior) of 12, or of the median if that is larger.
        """
        costs = np.array([frame.cost for frame in self._frames])
        shares = np.array([frame.share for frame in self._frames])
        weights = 0.6 * shares / (1 + (costs / max(12.0, float(np.median(costs)))) ** 2)
        information = np.array([frame.information for frame in self._frames])
        lengths = np.array([frame.lengths for frame in self._frames])
        pulls = np.array([frame.pull for frame in self._frames]) + (information @ lengths[:, :, None])[:, :, 0]
        return np.tensordot(weights, information, 1), weights @ pulls


def _is_due(schedule: tuple[float, float, float], elapsed: float, known: float) -> bool:
    """Whether the next piece of work is due, `elapsed` s after the last. known: s of evidence collected so far.

    schedule: the interval is at least the first number, s, then this share of the evidence, at most the last number, s.
    """
    first, share, last = schedule
    return has_passed(elapsed, min(max(first, share * known), last))
