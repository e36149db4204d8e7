"""Limb hypotheses: the mirror images in depth of each limb, tracked together with the published limb.

The most frequent error with one camera is one bone of one limb that leans away from the camera instead of towards it
(see `mirroring`). Therefore three hypotheses of each limb are kept: both bones mirrored, the outer one, the inner one.
A hypothesis changes only the joints of its limb; the rest of the body is as published. All get one Gauss-Newton step
per frame. A hypothesis with a lower mean cost over some frames replaces the limb in the next frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from lassokin_ros.core.band_solver import BandSolver
from lassokin_ros.core.batch import batched
from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics, twists, wrenches
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.evidence.balance import Balance
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.pose_prior import PosePrior
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.core.hypotheses.initialisation import limit_rotations
from lassokin_ros.core.hypotheses.limb_prior import LimbPrior
from lassokin_ros.core.hypotheses.mirroring import Mirroring
from lassokin_ros.core.hypotheses.replacement import LIMB_MARGIN, limb_replaces
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import project_with_jacobian
from lassokin_ros.core.image.robust_loss import capped_cost, capped_weights, norm, squared_norm

COUNTED_FROM = 2
"""Age in frames after which the cost of a hypothesis is averaged; it has converged by then."""
MATURE_FROM = 4
"""Age in frames from which a hypothesis may win."""
LARGEST_AGE = 10
"""Age in frames from which a hypothesis may be restarted from the mirrored limb."""
MEMORY = 6
"""Frames over which costs are averaged."""
SHARES = np.append(np.zeros(COUNTED_FROM + 1), 1 / np.arange(1.0, MEMORY + 1))
"""Weight of a frame's cost in the running mean, by age in frames; the last value holds for older hypotheses."""
RESTART_MARGIN = -6.0
"""A hypothesis worse by this difference is restarted."""
SAME_STATE = 0.01
"""m: distance of the limb's joints below which a hypothesis equals the published limb."""
DAMPING = 1e-3
"""1/rad^2, fixes unobservable rotations."""


