"""Limbs on the other side: each limb's mirror images in depth are followed beside the limb as it is published.

What one camera takes for something else is nearly always one bone of one limb, leaning away where it leans towards the
camera (see `mirroring`). So of every limb all such explanations are kept: both bones mirrored, the outer one, the inner
one. They turn the limb's own joints alone, with the rest of the body as published, by one Gauss-Newton step a frame for
all of them at once. One whose cost, averaged over some frames, is lower takes the limb's place in the next frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from lassokin_ros.core.band_solver import BandSolver
from lassokin_ros.core.batch import shared
from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics, twists, wrenches
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.evidence.balance import Balance
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.pose_prior import PosePrior
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.core.hypotheses.initialisation import within
from lassokin_ros.core.hypotheses.limb_prior import LimbPrior
from lassokin_ros.core.hypotheses.mirroring import Mirroring
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import project_with_jacobian
from lassokin_ros.core.image.robust_loss import capped_cost, capped_weights, norm, squared_norm

COUNTED_FROM = 2
"""Frames of age after which an explanation's cost counts: by then it has found its place."""
OLD_ENOUGH = 4
"""Frames of age from which it may win."""
GIVEN_UP_FROM = 10
"""Frames of age from which it may be mirrored anew."""
MEMORY = 6
"""Frames over which costs are averaged."""
SHARES = np.append(np.zeros(COUNTED_FROM + 1), 1 / np.arange(1.0, MEMORY + 1))
"""What a frame's cost is of the average, by age in frames, the last from then on."""
MARGIN = 0.6
"""By how much (a negative log-likelihood) it must be better; less than for another body, of which more may change."""
HOPELESS = -6.0
"""One that is worse by this is mirrored anew."""
ALIKE = 0.01
"""m: distance of the limb's joints below which it has become the published one."""
DAMPING = 1e-3
"""1/rad^2, keeps turns that nothing observes where they are."""


