"""The tracker: one observation in, one estimate out.

    tracker = Tracker(TrackerConfig(height=1.75))
    estimate = tracker.track(Observation(stamp, points, confidence, focal))

The tracker follows the paper's method frame by frame in a closed loop. It compares the observation with the projection
of the present state (not with the last observation, which would drift), linearises the model about that state (12),
solves the lasso for the increment of all joints and the translation, certifies the answer, and retracts it onto SO(3).
With `relinearisations` above 1 it linearises again about the answer, with the l1 penalty on the total increment.
The published pose is the solved state, smoothed over a few frames (`output_filter`); the next frame starts from the
state as solved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial, reduce
from itertools import repeat
from typing import Any

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.roles import ANKLES, missing_roles
from lassokin_ros.core.body.rotations import orthonormalised
from lassokin_ros.core.body.skeleton import Skeleton, has_built_in_proportions
from lassokin_ros.core.body.symmetry import symmetric_skeleton
from lassokin_ros.core.cameras import Camera
from lassokin_ros.core.config import GIVEN, LEARN, TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.initialisation import Fit, Initialiser
from lassokin_ros.core.hypotheses.mirrored_limbs import MirroredLimbs
from lassokin_ros.core.hypotheses.network_pose import NetworkPose
from lassokin_ros.core.hypotheses.other_pose import OtherPose
from lassokin_ros.core.hypotheses.reinitialisation import COST_SHARE, Reinitialisation
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.gating import gate_observation
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.image.robust_loss import squared_norm
from lassokin_ros.core.image.triangulation import triangulate
from lassokin_ros.core.increment import Increment, IncrementSolver
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.learned.bone_lengths import OBSERVED_STATURE_DEVIATION
from lassokin_ros.core.learned.depth_noise import DepthNoise
from lassokin_ros.core.learned.extrinsics import Extrinsics
from lassokin_ros.core.learned.foot_contacts import on_floor
from lassokin_ros.core.learned.height import PEOPLE_DEVIATION, FloorSize, floor_size
from lassokin_ros.core.learned.learned import Learned
from lassokin_ros.core.network.depth_estimator import DepthEstimator
from lassokin_ros.core.network.depth_network import shipped_network
from lassokin_ros.core.observation import HERE, CameraPose, Observation, Rejection, Status, has_passed, is_longer
from lassokin_ros.core.output.fixed_lag import Backward, FixedLag, Waiting
from lassokin_ros.core.output.observed import ObservedJoints
from lassokin_ros.core.output.output_filter import OutputFilter
from lassokin_ros.core.output.uncertainty import JointUncertainty, UncertaintyModel
from lassokin_ros.core.record import record

SMALLEST_PX = 3.0
"""Height of the person in the image, in noise_px, below which a body is rejected: random keypoints fit far away."""
STUCK_AFTER = 3
"""Consecutive frames without a usable answer (no certificate, behind the camera, too small) after which the tracker
initialises anew. If the answers stay unusable, it does so in every third frame only: the full search takes a hundred
times as long as a frame. With the pose of one of two cameras inverted in TF, it would otherwise run in most frames."""
FARTHEST_FLOOR = 1e12
"""m: largest distance of a floor from the origin. With larger ones the computations overflow."""
GOOD_FIT = 3.0
"""Cost per visible landmark up to which a fit that started from the network's pose is used without another search."""
OF_NO_CAMERA: dict[str, Any] = {
    "extrinsics": GIVEN, "camera_roll": 0.0, "camera_pitch": 0.0, "camera_height": 0.0, "tilt_deviation": 0.0
}  # fmt: skip
"""Settings for a camera without a pose: those of the mount are about the first camera."""
FIT_AFTER = 0.15
"""s since the last new keypoints from which the frame starts from a fit, because the last state is too old. MPJPE at
5 Hz: 49.3 mm with, 51.0 without."""


@record
class _Answer:
    """An accepted frame: what was measured, the state about which it was linearised, and its lasso's answer.

    measured: of each camera with an image; together: of all, see `Tracker._together`. initialised: whether `start` was
    fitted to this frame alone. solved: the state after the increment.
    """

    measured: dict[Camera, Measurement]
    together: Measurement
    frame: FrameData
    start: EvaluatedState
    initialised: bool
    increment: Increment
    solved: EvaluatedState


