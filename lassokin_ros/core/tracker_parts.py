"""The parts of a tracker: how they are built, reset, resized and configured. The steps are in `tracker`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton, has_built_in_proportions
from lassokin_ros.core.body.surface import BodySurface
from lassokin_ros.core.body.symmetry import LARGEST_ASYMMETRY, asymmetry, limb_groups, symmetrised
from lassokin_ros.core.calibration.bone_lengths import Calibration
from lassokin_ros.core.calibration.height import HeightEstimator
from lassokin_ros.core.calibration.size_check import SizeCheck
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.adaptive_mean import AdaptiveMean
from lassokin_ros.core.evidence.depth_estimator import DepthEstimator
from lassokin_ros.core.evidence.depth_network import shipped_network
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.learned_depth import LearnedDepth, has_target_joints
from lassokin_ros.core.evidence.model_error import ModelError
from lassokin_ros.core.evidence.pose_prior import PoseDistribution, PosePrior
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.core.hypotheses.body_hypotheses import BodyHypotheses
from lassokin_ros.core.hypotheses.initialisation import Initialiser
from lassokin_ros.core.hypotheses.limb_hypotheses import LimbHypotheses
from lassokin_ros.core.hypotheses.network_hypothesis import NetworkHypothesis
from lassokin_ros.core.hypotheses.reinitialisation import Reinitialisation
from lassokin_ros.core.image.frame_data import JointDepths
from lassokin_ros.core.image.measurement import MeasurementFilter
from lassokin_ros.core.increment import IncrementSolver
from lassokin_ros.core.lasso.solver import LassoSolver
from lassokin_ros.core.observation import Status
from lassokin_ros.core.output.fixed_lag import FixedLag
from lassokin_ros.core.output.observed import ObservedJoints
from lassokin_ros.core.output.output_filter import OutputFilter
from lassokin_ros.core.output.uncertainty import UncertaintyModel

ALTERNATIVE_BODIES = 1
"""Number of body hypotheses beside the published state, see `body_hypotheses`. A second one corrected no state sooner.
With the depth network there are none: the network's pose is the hypothesis."""

LEARNED = 0.04
"""Mean deviation of the learned log-lengths below which they are input to the depth network, as given ones are."""

LEAST_MOTION = 0.003
"""rad per frame: lower limit of the typical motion of a degree of freedom."""


