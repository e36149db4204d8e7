"""Calibration: learn the bone proportions during tracking. The height stays as given.

The unknowns are about a dozen log-lengths, the same left and right (see `proportions`). Some tracked frames, spread
over time, are kept. For each, the rows of all evidence are linearised in (pose, translation, log-lengths), and pose
and translation are eliminated (Schur complement), which leaves normal equations for the lengths. Their sum, a
prior (`length_prior`) and a row that fixes the stature are solved for the lengths. Kept frames are
relinearised in turn, one per call, at the present lengths. This is Gauss-Newton on all kept frames, distributed over
time (Triggs et al., Bundle adjustment: a modern synthesis, 2000, sec. 6). One piece of work is itself divided into
steps, which are distributed over the frames until the next piece, so that no frame takes much longer than the others.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import blas, lapack

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.calibration.length_prior import LengthPosterior, initial_spread, length_models, posterior
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import project, projection_jacobian
from lassokin_ros.core.image.robust_loss import huber_cost, huber_weights, norm
from lassokin_ros.core.schedule import Schedule

STATURE_SPREAD = 0.005
"""Standard deviation of the logarithm of the stature at rest."""
LARGEST_STEP = 0.1
"""Largest change of a log-length in one update, so that the poses of the kept frames can follow."""
FARTHEST = 0.3
"""Largest difference of a log-length from the mean of its prior."""
INFORMATION = 0.6
"""Factor on a kept frame's information, because the errors of the prior and of the tracks are not independent. For
frames at shorter intervals than the last one of `KEEP`, it is reduced in proportion to the interval."""
KEEP = Schedule(0.05, 0.08, 0.25)
"""s between kept frames, by the duration that they cover. It is short at first, because the lengths are wrong until
enough frames are kept. All kept frames stay: dropping every other one would halve the evidence, and wrong lengths would
count as measured."""
WORK = Schedule(0.05, 0.05, 0.13)
"""s between two pieces of work: keep one frame, or relinearise one."""
STEPS = 4
"""Steps of one piece of work: linearise and eliminate; rows of the volume; its determinants; update."""
UPDATE = Schedule(0.2, 0.25, 1.0)
"""s between two updates of the skeleton."""
SETTLED = 0.05
"""s after an initialisation before frames are kept."""
DAMPING = 1e-3
"""1/rad^2, fixes unobservable degrees of freedom."""
TYPICAL_COST = 12.0
"""Robust cost of a frame (image and prior) at which its weight is halved, because a high cost indicates a wrong pose.
If the median over the kept frames is larger, as it is while the lengths are wrong, the median is used instead."""
VOLUME = 0.4
"""Factor on the pose's volume, the log determinant of its information. The best pose alone favours limbs that are too
long and lean in depth. The volume accounts for the number of poses that are likely for given lengths. VOLUME and
INFORMATION were chosen on the training clips of the prior."""
VOLUME_STEP = 0.05
"""Step of the log-length for the finite difference of the volume, about the effect of noise on a limb in the image."""
VOLUME_HOLDS = 0.02
"""Change of a log-length up to which a kept frame's derivative of the volume is used again when it is relinearised."""
STEEPEST = 50.0
"""Limit of the derivative of the log volume. For a limb across the view, larger values are not meaningful."""
CERTAIN = 0.012
"""Standard deviation of the least certain log-length below which the calibration ends."""
SHORTEST = 8.0
"""s: minimum duration of kept motion."""
LONGEST = 20.0
"""s of kept motion after which the calibration ends in any case."""


@dataclass(eq=False)
class KeptFrame:
    """A kept frame: its measurements, its pose, and its normal equations in the lengths.

    share: factor on INFORMATION. information: (p, p), and pull: (p,), the negative gradient, both about `lengths`, the
    lengths of the last linearisation. volume: (p,) derivative of the log volume about the lengths `volume_at`, None
    before it is first computed.
    """

    state: BodyState
    data: FrameData
    share: float
    lengths: np.ndarray
    information: np.ndarray
    pull: np.ndarray
    cost: float = np.inf
    volume: np.ndarray | None = None
    volume_at: np.ndarray | None = None