class Tracker:
    """Tracks one person. Its state is that of the body, and what was learned until `reset`."""

    def __init__(
        self,
        config: TrackerConfig | None = None,
        skeleton: Skeleton | None = None,
        evidence: Sequence[Evidence] = (),
        up: np.ndarray | None = None,
    ) -> None:
        """Build the tracker for one skeleton and one landmark layout.

        skeleton: in place of the configured one. evidence: further pieces of evidence for each frame's lasso, see
        docs/extending.md. up: (3,) the vertical of the fixed frame in which the cameras' places are given, of any
        length; None if the skeleton is kept in the first camera's optical frame, whose mount the settings give. Raises
        a LassokinError (skeleton, layout, solver or setting) for a configuration that cannot be used.
        """
        self.config = (config or TrackerConfig()).checked()
        self.given_skeleton = skeleton or Skeleton.load(self.config.skeleton, self.config.assumed_height)
        """The body before anything is learned, at the configured height."""
        body, self.averaged = symmetric_skeleton(self.given_skeleton, self.config.calibrate)
        """Difference of left and right of the given skeleton if calibration starts with their mean, else 0."""
        self.kinematics = Kinematics(body, Layout.load(self.config.landmarks, body))
        prior = PoseDistribution.load(body)
        self.frame_model = FrameModel(self.kinematics, prior, evidence)
        self.learned = Learned(self.frame_model, self.config, None if up is None else _unit_vertical(up))
        self._cameras = [Camera(self.kinematics, self._depth_estimator(), self.learned.depth_noise)]
        """In the order in which they were first seen; the first one always exists."""
        self._increments = IncrementSolver(self.frame_model, prior, self.config.solver)
        self._initialiser = Initialiser(self.kinematics, prior, self.frame_model)
        self._network_pose = None
        propose = MirroredLimbs(self.kinematics).propose
        if self._network is not None:
            self._network_pose = NetworkPose(self._network_places, self.kinematics, self._initialiser.mean_pose)
            propose = self._network_pose.propose
        self._other_pose = OtherPose(self._initialiser, self.frame_model, propose)
        self._reinitialisation = Reinitialisation()
        self._output_filter, self._lag = OutputFilter(self.kinematics.joint_count), FixedLag(self.kinematics)
        observed = ObservedJoints(body, self.layout.joints)
        self._ankles = tuple(body.index(ankle) for ankle in ANKLES) if self.frame_model.foot_contact else ()
        self._ankle_points = np.equal.outer(self._ankles, self.layout.joints)  # (2, l)
        self.floor_below = None
        self._uncertainty = UncertaintyModel(self.frame_model, prior, self.learned.lengths.proportions, observed)
        self.backward: Callable[[float], Backward | None] | None = None
        """The frame at a stamp, s, by a track backward in time; `published` is then between both, see `recording`."""
        self.reset()

    def _depth_estimator(self) -> DepthEstimator | None:
        """The depth network's estimator; None if it is switched off or cannot be used with this skeleton and layout."""
        if not (self.config.depth_prior and DepthEstimator.fits(self.kinematics)):
            return None
        return DepthEstimator(shipped_network(), self.kinematics)

    def reset(self, same_camera: bool = False) -> None:
        """Forget the state; the next usable frame initialises anew.

        same_camera: True if the cameras stay as they are and only the person changes: the learned vertical and the
        corrections of the cameras' poses are kept.
        """
        self._solved: EvaluatedState | None = None
        self._replaced = False  # whether the next frame starts from another state than the last one solved
        self._status, self._stuck_frames, self._cost = Status.SEARCHING, 0, float("nan")
        for camera in self._cameras:
            camera.reset()
        self._unplaced: dict[str, Tracker] = {}  # of the person as each camera without a pose sees it
        self._increments.reset()
        self._reinitialisation.reset()
        self._output_filter.reset()
        self._lag.reset()
        self._other_pose.reset()
        if self.learned.height is not None and self.learned.height.measured:
            self.learned.resize(self.given_skeleton.height / self.skeleton.height)
        self.learned.reset(same_camera)
        self.published: list[Estimate] = []
        """Estimates that became due with the last observation, in order: that observation's own, or with
        `smoothing_lag` earlier ones, smoothed, each with the stamp of its own frame."""
        self._adopt_lengths()

    @property
    def _newest(self) -> float:
        """s: stamp of the last frame that was used, -inf before the first."""
        return max(camera.measurements.newest for camera in self._cameras)

    @property
    def _network(self) -> DepthEstimator | None:
        """The depth network of the first camera; None if it is not used."""
        return self._cameras[0].network

    def _network_places(self) -> np.ndarray | None:
        """The places by the network of the first camera that sees the person and has them, in the skeleton's frame."""
        newest = max(camera.newest for camera in self._cameras)
        lately = (camera for camera in self._cameras if camera.seen_lately(newest))
        return next((found for camera in lately if (found := camera.network_places()) is not None), None)

    @property
    def state(self) -> BodyState | None:
        """The present state; None before the first usable frame."""
        return None if self._solved is None else self._solved.state

    @property
    def skeleton(self) -> Skeleton:
        """The body with the lengths as they are known now."""
        return self.kinematics.skeleton

    @property
    def floor_below(self) -> float | None:
        """m: how far a flat floor is below the origin of the skeleton's frame; None for `camera_height`.

        Raises ConfigurationError, when it is set, for a number that is not finite or beyond `FARTHEST_FLOOR`.
        """
        return self._floor_below

    @floor_below.setter
    def floor_below(self, below: float | None) -> None:
        if below is not None and not abs(below) <= FARTHEST_FLOOR:
            raise ConfigurationError(f"floor_below is {below}; expected metres, up to {FARTHEST_FLOOR:g}, or None")
        self._floor_below = below

    @property
    def floor(self) -> np.ndarray | None:
        """See `FrameData.floor`. The learned vertical is not used: it is off by 5 degrees in the median."""
        up, below = self.learned.vertical.mount, self.floor_below
        if below is None and self.config.camera_height:
            below = self.config.camera_height - float(up @ self._cameras[0].pose.centre)
        return None if below is None else np.append(up, below)

    @property
    def layout(self) -> Layout:
        """The landmarks, on this body."""
        return self.kinematics.layout

    @property
    def limitations(self) -> str:
        """What is off because joints or landmarks are missing, in one line; empty if nothing is."""
        off = missing_roles(self.skeleton.joint_names)
        if not off and self.config.depth_prior and self._network is None:
            return f"layout '{self.layout.name}' has too few of the points that the depth network needs; it is off"
        return off

    def adopt_vertical(self, others: Iterable[Tracker]) -> None:
        """Copy the vertical from trackers of other people in the same images, if one has learned it."""
        self.learned.vertical.adopt(other.learned.vertical for other in others)

    def adopt_cameras(self, other: Tracker) -> None:
        """Begin with the poses that another tracker has learned of the same cameras, if this one learns them, too."""
        own, known = self.learned.extrinsics, other.learned.extrinsics
        if own is not None and known is not None and self.config.extrinsics == LEARN:
            own.adopt(known)

    def move_camera(self, roll: float, pitch: float) -> None:
        """Use a measured mount of the camera, rad, from the next frame on; see `camera_roll` and `camera_pitch`.

        The state stays. Raises ConfigurationError for angles that are not finite.
        """
        if not (math.isfinite(roll) and math.isfinite(pitch)):
            raise ConfigurationError(f"the mount has roll {roll} and pitch {pitch}; expected finite angles, rad")
        self.learned.vertical.move_mount(roll, pitch)

    def place_cameras(self, poses: Sequence[CameraPose]) -> None:
        """Tell where cameras without an image of the next instant are then: their keypoints are predicted to it."""
        extrinsics = self.learned.extrinsics
        for pose in poses:
            if (camera := self._named(pose.name)) is not None:
                camera.pose = pose if extrinsics is None else extrinsics.received(pose)
                camera.given = pose if extrinsics is None else extrinsics.given(pose)

    def move_frame(self, rotation: np.ndarray, translation: np.ndarray) -> None:
        """Keep the body where it is although its frame has moved: x is at rotation x + translation from now on.

        rotation: (3, 3), about the vertical; translation: (3,) m.
        """
        for camera in self._cameras:
            camera.move_frame(rotation, translation)
        if self.learned.extrinsics is not None:
            self.learned.extrinsics.move_frame(CameraPose("", rotation, translation))
        if self._solved is None:
            return
        state = self._solved.state
        rotations = np.concatenate([rotation @ state.rotations[:1], state.rotations[1:]])
        self._solved = self.frame_model.evaluate(BodyState(rotations, rotation @ state.translation + translation))
        self._replaced = True

    def tune(self, config: TrackerConfig) -> None:
        """Use new live settings; the others stay as they are.

        A new height scales the given body, and makes the tracker forget the person; so does `calibrate` if another body
        results, see `averaged`. Raises ConfigurationError, before anything is changed, for a setting out of its range.
        """
        before, config = self.config, self.config.with_live_of(config)
        given = self.given_skeleton.at_height(config.assumed_height)  # raises for a height out of range
        body, averaged = symmetric_skeleton(given, config.calibrate)
        self.config = config
        if config.height != before.height or averaged != self.averaged:
            self.reset()
            self.given_skeleton, self.averaged = given, averaged
            self.learned.use_body(body, config.height == 0)
            self._adopt_lengths()
        if (config.camera_roll, config.camera_pitch) != (before.camera_roll, before.camera_pitch):
            self.learned.vertical.set_mount(config.camera_roll, config.camera_pitch)

    def track(self, observation: Observation | Sequence[Observation]) -> Estimate:
        """Process one observation, or those of several cameras, which are solved jointly.

        Observations that are given together are of one instant: their stamps differ by 5 ms at most. Other cameras take
        part with keypoints predicted to that instant. Bad input does not raise: see `Estimate.rejection`.
        """
        observations = [observation] if isinstance(observation, Observation) else list(observation)
        self.published = []
        if not observations:
            return Estimate(self._newest, self._status, Rejection.TOO_FEW_LANDMARKS)
        extrinsics, known = self.learned.extrinsics, all(one.camera.known for one in observations)
        if extrinsics is not None and (len(observations) > 1 or len(self._cameras) > 1 or not known):
            observations = [replace(one, camera=extrinsics.received(one.camera)) for one in observations]
        placed = [one for one in observations if one.camera.known]
        estimate = self._track(placed) if placed else self._reject(observations[0], Rejection.UNPLACED)
        if extrinsics is not None and self.config.extrinsics == LEARN and len(placed) < len(observations):
            self._find_cameras([one for one in observations if not one.camera.known], extrinsics)
        return estimate

    def _track(self, observations: Sequence[Observation]) -> Estimate:
        """Process the observations of placed cameras, of one instant."""
        measured, rejection = self._measure(observations)
        if rejection is not None:
            return self._reject(observations[0], rejection)
        measurement = self._together(measured)
        frame = self._frame_data(measured, measurement, observations[0])
        extrinsics = self.learned.extrinsics
        if extrinsics is not None and frame.others and not measurement.repeated:  # also if the lasso has no answer
            extrinsics.update(measurement.stamp, frame)
        if frame.point_count < self.config.min_landmarks:
            return self._reject(observations[0], Rejection.TOO_FEW_LANDMARKS)
        start, initialised = self._start(measurement, frame)
        increment = self._solve(start, initialised, frame, measurement)
        rejection = self._check(start.state, increment, frame, measurement.focal)
        if rejection is not None:
            return self._reject(observations[0], rejection, increment.solution.certificate)
        moved = start.state.retract(increment.omega, increment.x)
        solved = self.frame_model.evaluate(BodyState(orthonormalised(moved.rotations), moved.translation))
        answer = _Answer(measured, measurement, frame, start, initialised, increment, solved)
        smoothed = self._smooth(answer)
        better = self._better_state(answer)
        self._follow_feet(answer, initialised or self._replaced or better is not None)
        estimate = self._estimate(answer, smoothed)
        for camera, one in measured.items():
            camera.measurements.mark_used(one)
        self._publish(estimate, measured)
        self._solved, self._replaced = better or solved, better is not None
        self._learn(answer)
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
        """Return (n,) bool, the joints that keypoints observe. Raises ValueError for a rejected frame."""
        if estimate.visible is None:
            raise ValueError("this frame was rejected; only an accepted estimate has observed joints")
        return self._uncertainty.observed.from_visible(estimate.visible)

    def _find_cameras(self, observations: Sequence[Observation], extrinsics: Extrinsics) -> None:
        """Compare what cameras without a pose see, each by itself, with the tracked person."""
        for one in observations:
            name = one.camera.name
            if name not in self._unplaced:
                body = self.learned.lengths.proportions.given
                self._unplaced[name] = Tracker(replace(self.config, **OF_NO_CAMERA, height=body.height), body)
            alone = self._unplaced[name]
            own = alone.track(replace(one, camera=HERE))
            usable = own.accepted and not own.repeated and not is_longer(one.stamp - self._newest, FIT_AFTER)
            if not usable or alone._solved is None or self._solved is None:
                continue
            views = self._seen_at(one.stamp), alone._seen_at(one.stamp)
            extrinsics.find(name, one.stamp, views, (self._solved.pose.positions, alone._solved.pose.positions))
            if name in extrinsics.found:
                del self._unplaced[name]

    def _seen_at(self, stamp: float) -> FrameData:
        """What the first camera that sees the person sees at a stamp, s, predicted by its tracks."""
        seeing = next((camera for camera in self._cameras if camera.seen_lately(stamp)), self._cameras[0])
        return seeing.predicted_view(stamp, self.learned.vertical, self._body, self.learned.model_error.deviation)

    @property
    def _body(self) -> BodyPose | None:
        """The solved pose of the last frame."""
        return None if self._solved is None else self._solved.pose

    def _measure(self, observations: Sequence[Observation]) -> tuple[dict[Camera, Measurement], Rejection | None]:
        """The measurements of the cameras whose observations can be used; the reason to reject if there are none."""
        measured: dict[Camera, Measurement] = {}
        first: Rejection | None = None
        for observation in observations:
            camera = self._camera(observation.camera)
            newest = camera.measurements.newest
            rejection, weights = gate_observation(observation, newest, self.layout, self.config)
            if rejection is not None or camera in measured:
                first = first or rejection or Rejection.OLD_STAMP
                continue
            body, error = self._body, self.learned.model_error.deviation
            others = (other for other in self._cameras if other is not camera)
            alone = body is None or not any(other.seen_at(observation.stamp) for other in others)
            extrinsics, pose = self.learned.extrinsics, observation.camera
            camera.given = pose if extrinsics is None else extrinsics.given(pose)
            measurement = camera.measure(observation, weights, body, error, self.config, alone)
            if len(self._cameras) > 1 and observation.stamp <= self._newest:  # a later image has been used
                camera.measurements.mark_used(measurement)
                first = first or Rejection.LATE
                continue
            measured[camera] = measurement
        return measured, None if measured else first

    def _named(self, name: str) -> Camera | None:
        """The camera of this name; None if it has had no image."""
        return next((camera for camera in self._cameras if camera.name == name), None)

    def _camera(self, pose: CameraPose) -> Camera:
        """The camera of this pose's name. A new one gets a filter, a depth network, and rows in the lasso."""
        if self._cameras[0].name is None:
            self._cameras[0].name, self._cameras[0].pose = pose.name, pose
        camera = self._named(pose.name)
        if camera is None:
            camera = Camera(self.kinematics, self._depth_estimator(), DepthNoise(), pose.name)
            camera.pose = pose
            self._tell_lengths(camera)
            self._cameras.append(camera)
            self.frame_model.add_camera()
        return camera

    def _together(self, measured: dict[Camera, Measurement]) -> Measurement:
        """The measurement of the first camera with an image, with the times and the speed of all."""
        measurement = next(iter(measured.values()))
        if len(self._cameras) == 1:
            return measurement
        stamp = max(one.stamp for one in measured.values())
        before = max(camera.measurements.last_new_stamp for camera in self._cameras)
        repeated = min(one.repeated for one in measured.values())
        return replace(
            measurement,
            stamp=stamp,
            speed=float(np.mean([one.speed for one in measured.values()])),
            repeated=repeated,
            step=stamp - self._newest,
            since_new_keypoints=0.0 if repeated else stamp - before,
            lost=is_longer(stamp - (self._newest if repeated else before), self.config.lost_after),
        )

    def _frame_data(
        self, measured: dict[Camera, Measurement], together: Measurement, observation: Observation
    ) -> FrameData:
        """The views of all cameras, without measured depths as long as the person's size is unknown."""
        sized, vertical = self.learned.height is None or self.learned.height.measured, self.learned.vertical
        body, error = self._body, self.learned.model_error.deviation
        main, *others = (
            camera.view(measured[camera], vertical, sized)
            if camera in measured
            else camera.predicted_view(together.stamp, vertical, body, error)
            for camera in self._cameras
        )
        floor, extra = self.floor, observation.extra
        if floor is None and not (extra or others):
            return main
        return replace(main, extra=extra, floor=floor, others=tuple(others))

    def _start(self, measurement: Measurement, frame: FrameData) -> tuple[EvaluatedState, bool]:
        """The state about which the frame is linearised, and whether it was fitted to this frame alone."""
        stuck = self._stuck_frames > 0 and self._stuck_frames % STUCK_AFTER == 0
        if self._solved is None or measurement.lost or stuck:
            fit = self._first_fit(frame)
            self._cost = fit.cost
            return self.frame_model.evaluate(fit.state), True
        if self._network_pose is None:
            return self._start_without_network(self._solved, measurement, frame)
        if not has_passed(measurement.since_new_keypoints, FIT_AFTER):
            return self._solved, False
        starts = self._solved.state, self._network_pose.state()
        fits = [self._initialiser.fit_near(start, frame) for start in starts if start is not None]
        self._replaced = True
        return self.frame_model.evaluate(min(fits, key=lambda fit: fit.cost).state), False

    def _start_without_network(
        self, tracked: EvaluatedState, measurement: Measurement, frame: FrameData
    ) -> tuple[EvaluatedState, bool]:
        """The tracked state, or a newly fitted one if the cost stays high and that one explains the frame better."""
        views = sum(bool(np.count_nonzero(view.weights)) for view in frame.views)
        count = views * self.kinematics.landmark_count + frame.count - frame.point_count
        if measurement.repeated or not self._reinitialisation.due(measurement.stamp, self._cost, count):
            return tracked, False
        fit = self._initialiser.fit(frame)
        if not fit.cost < COST_SHARE * self._cost:
            return tracked, False
        self._cost = fit.cost
        return self.frame_model.evaluate(fit.state), True

    def _first_fit(self, frame: FrameData) -> Fit:
        """A state from one frame: from the network's pose if that explains the frame, else from all start poses."""
        start = None if self._network_pose is None else self._network_pose.state()
        if start is None:
            return self._fit_with_verticals(frame)
        near = self._initialiser.fit_near(start, frame)
        if near.cost <= GOOD_FIT * frame.point_count:
            return near
        return min(self._initialiser.fit(frame), near, key=lambda fit: fit.cost)

    def _fit_with_verticals(self, frame: FrameData) -> Fit:
        """The best state from all start poses and all verticals that the camera's mount allows. Keeps that vertical."""
        fits = [
            (self._initialiser.fit(replace(frame, up=up)), cost, up) for up, cost in self.learned.vertical.candidates()
        ]
        best, _, self.learned.vertical.direction = min(fits, key=lambda entry: entry[0].cost + entry[1])
        return best

    def _solve(self, start: EvaluatedState, initialised: bool, frame: FrameData, measurement: Measurement) -> Increment:
        step = 0.0 if initialised or self._network is None else measurement.step
        feet = self.learned.feet
        if feet.anchors is not None and not (initialised or self._replaced or measurement.repeated):
            frame = replace(frame, anchors=feet.anchors, anchor_deviation=feet.deviation)
        return self._increments.solve(start, frame, step, self.config)

    def _check(self, start: BodyState, increment: Increment, frame: FrameData, focal: float) -> Rejection | None:
        """The reason to reject an answer, None to accept it. Counts consecutive rejections."""
        place = start.translation + increment.x
        depth = min(float(view.camera.into_camera(place)[2]) for view in frame.views if view.weights.any())
        rejection = None
        if not increment.solution.certified:
            rejection = Rejection.NOT_CERTIFIED
        elif self.skeleton.height * focal < SMALLEST_PX * self.config.noise_px * depth or depth <= 0:
            rejection = Rejection.TOO_SMALL  # or behind the camera; the image cannot correct either
        self._stuck_frames = 0 if rejection is None else self._stuck_frames + 1
        return rejection

    def _smooth(self, answer: _Answer) -> BodyState:
        """The state to publish."""
        if answer.initialised or self._replaced:
            self._output_filter.reset()  # the motion of the replaced state does not go on
        step, speed, smoothing = answer.together.step, answer.together.speed, self.config.smoothing
        centre, several = answer.frame.seeing.camera.centre, answer.frame.seen_by > 1
        return self._output_filter.filtered(answer.solved, answer.increment, step, speed, smoothing, centre, several)

    def _better_state(self, answer: _Answer) -> EvaluatedState | None:
        """The state from which the next frame starts, if another pose explains this frame better."""
        if answer.initialised or answer.together.repeated:
            return None
        self._cost = float(self.frame_model.cost(answer.solved, answer.frame))
        better = self._other_pose.better_state(answer.together.stamp, answer.frame, answer.solved, self._cost)
        return None if better is None else self.frame_model.evaluate(better)

    def _estimate(self, answer: _Answer, smoothed: BodyState) -> Estimate:
        """The estimate for an accepted frame. smoothed: the state to publish."""
        self._status = Status.TRACKING
        pose = self.kinematics.pose(smoothed)
        measured, frame, increment, solved = answer.measured, answer.frame, answer.increment, answer.solved
        return Estimate(
            answer.together.stamp,
            self._status,
            state=smoothed,
            pose=pose,
            omega=increment.omega,
            translation_step=increment.x,
            certificate=increment.solution.certificate,
            reprojection_px=_reprojection_px(_placed(measured), pose),
            initialised=answer.initialised,
            problem=increment.problem,
            rows=increment.rows,
            solution=increment.solution,
            solved=solved.state,
            cost=self._cost,
            keypoint_error_ratio=self.learned.model_error.ratio,
            repeated=answer.together.repeated,
            visible=reduce(np.logical_or, [one.visible & one.used for one in measured.values()]),
            measurements=frame.count,
            depth_measured=any(view.depth_weights is not None for view in frame.views),
            depth_covers=frame.depth_covers,
            length_deviation=self.learned.lengths.deviation,
            size_deviation=0.0 if (height := self.learned.height) is None else height.deviation / height.height,
            joint_depths=frame.seeing.joint_depths,
            cameras=frame.seen_by,
            centre=frame.seeing.camera.centre,
            still=self._still(),
            contacts=self._contacts(pose.positions),
            up=self.learned.vertical.direction,
            prior_cost=0.5 * float(squared_norm(solved.posture.residual)),
            network_distance=math.nan if self._network_pose is None else self._network_pose.distance(solved.pose),
        )

    def _still(self) -> np.ndarray:
        """(n,) bool: the ankles of the feet that stand still."""
        still, anchors = np.zeros(self.kinematics.joint_count, dtype=bool), self.learned.feet.anchors
        if anchors is not None:
            still[list(self._ankles)] = np.isfinite(anchors[:, 0])
        return still

    def _contacts(self, positions: np.ndarray) -> np.ndarray:
        """(n,) bool: the ankles of the feet that stand still on the floor. positions: (n, 3) m, of the joints."""
        contacts, ankles = self._still(), list(self._ankles)
        if ankles and contacts.any():
            contacts[ankles] &= on_floor(positions[ankles], self.learned.vertical.direction)
        return contacts

    def _follow_feet(self, answer: _Answer, replaced: bool) -> None:
        """Note which feet stand still. replaced: whether the pose does not continue the last one."""
        feet, held = self.learned.feet, self._ankles and self.config.hold_feet
        if replaced or not held:
            feet.reset()
        if held and not answer.together.repeated:
            ankles = answer.solved.pose.positions.take(self._ankles, axis=0)
            speeds = reduce(np.fmax, [camera.speeds(ankles, self._ankle_points) for camera in answer.measured])
            feet.update(answer.together.stamp, ankles, speeds)

    def _learn(self, answer: _Answer) -> None:
        """Update all that is learned, and use it from the next frame on."""
        height, lengths = self.learned.height, self.learned.lengths
        frame, solved, initialised = answer.frame, answer.solved, answer.initialised
        stamp, repeated, several = answer.together.stamp, answer.together.repeated, frame.seen_by > 1
        sized = self._of_known_size(frame)
        if sized.seen_by > 1 and height is not None:
            lengths.stature_deviation = PEOPLE_DEVIATION
        elif height is None and (frame.observes_depth or frame.floor is not None):
            lengths.stature_deviation = OBSERVED_STATURE_DEVIATION
        if self.config.calibrate and (initialised or not repeated):
            if lengths.update(stamp, solved.state, frame, initialised or self._replaced):
                self._adopt_lengths()
        measured = [answer.measured.get(camera) for camera in self._cameras]
        seen = partial(_with_seen_landmarks, frame, measured)
        start, increment = answer.start.state, answer.increment
        if self.learned.update(answer.together, seen, start, initialised, increment, solved.state):
            self._evaluate_again()  # the prior's mean has changed
        if height is None:
            for one in answer.measured.values():
                self.learned.size_check.update(one)
            return
        limbs, floor = None, None if several or repeated else self._floor_size(frame, solved)
        if several and not repeated:
            lately = [camera.seen_lately(stamp) for camera in self._cameras]
            places = triangulate(_with_seen_landmarks(sized, measured, lately))
            limbs = self.learned.size_check.lengths(places, np.isfinite(places[:, 0]))
        camera, one = max(answer.measured.items(), key=lambda item: item[1].depth_count > 0)
        if height.update(one, solved, camera.pose, self.skeleton.height, limbs, floor):
            self._adopt_height(height.height / self.skeleton.height, None if several else frame.seeing.camera.centre)

    def _of_known_size(self, frame: FrameData) -> FrameData:
        """The frame without the points of cameras that were found from the person, whose size sets their distances."""
        found = () if self.learned.extrinsics is None else self.learned.extrinsics.found
        if not found:
            return frame
        views = [replace(one, weights=(one.camera.name not in found) * one.weights) for one in frame.views]
        return replace(views[0], others=tuple(views[1:]))

    def _floor_size(self, frame: FrameData, solved: EvaluatedState) -> FloorSize | None:
        """The size by the feet that stand on the floor; None if it is not asked for, or none does."""
        if frame.floor is None or not self.config.tilt_deviation:
            return None
        ankles, centre = solved.pose.positions[self._contacts(solved.pose.positions)], frame.seeing.camera.centre
        return floor_size(ankles, frame.floor, centre, self.skeleton.height, self.config.tilt_deviation)

    def _adopt_lengths(self) -> None:
        """Use the lengths as they are known now."""
        self.kinematics.set_skeleton(self.learned.lengths.skeleton)
        for camera in self._cameras:
            self._tell_lengths(camera)
        self._evaluate_again()

    def _tell_lengths(self, camera: Camera) -> None:
        """Input the lengths to a camera's network; those of a skeleton without the built-in ones stay as given."""
        if camera.network is not None:
            lengths, built_in = self.learned.lengths, has_built_in_proportions(self.given_skeleton)
            body = self.skeleton if built_in else lengths.proportions.given
            camera.network.use_lengths(body, lengths.certain or not built_in)

    def _adopt_height(self, ratio: float, centre: np.ndarray | None) -> None:
        """Scale the body and what was learned, and its distance from the centre (3,) m of the only camera.

        centre: None if several cameras observe where the body is.
        """
        self.learned.resize(ratio)
        if self.learned.extrinsics is not None:
            self.learned.extrinsics.resize(ratio, centre)
        for alone in self._unplaced.values():
            alone._adopt_height(ratio, HERE.centre)
        if centre is not None and self._solved is not None:
            self._solved = replace(self._solved, state=self._solved.state.scaled_about(centre, ratio))
        self._output_filter.reset()
        self._adopt_lengths()

    def _evaluate_again(self) -> None:
        """Evaluate the present state with the present body and prior."""
        if self._solved is not None:
            self._solved = self.frame_model.evaluate(self._solved.state)

    def _publish(self, estimate: Estimate, measured: dict[Camera, Measurement]) -> None:
        """Collect the estimates that are due."""
        if self.config.smoothing_lag == 0 and self._lag.empty and self.backward is None:
            self.published = [estimate]
            return
        assert self._output_filter.forward is not None
        forward, vectors = self._output_filter.forward, self.kinematics.vectors
        backward = None if self.backward is None else self.backward(estimate.stamp)
        self._lag.add(Waiting(estimate, forward, vectors, partial(_reprojection_px, _placed(measured)), backward))
        self.published = self._lag.due(estimate.stamp, self.config.smoothing_lag)

    def _reject(
        self, observation: Observation, rejection: Rejection, certificate: Certificate | None = None
    ) -> Estimate:
        """The estimate for a rejected frame. The state stays; the status becomes LOST after too long a time."""
        if self._solved is None:
            for camera in self._cameras:
                camera.measurements.forget()
        if rejection is not Rejection.NOT_FINITE:  # the stamp can be used
            if self._solved is not None and is_longer(observation.stamp - self._newest, self.config.lost_after):
                self._status = Status.LOST
            self.published = self._lag.due(observation.stamp, self.config.smoothing_lag)
        return Estimate(observation.stamp, self._status, rejection, certificate=certificate)