class TrackerParts:
    """The parts of a tracker and its state: the body's, and what was learned until `reset`."""

    def __init__(
        self, config: TrackerConfig | None = None, skeleton: Skeleton | None = None, evidence: Sequence[Evidence] = ()
    ) -> None:
        """Build the tracker for one skeleton and one landmark layout.

        evidence: further pieces of evidence for each frame's lasso, see docs/extending.md.
        Raises a LassokinError (skeleton, layout, solver or setting) for a configuration that cannot be used.
        """
        self.config = (config or TrackerConfig()).checked()
        given = skeleton or Skeleton.load(self.config.skeleton, self.config.assumed_height)
        self._more_evidence = evidence
        self._upright = Upright(self.config.camera_roll, self.config.camera_pitch)
        self.height = HeightEstimator() if self.config.height == 0 else None
        """Measures the height, if the configured one is 0."""
        self._build(given)
        limbs = limb_groups(self.skeleton)[self.layout.joints]
        self._measurements = MeasurementFilter(self.layout.names, limbs, self.layout.surface, self.skeleton.height)
        self.reset()

    def _build(self, given: Skeleton) -> None:
        """Build all that depends on the size of the body."""
        self.skeleton = given
        difference = asymmetry(self.skeleton)
        self.averaged = difference if self.config.calibrate and difference > LARGEST_ASYMMETRY else 0.0
        """Difference of left and right of the given skeleton if it is too large, 0 otherwise. Calibration then starts
        with the mean of both sides."""
        if self.averaged:
            self.skeleton = symmetrised(self.skeleton)
        self.layout = Layout.load(self.config.landmarks, self.skeleton)
        self.kinematics = Kinematics(self.skeleton, self.layout)
        prior = PoseDistribution.load(self.skeleton)
        self._lengths_given = not has_built_in_proportions(given)
        self._depth = self._depth_estimator()
        learned = [] if self._depth is None else [LearnedDepth(self.kinematics)]
        pose_prior = PosePrior(prior, self.kinematics)
        self._rows = FrameModel(self.kinematics, pose_prior, self._upright, [*learned, *self._more_evidence])
        motion = np.maximum(prior.motion, LEAST_MOTION)[self._rows.live]
        self._increments = IncrementSolver(self._rows, LassoSolver(self.config.solver), motion)
        self._initialiser = Initialiser(self.kinematics, prior, self._rows)
        self._network_hypothesis = NetworkHypothesis(self._initialiser, prior, self._rows.balance)
        bodies = ALTERNATIVE_BODIES if self._depth is None else 0
        self._body_hypotheses = BodyHypotheses(self._initialiser, self._rows, bodies)
        self._limbs = LimbHypotheses(self.kinematics, pose_prior, self._initialiser.mirroring, self._rows.balance)
        self._reinitialisation = Reinitialisation(self.kinematics.landmark_count)
        self.model_error = ModelError(self.skeleton.height)
        self.calibration, self.adaptive_mean = Calibration(self._rows), AdaptiveMean(self._rows)
        self._output_filter, self._lag = OutputFilter(self.kinematics.joint_count), FixedLag(self.kinematics)
        proportions = self.calibration.proportions
        self._observed = ObservedJoints(self.skeleton, self.layout.joints)
        evidence = learned[0] if learned else None
        self._uncertainty = UncertaintyModel(self.kinematics, prior, proportions, self._observed, evidence)
        self._surface = BodySurface(self.skeleton)
        self.size_check = SizeCheck(self.kinematics)
        """Compares a given height with measured depth."""

    def _depth_estimator(self) -> DepthEstimator | None:
        """The depth network for this skeleton and layout; None if it is switched off or cannot be used with them."""
        if not self.config.depth_prior or not has_target_joints(self.skeleton):
            return None
        estimator = DepthEstimator(shipped_network(), self.kinematics)
        return estimator if estimator.usable else None

    def reset(self, same_camera: bool = False) -> None:
        """Forget the state; the next usable frame initialises anew.

        same_camera: True if the camera stays as it is and only the person changes: the learned vertical is kept.
        """
        self._state: BodyState | None = None
        self._stuck_frames = 0
        self._status = Status.SEARCHING
        self._successor: BodyState | None = None
        self._another_body = False  # the successor differs by more than one limb
        self._cost = float("nan")
        self._joint_depths: JointDepths | None = None
        if self._depth is not None:
            self._depth.reset()
        self._network_hypothesis.reset()
        self._increments.reset()
        self.size_check.reset()
        if self.height is not None and self.height.measured:
            self.height.reset()
            self._resize(self.config.assumed_height)
        self._measurements.reset()
        self._output_filter.reset()
        self._lag.reset()
        self.published: list[Estimate] = []
        """Estimates that became due with the last observation, in order: that observation's own, or with
        `smoothing_lag` earlier ones, smoothed, each with the stamp of its own frame."""
        if not same_camera:
            self._upright.reset()
        self._body_hypotheses.stop()
        self._reinitialisation.reset()
        self.calibration.reset()
        self.adaptive_mean.reset()
        self.model_error.reset()
        self._adopt_lengths()

    @property
    def state(self) -> BodyState | None:
        """The present state; None before the first usable frame."""
        return self._state

    def adopt_vertical(self, others: Iterable[TrackerParts]) -> None:
        """Copy the camera's vertical from trackers of other people in the same images, if one has learned it."""
        self._upright.adopt(other._upright for other in others)

    def move_camera(self, roll: float, pitch: float) -> None:
        """Use a measured mount of the camera, rad, from the next frame on; see `camera_roll` and `camera_pitch`.

        The state stays: the camera may be on a head that moves.
        """
        self._upright.move_mount(roll, pitch)

    def tune(self, config: TrackerConfig, skeleton: Skeleton | None = None) -> None:
        """Use new live settings. The others (skeleton, landmarks, depth_prior, solver) stay as they are.

        A new height makes the tracker forget the person. skeleton: for the new height, in place of the configured one.
        Raises a LassokinError, before anything is changed, for a setting or a skeleton that cannot be used.
        """
        before, config, given = self.config, self.config.with_live_of(config), None
        if config.height != before.height:
            given = skeleton or Skeleton.load(config.skeleton, config.assumed_height)
        self.config = config
        if given is not None:
            self._use_height(given)
        if (config.camera_roll, config.camera_pitch) != (before.camera_roll, before.camera_pitch):
            self._upright.set_mount(config.camera_roll, config.camera_pitch)

    def _use_height(self, given: Skeleton) -> None:
        """Forget the person and use another body, for a new setting of the height."""
        self.reset()
        self.height = HeightEstimator() if self.config.height == 0 else None
        self._build(given)
        self._measurements.resize(self.layout.surface, self.skeleton.height)
        self._adopt_lengths()

    def _resize(self, height: float) -> None:
        """Rebuild all parts for a body of this height, m, with the given proportions."""
        given = self.calibration.proportions.given
        self._build(given.scaled(height / given.height))
        self._measurements.resize(self.layout.surface, self.skeleton.height)

    def _adopt_lengths(self) -> None:
        self.skeleton = self.calibration.skeleton
        self.kinematics.set_skeleton(self.skeleton)
        if self._depth is not None and not self._lengths_given:
            certain = bool(self.calibration.lengths.any()) and bool(self.calibration.spread.mean() < LEARNED)
            self._depth.use_lengths(self.skeleton, certain)
        self._body_hypotheses.refresh()
