"""The cameras of a tracker: each has a filter of its keypoints, a depth network, and a place.

A camera without a new image at the frame's stamp takes part with its keypoints predicted to that stamp by their tracks.
The rows of a camera that has fallen silent fade out, and fade in when it returns, so that the body does not jump.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.frame_data import NO_HANDS, FrameData, JointDepths, View
from lassokin_ros.core.image.gating import gate_observation, of_own_surface, surface_depths
from lassokin_ros.core.image.measurement import Measurement, MeasurementFilter
from lassokin_ros.core.image.projection import NEAREST_DEPTH, carried
from lassokin_ros.core.learned.errors import DepthNoise
from lassokin_ros.core.learned.vertical import Vertical
from lassokin_ros.core.network.depth_estimator import DepthEstimator
from lassokin_ros.core.network.depth_network import shipped_network
from lassokin_ros.core.network.hand_network import HandEstimator
from lassokin_ros.core.observation import HERE, CameraPose, Observation, Rejection, has_passed, is_longer

if TYPE_CHECKING:
    from lassokin_ros.core.learned.learned import Learned

RECENT = 0.1
"""How long (s) a camera counts as seeing the person."""
SILENT_AFTER, TIMEOUT = 0.15, 0.5
"""s without an image after which the rows of a camera begin to fade, and after which they are gone."""


class Camera:
    """One camera of a tracker."""

    def __init__(
        self,
        kinematics: Kinematics,
        network: DepthEstimator | None,
        hands: HandEstimator | None,
        name: str | None = None,
    ) -> None:
        """name: None for the first camera until it is seen."""
        self._kinematics, self.network, self._hands, self.name = kinematics, network, hands, name
        self.depth_noise = DepthNoise()
        self.measurements = MeasurementFilter(kinematics)
        self.pose = self._last_pose = HERE
        self.given = self._last_given = HERE
        """The pose without what `extrinsics` has learned: a correction of it is no motion of the camera."""
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self.measurements.reset()
        self.depth_noise.reset()
        if self.network is not None:
            self.network.reset()
        self._presence = 1.0
        self.newest = -np.inf
        """s: stamp of the last image with the person."""

    def measure(
        self,
        observation: Observation,
        weights: np.ndarray,
        body: BodyPose | None,
        model_error: float,
        config: TrackerConfig,
        alone: bool,
    ) -> Measurement:
        """The keypoints and depths of an image after the filter of their tracks.

        weights: (l,) from `gate_observation`. body: the last pose, in the frame of the skeleton. model_error: m. alone:
        whether no other camera has followed the person in the meantime; the rows then have full weight at once.
        """
        depth, self.pose = None, observation.camera
        if body is not None:
            camera, into, seen = self.pose, self.pose.into_camera, body
            if not camera.is_identity:
                seen = BodyPose(camera.rotation @ body.orientations, into(body.positions), into(body.landmarks))
            depth = _in_front(seen.positions[0])
            if observation.depth is not None and observation.depth_of_surface:
                layout, skeleton = self._kinematics.layout, self._kinematics.skeleton
                nearest, landmarks = surface_depths(skeleton, seen, seen.landmarks), seen.landmarks[:, 2]
                own = of_own_surface(observation.depth, landmarks, nearest, layout.surface, skeleton.height)
                observation = replace(observation, depth=own)
        if (motion := self._motion(body)) is not None:
            self.measurements.filter.carry(*motion)  # it is none of the person
            if self.network is not None:
                self.network.carry(*motion)
        self._last_pose, self._last_given = self.pose, self.given
        measurement = self.measurements.filtered(observation, weights, depth, model_error, config)
        self._count_presence(measurement.stamp, alone)
        return self.depth_noise.update(measurement, observation.depth_age)

    def view(self, measurement: Measurement, vertical: Vertical, sized: bool) -> View:
        """The view of an image. sized: whether the person's size is known; measured depths are left out otherwise."""
        depth, depth_weights = (measurement.depth, measurement.depth_weights) if sized else (None, None)
        if self.network is not None:
            if measurement.lost:
                self.network.reset()
            if measurement.lost or not measurement.repeated:
                up, mount = vertical.direction, vertical.mount
                if not self.pose.is_identity:
                    up, mount = self.pose.rotation @ up, self.pose.rotation @ mount
                known = up if vertical.known else None
                self.network.update(measurement.stamp, measurement.points, measurement.used, known, mount)
        weights, hands = self._presence * measurement.weights, NO_HANDS
        if self._hands is not None:
            hands = self._hands.estimate(measurement.points, measurement.used, self.pose)
        return View(measurement.points, weights, depth, depth_weights, self._joint_depths(), self.pose, hands)

    def predicted_view(self, stamp: float, body: BodyPose | None, model_error: float) -> View:
        """The view at a stamp, s, without an image."""
        if not np.isfinite(self.newest):  # never
            nothing = np.zeros((self._kinematics.landmark_count, 2))
            return View(nothing, nothing[:, 0], camera=self.pose)
        depth = None if body is None else _in_front(self.pose.into_camera(body.positions[0]))
        points, weights = self.measurements.predicted(stamp, depth, model_error)
        if (motion := self._motion(body)) is not None:
            points = carried(points, *motion)
        weights = self._presence_at(stamp) * weights
        depths = self._joint_depths() if weights.any() else None
        return View(points, weights, joint_depths=depths, camera=self.pose)

    def speeds(self, places: np.ndarray, points: np.ndarray) -> np.ndarray:
        """(k,) m/s across the line of sight, of the fastest keypoint at each of k places (k, 3) m; NaN without any.

        points: (k, l) bool, the landmarks at each place.
        """
        speeds = np.fmax.reduce(np.where(points, self.measurements.filter.speeds(), np.nan), axis=1)
        return np.asarray(speeds * self.pose.into_camera(places)[:, 2])

    def move_frame(self, rotation: np.ndarray, translation: np.ndarray) -> None:
        """Note that the frame of the skeleton has moved, and not the camera; see `Tracker.move_frame`."""
        moved = CameraPose("", rotation, translation).inverse  # from the frame as it is now to that of before
        self._last_pose, self._last_given = self._last_pose.after(moved), self._last_given.after(moved)

    def _motion(self, body: BodyPose | None) -> tuple[np.ndarray, np.ndarray] | None:
        """The camera's motion since its last image, as for `carried`, with the depths of a body; None without any."""
        before, now = self._last_given, self.given
        if not np.isfinite(self.newest) or now.is_at(before):
            return None
        moved = now.relative_to(before)
        if body is None:
            return moved.rotation, np.zeros((self._kinematics.landmark_count, 3))
        depth = before.into_camera(body.landmarks)[:, 2:]
        return moved.rotation, np.where(depth > 0, moved.translation / np.maximum(depth, NEAREST_DEPTH), 0.0)

    def network_places(self) -> np.ndarray | None:
        """See `DepthEstimator.places`, but in the frame of the skeleton."""
        found, pose = None if self.network is None else self.network.places, self._last_pose
        return found if found is None or pose.is_identity else found @ pose.rotation

    def _joint_depths(self) -> JointDepths | None:
        """The network's estimate, with its direction in the frame of the skeleton."""
        found, pose = None if self.network is None else self.network.joint_depths, self._last_pose
        if found is None or pose.is_identity:
            return found
        return replace(found, sight=pose.rotation.T @ found.sight)

    def _presence_at(self, stamp: float) -> float:
        """Weight of this camera's rows, 0 to 1, if there is no image up to a stamp, s."""
        if not self.seen_at(stamp):
            return 0.0
        fading = (stamp - self.newest - SILENT_AFTER) / (TIMEOUT - SILENT_AFTER)
        return self._presence * min(max(1 - fading, 0.0), 1.0)

    def seen_at(self, stamp: float) -> bool:
        """Whether the camera has followed the person up to a stamp, s."""
        return not has_passed(stamp - self.newest, TIMEOUT)

    def seen_lately(self, stamp: float) -> bool:
        """Whether the camera's last image with the person is at most RECENT older than a stamp, s."""
        return not is_longer(stamp - self.newest, RECENT)

    def _count_presence(self, stamp: float, alone: bool) -> None:
        """Note an image: the weight grows as it has faded."""
        if alone:
            self._presence = 1.0
        elif np.isfinite(self.newest):
            grown = min(stamp - self.newest, SILENT_AFTER) / (TIMEOUT - SILENT_AFTER)
            self._presence = min(self._presence_at(stamp) + grown, 1.0)
        self.newest = stamp