def _unit_vertical(up: np.ndarray) -> np.ndarray:
    """Return the vertical (3,) with length 1. Raises ConfigurationError."""
    found = np.asarray(up)
    length = np.linalg.norm(found) if found.shape == (3,) and found.dtype.kind in "fiu" else 0.0
    if not 0.0 < length < np.inf:
        raise ConfigurationError(
            f"up is {found.tolist()}; expected the vertical of the fixed frame, (3,) finite numbers that are not all "
            "0, such as [0, 0, 1]"
        )
    return np.asarray(found / length)


def _placed(measured: dict[Camera, Measurement]) -> list[tuple[Measurement, CameraPose]]:
    """The measurements with the poses of their cameras, which may move before a frame is published."""
    return [(measurement, camera.pose) for camera, measurement in measured.items()]


def _reprojection_px(placed: list[tuple[Measurement, CameraPose]], pose: BodyPose) -> float:
    """px, over the cameras with an image, see `Measurement.reprojection_px`."""
    errors = [measurement.reprojection_px(pose, camera) for measurement, camera in placed]
    return errors[0] if len(errors) == 1 else math.sqrt(sum(error * error for error in errors) / len(errors))


def _with_seen_landmarks(
    frame: FrameData, measured: Sequence[Measurement | None], predicted: Iterable[bool] = repeat(False)
) -> FrameData:
    """The frame without landmarks that were extrapolated and not seen.

    measured: by camera, None without an image. predicted: whether the points predicted for a camera without one stay.
    """
    views = [
        replace(view, weights=(one.visible if one is not None else stay) * view.weights)
        for view, one, stay in zip(frame.views, measured, predicted)
    ]
    return replace(views[0], others=tuple(views[1:]))