class LimbHypotheses:
    """The h other explanations of one skeleton's limbs, three of each limb.

    A limb is a chain of joints from the trunk out. What is fixed to its last joint, a foot or a hand, stays as it is
    published relative to that; the last joint itself turns only where landmarks show it. Of several people at once (see
    `together`) all arrays have a first axis of people.
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
        """(h, c) of each limb its landmarks, padded, and which of its joints, 0 to 2, carries each."""
        skeleton, joints = self._kinematics.skeleton, self._kinematics.layout.joints
        carries = skeleton.ancestors[joints][:, self._chains[:, 0]].T
        #: (l, h): 1 where a landmark is carried by the limb.
        self._carries = carries.T.astype(float)  # for products
        most = carries.sum(axis=1).max()
        self._landmarks = np.argsort(~carries, axis=1, kind="stable")[:, :most]
        self._real = np.take_along_axis(carries, self._landmarks, axis=1)
        carried = skeleton.ancestors[joints[self._landmarks][:, :, None], self._chains[:, None, :]]
        carrier = np.maximum(carried.sum(axis=-1) - 1, 0)
        explanation = np.arange(self.count)[:, None]
        self._carriers = self._chains[explanation, carrier]
        #: (h, 2 + c) of the two bones and the ways to the landmarks, the joint of all h x 3 that turns each.
        self._turned_by = 3 * explanation + np.insert(carrier, 0, [[0], [1]], axis=1)
        #: (h, 3 + c, 2 + c): joints and landmarks are sums of those.
        self._sums = np.zeros((self.count, 3 + most, 2 + most))
        self._sums[:, 1:3, 0] = self._sums[:, 2, 1] = 1.0
        self._sums[:, 3:, :2] = carrier[:, :, None] > np.arange(2)
        self._sums[:, 3 + np.arange(most), 2 + np.arange(most)] = 1.0
        self._ones = np.ones(most)
        #: (h, 1, 3): how far the balance follows each joint of a chain, the last with all that is fixed to it.
        self._shares = self._balance.shares[self._chains][:, None]
        self._shares[:, 0, 2] = self._balance.shares @ skeleton.ancestors[:, self._chains[:, 2]]
        #: (h, 9, 2 c): which of the chain's turns moves which row.
        self._reach = np.kron(carried.swapaxes(1, 2), np.ones((3, 2)))

    def _find_turns(self, prior: PosePrior) -> None:
        """How many joints from the trunk out turn (t), and their places among the prior's; 0 for those it has not."""
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
        """Mirror all limbs of a state anew."""
        self._age, self._advantage = np.zeros(self.count, dtype=int), np.zeros(self.count)
        #: (h, 3, 3, 3) of each explanation the local rotations of its chain.
        self._rotations = self._mirroring.all(state).rotations[np.arange(self.count)[:, None], self._chains]

    @staticmethod
    def stack(several: Sequence[LimbHypotheses]) -> LimbHypotheses:
        """Of several people, by the vertical of each; what `advance` takes is put in their place, see `together`."""
        whole, first = copy(several[0]), several[0]
        whole._balance = first._balance.with_vertical(Upright.stack([one._balance.upright for one in several]))
        whole._systems = BandSolver.of(len(several) * first.count, 3 * first._turning)
        return whole

    @shared(takes=("_rotations", "_age", "_advantage"), gives=("_rotations", "_age", "_advantage", "_apart"))
    def advance(self, published: EvaluatedState, frame: FrameData, image_costs: np.ndarray) -> None:
        """One Gauss-Newton step of every explanation on a frame, and its cost beside the published limb's.

        image_costs: (l,) the published state's, per landmark.
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
        # What it costs after the step, by its own model.
        cost = image_cost + prior_cost - 0.5 * (g[..., None, :] @ step[..., None])[..., 0, 0]
        gain = image_costs.dot(self._carries) + published_prior_cost - cost
        self._compare(gain + self._steadier(pose, published.pose))
        turning[:] = turning @ exponential(within(step).reshape(turning.shape[:-1]))
        self._apart = norm(pose.positions - published.pose.positions.take(self._chains, axis=-2)).max(axis=-1)

    def _steadier(self, pose: BodyPose, published: BodyPose) -> np.ndarray:
        """(h,) how much less each explanation costs than the published pose by the body's balance."""
        balance, last = self._balance, self._chains[:, 2]
        arms = balance.arms(published.positions).take(last, axis=-2)[..., None]  # of what is fixed to the last joint
        turned = pose.orientations[..., 2, :, :] @ (published.orientations.take(last, -3).swapaxes(-1, -2) @ arms)
        apart = pose.positions - published.positions.take(self._chains, axis=-2)
        moved = np.zeros((*apart.shape[:-3], self.count + 1, 3))  # that of the published pose, last, is 0
        np.matmul(self._shares, apart, out=moved[..., :-1, None, :])
        moved[..., :-1, :] += (turned - arms)[..., 0]
        costs = balance.offset_cost(balance.offset(published.positions[..., None, :, :]) + balance.horizontal(moved))
        return costs[..., -1:] - costs[..., :-1]

    def _compare(self, gain: np.ndarray) -> None:
        self._age += 1
        self._advantage += SHARES.take(self._age, mode="clip") * (gain - self._advantage)

    def exchange(self, published: EvaluatedState) -> BodyState | None:
        """The published state with a limb that explains more, or None.

        Without one, at most one explanation is mirrored anew: one that is hopeless, or has become the published limb.
        """
        if not self.count:
            return None
        ripe, other = self._age >= OLD_ENOUGH, self._apart > ALIKE
        best = int(np.where(ripe & other, self._advantage, -np.inf).argmax())
        if ripe[best] and other[best] and self._advantage[best] > MARGIN:
            return self._exchanged(best, published.state)
        done = (self._age >= GIVEN_UP_FROM) & (~other | (self._advantage < HOPELESS))
        if np.count_nonzero(done):  # a tenth of what any() costs
            self._renew(int((done * self._age).argmax()), published)
        return None

    def _exchanged(self, best: int, state: BodyState) -> BodyState:
        """The state with one explanation's limb, which the state's own replaces here.

        Of the limb's other two explanations each is now, seen from the published limb, what the other one was.
        """
        chain, rotations = self._chains[best], state.rotations.copy()
        rotations[chain] = self._rotations[best]
        self._rotations[best] = state.rotations[chain]
        self._age[best] = COUNTED_FROM + MEMORY  # one frame is not enough to change back
        limb = np.arange(3) + best - best % 3
        self._advantage[limb] -= self._advantage[best]
        self._advantage[best] = -MARGIN
        one, two = (slot for slot in limb if slot != best)
        for values in (self._rotations, self._advantage, self._age):
            values[[one, two]] = values[[two, one]]
        return BodyState(rotations, state.translation)

    def _renew(self, explanation: int, published: EvaluatedState) -> None:
        self._rotations[explanation] = self._mirroring.limb(published.state, explanation, published.pose)
        self._age[explanation], self._advantage[explanation] = 0, 0.0

    def _posed(self, published: EvaluatedState) -> BodyPose:
        """Orientations (h, 3, 3, 3) and positions (h, 3, 3) of the chains' joints, landmarks (h, c, 3)."""
        pose, rotations = published.pose, self._rotations
        there, centres = pose.orientations.take(self._chains, axis=-3), pose.positions.take(self._chains, axis=-2)
        first = published.state.rotations.take(self._chains[:, 0], axis=-3)
        orientation = there[..., 0, :, :] @ first.swapaxes(-1, -2)
        orientations = np.empty(rotations.shape)
        for joint in range(3):
            orientation = orientations[..., joint, :, :] = orientation @ rotations[..., joint, :, :]
        # What is fixed to a joint turns with it: the bone to the next one, the way to a landmark.
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
        """The image's columns (h, 3 t, 2 c) as rows, right sides (h, 2 c), and robust cost (h,)."""
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