class LimbHypotheses:
    """The h hypotheses of one skeleton's limbs, three for each limb.

    A limb is a chain of joints from the trunk outwards. The part after its last joint, a foot or a hand, stays fixed to
    it as published. The last joint itself rotates only if landmarks show its rotation. In the stacked hypotheses of
    several people (see `stack`) all arrays have a leading axis of people.
    """

    def __init__(self, kinematics: Kinematics, prior: PosePrior, mirroring: Mirroring, balance: Balance) -> None:
        self._kinematics, self._mirroring, self._balance = kinematics, mirroring, balance
        #: (h, 3) joints.
        self._chains = np.array([chain for chain, _ in mirroring.variants], dtype=int).reshape(-1, 3)
        self.count = len(self._chains)
        if self.count:
            self._find_landmarks()
            self._find_turns(prior)

    def _find_landmarks(self) -> None:
        """Find the landmarks (h, c) of each limb, padded, and which of its joints, 0 to 2, each is fixed to."""
        skeleton, joints = self._kinematics.skeleton, self._kinematics.layout.joints
        carries = skeleton.ancestors[joints][:, self._chains[:, 0]].T
        #: (l, h): 1 where a landmark is moved by the limb.
        self._carries = carries.T.astype(float)  # float for products
        most = carries.sum(axis=1).max()
        self._landmarks = np.argsort(~carries, axis=1, kind="stable")[:, :most]
        self._real = np.take_along_axis(carries, self._landmarks, axis=1)
        carried = skeleton.ancestors[joints[self._landmarks][:, :, None], self._chains[:, None, :]]
        carrier = np.maximum(carried.sum(axis=-1) - 1, 0)
        explanation = np.arange(self.count)[:, None]
        self._carriers = self._chains[explanation, carrier]
        #: (h, 2 + c): index among all h x 3 joints of the joint that rotates each vector (two bones, c landmarks).
        self._turned_by = 3 * explanation + np.insert(carrier, 0, [[0], [1]], axis=1)
        #: (h, 3 + c, 2 + c): joints and landmarks as sums of those vectors.
        self._sums = np.zeros((self.count, 3 + most, 2 + most))
        self._sums[:, 1:3, 0] = self._sums[:, 2, 1] = 1.0
        self._sums[:, 3:, :2] = carrier[:, :, None] > np.arange(2)
        self._sums[:, 3 + np.arange(most), 2 + np.arange(most)] = 1.0
        self._ones = np.ones(most)
        #: (h, 1, 3): weights of the chain's joints in the balance; the last includes all that is fixed to it.
        self._shares = self._balance.shares[self._chains][:, None]
        self._shares[:, 0, 2] = self._balance.shares @ skeleton.ancestors[:, self._chains[:, 2]]
        #: (h, 9, 2 c): 1 where a rotation of the chain moves a row.
        self._reach = np.kron(carried.swapaxes(1, 2), np.ones((3, 2)))

    def _find_turns(self, prior: PosePrior) -> None:
        """Find how many joints of a chain rotate (t), and their indices among the prior's joints (0 if missing)."""
        joints = list(prior.joints)
        known = np.isin(self._chains, joints)
        self._turning = turning = int(np.flatnonzero(known.any(axis=0))[-1]) + 1
        places = [[joints.index(joint) if joint in joints else 0 for joint in chain] for chain in self._chains]
        self._known = known[:, :turning]
        self._limb_prior = LimbPrior(prior, np.array(places)[:, :turning], self._known)
        self._reach = np.ascontiguousarray(self._reach[:, : 3 * turning])
        self._damping = DAMPING * np.eye(3 * turning)
        self._systems = BandSolver(self.count, 3 * turning)

    def start(self, state: BodyState) -> None:
        """Start all hypotheses from the mirrored limbs of a state."""
        self._age, self._advantage = np.zeros(self.count, dtype=int), np.zeros(self.count)
        #: (h, 3, 3, 3): local rotations of the chain of each hypothesis.
        self._rotations = self._mirroring.all(state).rotations[np.arange(self.count)[:, None], self._chains]

    @staticmethod
    def stack(several: Sequence[LimbHypotheses]) -> LimbHypotheses:
        """Stack the hypotheses of several people, each with the person's vertical. See `batch.batched`."""
        whole, first = copy(several[0]), several[0]
        whole._balance = first._balance.with_vertical(Upright.stack([one._balance.upright for one in several]))
        whole._systems = BandSolver.cached(len(several) * first.count, 3 * first._turning)
        return whole

    @batched(reads=("_rotations", "_age", "_advantage"), writes=("_rotations", "_age", "_advantage", "_apart"))
    def advance(self, published: EvaluatedState, frame: FrameData, image_costs: np.ndarray) -> None:
        """Do one Gauss-Newton step of each hypothesis on a frame, and compare its cost with the published limb's.

        image_costs: (l,) cost of each landmark for the published state.
        """
        pose = self._posed(published)
        image, image_z, image_cost = self._image_rows(pose, frame)
        turning = self._rotations[..., : self._turning, :, :]
        prior, prior_z = self._limb_prior.linearise(published.posture, turning)
        columns = np.concatenate([image, prior], axis=-1)
        H = columns @ columns.swapaxes(-1, -2) + self._damping
        g = (columns @ np.concatenate([image_z, prior_z[0]], axis=-1)[..., None])[..., 0]
        step = self._systems.solve(H, g)
        prior_cost, published_prior_cost = 0.5 * squared_norm(prior_z)
        # Cost after the step, predicted by the linearisation.
        cost = image_cost + prior_cost - 0.5 * (g[..., None, :] @ step[..., None])[..., 0, 0]
        gain = image_costs.dot(self._carries) + published_prior_cost - cost
        self._compare(gain + self._balance_gains(pose, published.pose))
        turning[:] = turning @ exponential(limit_rotations(step).reshape(turning.shape[:-1]))
        self._apart = norm(pose.positions - published.pose.positions.take(self._chains, axis=-2)).max(axis=-1)

    def _balance_gains(self, pose: BodyPose, published: BodyPose) -> np.ndarray:
        """(h,) cost of the balance for the published pose minus that for each hypothesis."""
        balance, last = self._balance, self._chains[:, 2]
        arms = balance.arms(published.positions).take(last, axis=-2)[..., None]  # of the part after the last joint
        turned = pose.orientations[..., 2, :, :] @ (published.orientations.take(last, -3).swapaxes(-1, -2) @ arms)
        apart = pose.positions - published.positions.take(self._chains, axis=-2)
        moved = np.zeros((*apart.shape[:-3], self.count + 1, 3))  # the last entry, 0, is the published pose
        np.matmul(self._shares, apart, out=moved[..., :-1, None, :])
        moved[..., :-1, :] += (turned - arms)[..., 0]
        costs = balance.offset_cost(balance.offset(published.positions[..., None, :, :]) + balance.horizontal(moved))
        return costs[..., -1:] - costs[..., :-1]

    def _compare(self, gain: np.ndarray) -> None:
        self._age += 1
        self._advantage += SHARES.take(self._age, mode="clip") * (gain - self._advantage)

    def exchange(self, published: EvaluatedState) -> BodyState | None:
        """The published state with a better limb, or None.

        If there is none, at most one hypothesis is restarted: one that is much worse, or equals the published limb.
        """
        if not self.count:
            return None
        mature, other = self._age >= MATURE_FROM, self._apart > SAME_STATE
        best = int(np.where(mature & other, self._advantage, -np.inf).argmax())
        if mature[best] and other[best] and limb_replaces(self._advantage[best]):
            return self._exchanged(best, published.state)
        done = (self._age >= LARGEST_AGE) & (~other | (self._advantage < RESTART_MARGIN))
        if np.count_nonzero(done):  # ten times faster than any() here
            self._restart(int((done * self._age).argmax()), published)
        return None

    def _exchanged(self, best: int, state: BodyState) -> BodyState:
        """Exchange the limb of the state with the hypothesis `best`, and return the new state.

        Relative to the new published limb, the limb's two other hypotheses change their roles.
        """
        chain, rotations = self._chains[best], state.rotations.copy()
        rotations[chain] = self._rotations[best]
        self._rotations[best] = state.rotations[chain]
        self._age[best] = COUNTED_FROM + MEMORY  # so that one frame cannot change it back
        limb = np.arange(3) + best - best % 3
        self._advantage[limb] -= self._advantage[best]
        self._advantage[best] = -LIMB_MARGIN
        one, two = (slot for slot in limb if slot != best)
        for values in (self._rotations, self._advantage, self._age):
            values[[one, two]] = values[[two, one]]
        return BodyState(rotations, state.translation)

    def _restart(self, explanation: int, published: EvaluatedState) -> None:
        self._rotations[explanation] = self._mirroring.limb(published.state, explanation, published.pose)
        self._age[explanation], self._advantage[explanation] = 0, 0.0

    def _posed(self, published: EvaluatedState) -> BodyPose:
        """Forward kinematics: orientations (h, 3, 3, 3) and positions (h, 3, 3) of the chains, landmarks (h, c, 3)."""
        pose, rotations = published.pose, self._rotations
        there, centres = pose.orientations.take(self._chains, axis=-3), pose.positions.take(self._chains, axis=-2)
        first = published.state.rotations.take(self._chains[:, 0], axis=-3)
        orientation = there[..., 0, :, :] @ first.swapaxes(-1, -2)
        orientations = np.empty(rotations.shape)
        for joint in range(3):
            orientation = orientations[..., joint, :, :] = orientation @ rotations[..., joint, :, :]
        # The vectors fixed to a joint rotate with it: the bone to the next joint, the vectors to landmarks.
        people = rotations.shape[:-4]
        vectors = np.empty((*people, *self._turned_by.shape, 3, 1))
        np.subtract(centres[..., 1:, :], centres[..., :-1, :], out=vectors[..., :2, :, 0])
        landmarks, carriers = pose.landmarks.take(self._landmarks, -2), pose.positions.take(self._carriers, -2)
        np.subtract(landmarks, carriers, out=vectors[..., 2:, :, 0])
        turns = (orientations @ there.swapaxes(-1, -2)).reshape(*people, -1, 3, 3).take(self._turned_by, axis=-3)
        places = self._sums @ (turns @ vectors)[..., 0]
        places += centres[..., :1, :]
        return BodyPose(orientations, places[..., :3, :], places[..., 3:, :])

    def _image_rows(self, pose: BodyPose, frame: FrameData) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The image's transposed rows (h, 3 t, 2 c), right sides (h, 2 c) and robust cost (h,)."""
        places, F = project_with_jacobian(pose.landmarks)
        error = frame.points.take(self._landmarks, axis=-2) - places
        weight = frame.weights.take(self._landmarks, axis=-1) * self._real
        size = norm(error) * weight
        weight = weight * np.sqrt(capped_weights(size))
        F *= weight[..., None, None]
        error *= weight[..., None]
        joints = slice(0, self._turning)
        turning = BodyPose(pose.orientations[..., joints, :, :], pose.positions[..., joints, :], pose.landmarks)
        rows = F.reshape(*F.shape[:-3], -1, 3)
        columns = twists(turning, turning.orientations) @ wrenches(pose, pose.landmarks, rows).swapaxes(-1, -2)
        columns *= self._reach
        return columns, error.reshape(rows.shape[:-1]), capped_cost(size).dot(self._ones)