class Cameras(list[Camera]):
    """The cameras of a tracker, in the order in which they were first seen; the first one always exists."""

    def __init__(
        self, kinematics: Kinematics, with_network: bool, learned: Learned, add_rows: Callable[[], None]
    ) -> None:
        """with_network: whether the depth network is used if it fits the skeleton and the layout. add_rows: called for
        each camera after the first, whose rows are added to the lasso.
        """
        self._kinematics, self._learned, self._add_rows = kinematics, learned, add_rows
        self._with_network = with_network and DepthEstimator.fits(kinematics)
        self._hands = HandEstimator(kinematics) if with_network and HandEstimator.fits(kinematics) else None
        super().__init__([Camera(kinematics, self._estimator(), self._hands)])

    def _estimator(self) -> DepthEstimator | None:
        return DepthEstimator(shipped_network(), self._kinematics) if self._with_network else None

    @property
    def newest(self) -> float:
        """s: stamp of the last frame that was used, -inf before the first."""
        return max(camera.measurements.newest for camera in self)

    def named(self, name: str) -> Camera | None:
        """The camera of this name; None if it has had no image."""
        return next((camera for camera in self if camera.name == name), None)

    def of(self, pose: CameraPose) -> Camera:
        """The camera of this pose's name. A new one gets a filter, a depth network, and rows in the lasso."""
        if self[0].name is None:
            self[0].name, self[0].pose = pose.name, pose
        camera = self.named(pose.name)
        if camera is None:
            camera = Camera(self._kinematics, self._estimator(), self._hands, pose.name)
            camera.pose = pose
            self.append(camera)
            self.use_lengths()
            self._add_rows()
        return camera

    def place(self, poses: Iterable[CameraPose]) -> None:
        """See `Tracker.place_cameras`."""
        extrinsics = self._learned.extrinsics
        for pose in poses:
            if (camera := self.named(pose.name)) is not None:
                camera.pose, camera.given = extrinsics.received(pose), extrinsics.given(pose)

    def use_lengths(self) -> None:
        """Input the lengths to the networks; those of a skeleton without the built-in ones stay as given."""
        if self._with_network:
            body, known = self._learned.lengths_for_network
            for camera in self:
                assert camera.network is not None
                camera.network.use_lengths(body, known)

    def network_places(self) -> np.ndarray | None:
        """The places by the network of the first camera that sees the person and has them, in the skeleton's frame."""
        newest = max(camera.newest for camera in self)
        lately = (camera for camera in self if camera.seen_lately(newest))
        return next((found for camera in lately if (found := camera.network_places()) is not None), None)

    def measure(
        self, observations: Iterable[Observation], body: BodyPose | None, config: TrackerConfig
    ) -> tuple[dict[Camera, Measurement], Rejection | None]:
        """The measurements of the cameras whose observations can be used; the reason to reject if there are none.

        body: the solved pose of the last frame.
        """
        measured: dict[Camera, Measurement] = {}
        first: Rejection | None = None
        for observation in observations:
            camera = self.of(observation.camera)
            newest = camera.measurements.newest
            rejection, weights = gate_observation(observation, newest, self._kinematics.layout, config)
            if rejection is not None or camera in measured:
                first = first or rejection or Rejection.OLD_STAMP
                continue
            others = (other for other in self if other is not camera)
            alone = body is None or not any(other.seen_at(observation.stamp) for other in others)
            camera.given = self._learned.extrinsics.given(observation.camera)
            error = self._learned.model_error.deviation
            measurement = camera.measure(observation, weights, body, error, config, alone)
            if len(self) > 1 and observation.stamp <= self.newest:  # a later image has been used
                camera.measurements.mark_used(measurement)
                first = first or Rejection.LATE
                continue
            measured[camera] = measurement
        return measured, None if measured else first

    def together(self, measured: Mapping[Camera, Measurement], lost_after: float) -> Measurement:
        """The measurement of the first camera with an image, with the times and the speed of all."""
        measurement = next(iter(measured.values()))
        if len(self) == 1:
            return measurement
        stamp, newest = max(one.stamp for one in measured.values()), self.newest
        before = max(camera.measurements.last_new_stamp for camera in self)
        repeated = min(one.repeated for one in measured.values())
        return replace(
            measurement,
            stamp=stamp,
            speed=float(np.mean([one.speed for one in measured.values()])),
            repeated=repeated,
            step=stamp - newest,
            since_new_keypoints=0.0 if repeated else stamp - before,
            lost=is_longer(stamp - (newest if repeated else before), lost_after),
        )

    def frame(
        self,
        measured: Mapping[Camera, Measurement],
        stamp: float,
        body: BodyPose | None,
        floor: np.ndarray | None,
        extra: Mapping[str, Any],
    ) -> FrameData:
        """The views of all cameras at a stamp, s, without measured depths as long as the person's size is unknown."""
        vertical, sized = self._learned.vertical, self._learned.is_sized
        views = tuple(
            [
                camera.view(measured[camera], vertical, sized)
                if camera in measured
                else self._predicted(camera, stamp, body)
                for camera in self
            ]
        )
        return FrameData(views, vertical.direction, extra, floor=floor)

    def seen_at(self, stamp: float, body: BodyPose | None) -> View:
        """What the first camera that sees the person sees at a stamp, s, predicted by its tracks."""
        seeing = next((camera for camera in self if camera.seen_lately(stamp)), self[0])
        return self._predicted(seeing, stamp, body)

    def _predicted(self, camera: Camera, stamp: float, body: BodyPose | None) -> View:
        return camera.predicted_view(stamp, body, self._learned.model_error.deviation)


def _in_front(place: np.ndarray) -> float | None:
    """The depth of a place (3,) m in the camera's frame; None behind the camera, as with a wrong pose of it."""
    return float(place[2]) if place[2] > 0 else None
