"""Calibration: learn the bone proportions during tracking. The height stays about as given, see STATURE_DEVIATION.

The unknowns are about a dozen log-lengths, the same left and right (see `proportions`). Some tracked frames, spread
over time, are kept. For each, the rows of all evidence are linearised in (pose, translation, log-lengths), and pose
and translation are eliminated (Schur complement). The sum of the normal equations that are left, a prior
(`length_prior`) and a row that fixes the stature are solved for the lengths. Kept frames are relinearised in turn: this
is Gauss-Newton, distributed over time (Triggs et al., Bundle adjustment: a modern synthesis, 2000, sec. 6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import huber_weights
from lassokin_ros.core.kernel import lapack
from lassokin_ros.core.lasso.problem import WEAKEST
from lassokin_ros.core.learned.length_prior import LengthPosterior, initial_deviation, length_models, posterior
from lassokin_ros.core.observation import has_passed

STATURE_DEVIATION, OBSERVED_STATURE_DEVIATION = 0.005, 0.02
"""Standard deviation of the logarithm of the stature at rest: with one camera, which does not observe size; and with
several, measured depth or the floor, for the difference between a stated height and that of the limbs."""
LARGEST_STEP = 0.1
"""Largest change of a log-length in one update, so that the poses of the kept frames can follow."""
LARGEST_DIFFERENCE = 0.3
"""Largest difference of a log-length from the mean of its prior."""
INFORMATION = 0.6
"""Factor on a kept frame's information, because the errors of the prior and of the tracks are not independent."""
KEEP = 0.05, 0.08, 0.25
"""s between kept frames, by the duration that they cover."""
WORK = 0.05, 0.05, 0.13
"""s between two pieces of work: keep one frame, or relinearise one."""
UPDATE = 0.2, 0.25, 1.0
"""s between two updates of the skeleton."""
TYPICAL_COST = 12.0
"""Robust cost of a frame (image and prior) at which its weight is halved; the median of the kept frames if larger."""
CERTAIN_MEAN, CERTAIN = 0.04, 0.012
"""Deviations of the log-lengths: mean below which they are input to the depth network, as given ones are; and of the
least certain one below which the calibration ends."""
SHORTEST_S, LONGEST_S = 8.0, 20.0
"""s of kept motion: minimum, and the duration after which the calibration ends in any case."""


@dataclass(eq=False)
class KeptFrame:
    """A kept frame: its measurements, its pose, and its normal equations in the lengths.

    share: factor on INFORMATION, for frames at shorter intervals than the last one of `KEEP`. information: (p, p), and
    pull: (p,), the negative gradient, both about `lengths`, those of the last linearisation.
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
        self.lengths = self.lengths + np.clip(best - self.lengths, -LARGEST_STEP, LARGEST_STEP)
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
        return np.asarray(
            odds / odds.sum() @ np.clip(found.means, prior - LARGEST_DIFFERENCE, prior + LARGEST_DIFFERENCE)
        )

    def _normal_equations(self) -> tuple[np.ndarray, np.ndarray]:
        """(H (p, p), g (p,)) of all kept frames, about the given lengths. Frames of high cost get a lower weight."""
        costs = np.array([frame.cost for frame in self._frames])
        shares = np.array([frame.share for frame in self._frames])
        weights = INFORMATION * shares / (1 + (costs / max(TYPICAL_COST, float(np.median(costs)))) ** 2)
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