class Calibration:
    """Learns the lengths of one person. Call `advance` with every tracked frame; `skeleton` is the result."""

    def __init__(self, rows: FrameModel) -> None:
        self._kinematics = kinematics = rows.kinematics
        self.proportions = Proportions(kinematics)
        self._models = length_models(self.proportions)
        self._rows = rows
        self._live = np.flatnonzero(kinematics.live)
        self.reset()

    def reset(self) -> None:
        """Return to the given lengths."""
        count = self.proportions.count
        self.lengths = np.zeros(count)
        self.spread = initial_spread(self._models)
        self.frozen = count == 0
        self.moved = 0.0
        self.odds = np.array([model.odds for model in self._models])
        self._frames: list[KeptFrame] = []
        self._turn = 0
        self._worked_at = self._newest = -math.inf
        self._work: Generator[None, None, bool] | None = None
        self._kept_at = self._updated_at = np.nan

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton with the present lengths."""
        return self.proportions.skeleton(self.lengths)

    @property
    def progress(self) -> float:
        """Progress from 0 to 1; at 1 the lengths no longer change."""
        return 1.0 if self.frozen else min(self.moved / LONGEST, 0.99)

    def restart_clock(self, stamp: float) -> None:
        """After an initialisation: keep no frames until the state has settled."""
        self._kept_at = stamp + SETTLED

    def advance(self, stamp: float, state: BodyState, data: FrameData) -> bool:
        """Use a tracked frame. stamp: s. Returns True if the lengths have changed."""
        if self.frozen:
            return False
        interval, step = WORK.interval(self.moved), stamp - self._newest
        self._newest = stamp
        if self._work is None:
            if stamp - self._worked_at < interval:
                return False
            self._worked_at = stamp
            self._work = self._piece(stamp, state, data)
        frames = max(math.ceil(interval / step - 1e-6), 1)  # until the next piece
        try:
            for _ in range(math.ceil(STEPS / frames)):
                next(self._work)
        except StopIteration as end:
            self._work = None
            return bool(end.value)
        return False

    def _piece(self, stamp: float, state: BodyState, data: FrameData) -> Generator[None, None, bool]:
        """Keep this frame or relinearise another one, then update the lengths if due: True if they have changed."""
        if np.isnan(self._kept_at):
            self.restart_clock(stamp)
        if np.isnan(self._updated_at):
            self._updated_at = stamp
        since = min(stamp - self._kept_at, KEEP.last)
        if since >= KEEP.interval(self.moved):
            self.moved += since
            self._kept_at = stamp
            yield from self._keep(state, data, since / KEEP.last)
        elif self._frames:
            self._turn = (self._turn + 1) % len(self._frames)
            yield from self._linearise(self._frames[self._turn])
        if stamp - self._updated_at < UPDATE.interval(self.moved) or len(self._frames) < 4:
            return False
        self._updated_at = stamp
        yield
        self._update()
        return True

    def _keep(self, state: BodyState, data: FrameData, share: float) -> Generator[None, None, None]:
        count = self.proportions.count
        frame = KeptFrame(state, data, share, self.lengths, np.zeros((count, count)), np.zeros(count))
        yield from self._linearise(frame)
        if math.isfinite(frame.cost):  # otherwise the linearisation failed
            self._frames.append(frame)

    def _linearise(self, frame: KeptFrame) -> Generator[None, None, None]:
        """Recompute a frame's normal equations at the present lengths, and do one Gauss-Newton step of its pose."""
        J, C, z, cost = self._frame_rows(frame)
        H = J.T @ J
        diagonal = H.reshape(-1)[:: len(H) + 1]
        diagonal += DAMPING
        right = np.empty((len(H), C.shape[1] + 1))
        right[:, :-1], right[:, -1] = J.T @ C, J.T @ z
        factor, solved, failed = lapack.dposv(H, right)
        if failed:
            return
        coupling, step = solved[:, :-1], solved[:, -1]
        volume, at = frame.volume, frame.volume_at
        if volume is None or at is None or np.abs(at - self.lengths).max() > VOLUME_HOLDS:
            images = J[: 2 * len(frame.data.points)]
            yield
            moved = self._moved_columns(frame, coupling)
            yield
            volume = _volume(moved, H - images.T @ images, 2 * float(np.log(factor.diagonal()).sum()))
            frame.volume, frame.volume_at = volume, self.lengths
        frame.information = C.T @ C - right[:, :-1].T @ coupling
        frame.pull = C.T @ z - right[:, :-1].T @ step - 0.5 * VOLUME * volume
        frame.lengths, frame.cost = self.lengths, cost
        frame.state = self._moved(frame.state, step, 0.5)

    def _moved(self, state: BodyState, steps: np.ndarray, largest: float = np.inf) -> BodyState:
        """The state after steps (..., live + 3), with rotations limited to `largest` rad."""
        omega = np.zeros(steps.shape[:-1] + (3 * self._kinematics.joint_count,))
        omega[..., self._live] = steps[..., :-3]
        size = np.maximum(np.max(np.abs(omega), axis=-1, keepdims=True), 1e-12)
        omega = (omega * np.minimum(1.0, largest / size)).reshape(*steps.shape[:-1], -1, 3)
        return BodyState(state.rotations @ exponential(omega), state.translation + steps[..., -3:])

    def _moved_columns(self, frame: KeptFrame, coupling: np.ndarray) -> np.ndarray:
        """(p, live + 3, 2 l): the image's rows, transposed, with each log-length larger by `VOLUME_STEP`.

        The pose follows. coupling: (live + 3, p), the negative derivative of the pose.
        """
        count = self.proportions.count
        states = self._moved(frame.state, -VOLUME_STEP * coupling.T)
        offsets = self.proportions.offsets(self.lengths + VOLUME_STEP * np.eye(count))
        pose = self._kinematics.pose(states, offsets)
        F = projection_jacobian(pose.landmarks) * frame.data.weights[:, None, None]
        columns = np.empty((count, len(coupling), 2 * len(frame.data.points)))
        rows, moving = F.reshape(count, -1, 3), self._kinematics.live_twists(pose, pose.orientations)
        self._kinematics.landmark_columns(moving, pose, rows, columns[:, :-3])
        columns[:, -3:] = rows.swapaxes(-1, -2)
        return columns

    def _frame_rows(self, frame: KeptFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """(J, C, z, cost): rows ||z - J [Omega, x] - C dlengths||^2 of a frame, and its robust cost."""
        about = self._rows.evaluate(frame.state)
        rows = self._rows.linearise(about, frame.data, huber_weights)
        C = self._rows.length_rows(rows, about, frame.data, self.proportions.motion(about.pose, self.lengths))
        size = norm(frame.data.points - project(about.pose.landmarks)) * frame.data.weights
        cost = huber_cost(size).sum() + self._rows.prior.cost(about, frame.data)
        return rows.columns.T, C, rows.z, float(cost)

    def _update(self) -> None:
        """Solve for the lengths with all kept frames, and end the calibration if they are certain."""
        shares = self.proportions.stature_shares * np.exp(self.lengths)
        excess = float(self.proportions.stature_shares @ np.expm1(self.lengths))
        stature = np.outer(shares, shares) / STATURE_SPREAD**2
        H, g = self._normal_equations()
        g += shares * (shares @ self.lengths - excess) / STATURE_SPREAD**2
        found = posterior(self._models, H, g, stature)
        self.odds = found.odds
        best = self._best(found)
        self.lengths = self.lengths + np.clip(best - self.lengths, -LARGEST_STEP, LARGEST_STEP)
        self.spread = found.spread(best)
        certain = self.moved >= SHORTEST and bool(self.spread.max() < CERTAIN)
        self.frozen = certain or self.moved >= LONGEST
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
        return np.asarray(odds / odds.sum() @ np.clip(found.means, prior - FARTHEST, prior + FARTHEST))

    def _normal_equations(self) -> tuple[np.ndarray, np.ndarray]:
        """(H (p, p), g (p,)) of all kept frames, about the given lengths. Frames of high cost get a lower weight."""
        costs = np.array([frame.cost for frame in self._frames])
        shares = np.array([frame.share for frame in self._frames])
        weights = INFORMATION * shares / (1 + (costs / max(TYPICAL_COST, float(np.median(costs)))) ** 2)
        information = np.array([frame.information for frame in self._frames])
        lengths = np.array([frame.lengths for frame in self._frames])
        pulls = np.array([frame.pull for frame in self._frames]) + (information @ lengths[:, :, None])[:, :, 0]
        return np.tensordot(weights, information, 1), weights @ pulls


def _volume(moved: np.ndarray, prior: np.ndarray, at_present: float) -> np.ndarray:
    """(p,) derivative of log det H with respect to each log-length, with H of the pose.

    moved: see `Calibration._moved_columns`. prior: H without the image's part. at_present: log det H.
    """
    there = np.array([_log_determinant(rows, prior) for rows in moved])
    return np.nan_to_num(np.clip((there - at_present) / VOLUME_STEP, -STEEPEST, STEEPEST))


def _log_determinant(columns: np.ndarray, prior: np.ndarray) -> float:
    """log det of columns (k, m) columns^T + prior (k, k); NaN if it is not positive definite.

    Only one triangle is computed. This takes a third of the time of numpy's batched functions.
    """
    product = blas.dsyrk(1.0, columns.T, beta=1.0, c=prior.T, trans=1, lower=1)
    factor, failed = lapack.dpotrf(product, lower=1, clean=0, overwrite_a=1)
    return math.nan if failed else 2 * float(np.log(factor.diagonal()).sum())
