"""One tracked person: the tracker, and the prediction of the next position."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.evidence import Evidence
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import HERE, CameraPose, Observation, Status
from lassokin_ros.core.output.smoothing import Backward
from lassokin_ros.core.output.walking_velocity import WalkingVelocity
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.concerns.rejections import frozen_text, rejection_text
from lassokin_ros.pipeline.frame_result import FrameResult, ImageOfPerson
from lassokin_ros.pipeline.input_checks.messages import Repeats
from lassokin_ros.pipeline.people.held_results import HeldResults
from lassokin_ros.pipeline.seen import Sight

FROZEN = "frozen"
"""Rejection of keypoints that have been repeated for longer than `lost_after`."""

LONGEST_PREDICTION_S = 0.5
"""s: a person out of sight is predicted to move with constant velocity for this long, then to stand still."""


class TrackedPerson:
    """Tracks one person. Times are ns; only differences matter."""

    def __init__(
        self,
        config: TrackerConfig,
        skeleton: Skeleton | None = None,
        evidence: Sequence[Evidence] = (),
        up: np.ndarray | None = None,
        number: int | None = None,
    ) -> None:
        """skeleton: replaces the skeleton of `config`. evidence, up: see `Tracker`. number: the person's number in the
        messages if the skeleton is that person's. Raises a LassokinError if these are unusable.
        """
        self.number = number
        self.tracker = Tracker(config, skeleton, evidence, up)
        self._results = HeldResults(self.tracker)
        self._repeats: dict[str, Repeats] = {}
        self.reset()

    def reset(self, same_camera: bool = False) -> None:
        """Forget the person. With same_camera, keep the direction of gravity in the camera frame, and the last points:
        a person who left because the points were frozen does not come again with them.
        """
        if not same_camera:
            self._repeats = {}
        self.tracker.reset(same_camera)
        self._origin_ns: int | None = None
        self._forget_motion()

    def begin_take(self) -> None:
        """Forget where the person is; see `Tracker.begin_take`."""
        self._repeats = {}
        self.tracker.begin_take()
        self._forget_motion()

    def _forget_motion(self) -> None:
        self._results.reset()
        self.status = Status.SEARCHING
        self.seen_ns: int | None = None
        self.seen_by: dict[str, int] = {}
        """Stamps in ns of the images with the person of the last accepted frame, by camera."""
        self._instant_ns = 0
        self._place: np.ndarray | None = None
        self._landmarks: np.ndarray | None = None
        self._walk = WalkingVelocity()
        self._height = math.nan  # m, of the newest frame

    def move_frame(self, frame: CameraPose, stamp_ns: int) -> None:
        """Keep the person where they are, although the frame of the skeleton has moved: see `PoseJumps.update`.

        stamp_ns: ns, of the first image after it.
        """
        self.tracker.move_frame(frame.rotation, frame.translation)
        if self._place is not None and self._landmarks is not None:
            self._place, self._landmarks = frame.into_camera(self._place), frame.into_camera(self._landmarks)
            self._walk.turn(frame.rotation, self._place)
        self._results.move_frame(frame.rotation, stamp_ns)

    def use_backward(self, frames: Mapping[int, Backward]) -> None:
        """Publish poses between the track and one backward in time. frames: of the latter, by stamp, ns."""
        self.tracker.backward = lambda _: frames.get(self._instant_ns)  # also if the latest image shows nobody

    def track(self, sights: Sequence[Sight], frame_id: str, person: str = "", **identity: Any) -> list[FrameResult]:
        """Track the detections of this person in the images of one instant, one of each camera.

        frame_id: of the results. identity: further fields of the result of these detections. Returns the results to
        publish now. If the detections are refused, the last result gives the reason. Without `smoothing_lag` there is
        one result, that of these detections.
        """
        placed = [(sight, camera) for sight in sights for camera in (self._corrected(sight.camera),) if camera.known]
        placed = placed or [(sights[0], sights[0].camera)]
        stamp_ns = max(sight.stamp_ns for sight in sights)
        if self._origin_ns is None:
            self._origin_ns = stamp_ns
        self._instant_ns = stamp_ns
        frozen = [self._frozen_s(sight) for sight in sights]
        observations = [self._observation(sight, bool(old)) for sight, old in zip(sights, frozen)]
        tracker = self.tracker
        body = tracker.skeleton  # calibration and a measured height change it for the next frame only
        estimate = tracker.track(observations)
        self.status = estimate.status
        images = [ImageOfPerson(pose, one.lens, one.seen.pixels, one.seen.points) for one, pose in placed]
        fields: dict[str, Any] = {
            "stamp_ns": stamp_ns,
            "frame_id": frame_id,
            "person": person,
            **identity,
            "images": images,
            "observations": observations,
            "skeleton": body,
        }
        if estimate.rejection is not None:
            reason, detail = self._refused(estimate, observations[0], min(frozen))
            due = self._results.due(tracker.published, stamp_ns)
            return [*due, FrameResult(estimate=estimate, rejection=reason, detail=detail, **fields)]
        self._update_motion(stamp_ns, estimate, body.height, None if len(placed) > 1 else placed[0][1])
        self.seen_by = {sight.camera.name: sight.stamp_ns for sight in sights}
        fields["velocity"], fields["velocity_covariance"] = self._walk.velocity, self._walk.velocity_covariance
        fields["tracker"], fields["doubts"] = tracker, tracker.learned.doubts
        seen = placed[0][0].seen
        points = seen.points
        if len(placed) > 1:  # `visible` is of all cameras
            confident = seen.confidence >= tracker.config.min_confidence
            points = np.where(confident[:, None], seen.points, np.nan)
        self._results.hold(fields, images[0], stamp_ns, estimate.stamp, points)
        return self._results.due(tracker.published, stamp_ns)

    def _refused(self, estimate: Estimate, observation: Observation, frozen_s: float) -> tuple[str, str]:
        """Return the reason and the words for a frame that the tracker refused. frozen_s: see `_frozen_s`."""
        if self.seen_ns is None:
            self._origin_ns = None  # time starts at the first accepted frame
        if frozen_s:
            self.status = Status.SEARCHING if self.seen_ns is None else Status.LOST
            return FROZEN, frozen_text(frozen_s, self.tracker.config)
        assert estimate.rejection is not None
        return estimate.rejection.value, rejection_text(estimate, observation, self.tracker.config)

    def _observation(self, sight: Sight, frozen: bool) -> Observation:
        assert self._origin_ns is not None
        seen = sight.seen
        return Observation(
            (sight.stamp_ns - self._origin_ns) * 1e-9,
            np.full_like(seen.points, np.nan) if frozen else seen.points,
            seen.confidence,
            sight.lens.focal,
            depth=seen.depth,
            depth_of_surface=seen.depth_of_surface,
            depth_age=seen.depth_age,
            camera=sight.camera,
        )

    def _corrected(self, camera: CameraPose) -> CameraPose:
        """Return the pose of a camera as the tracker uses it; one that is not known if there is none yet."""
        return self.tracker.learned.extrinsics.corrected(camera)

    def _frozen_s(self, sight: Sight) -> float:
        """Return s for which a camera's keypoints have been the same, if it is more than `lost_after`; else 0."""
        if not np.count_nonzero(np.isfinite(sight.seen.points)):
            return 0.0
        name = sight.camera.name
        if name not in self._repeats:
            self._repeats[name] = Repeats()
        content = sight.seen.points.tobytes() + sight.seen.confidence.tobytes()  # as the tracker compares them
        repeated = self._repeats[name].age(sight.stamp_ns, content)
        return repeated if repeated > self.tracker.config.lost_after else 0.0

    def mark_absent(self, sight: Sight) -> list[FrameResult]:
        """Record that the person is not in an image. Returns held results that are due now.

        sight: without any point.
        """
        *due, _ = self.track([sight], "")
        return due

    def flush(self) -> list[FrameResult]:
        """Return the results that wait for `smoothing_lag`. No detection follows."""
        return self._results.due(self.tracker.flush(), self.seen_ns or 0)

    def _update_motion(self, stamp_ns: int, estimate: Estimate, height: float, camera: CameraPose | None) -> None:
        """Update position and velocity from the newest estimate, which may not be published yet.

        height: m, of its skeleton. With another one, the body is elsewhere along the line of sight and has not moved.
        camera: the only one of the frame; None for several.
        """
        assert estimate.state is not None and estimate.pose is not None
        place, resized = estimate.state.translation, height != self._height
        if resized:
            self._height = height
            self._results.resize(stamp_ns)
        if estimate.initialised or self._place is None or self.seen_ns is None:
            self._walk.start(place)
        elif resized:
            self._walk.displace(place)
        elif (seconds := (stamp_ns - self.seen_ns) * 1e-9) > 0:  # 0: another camera, same stamp
            sight = None if camera is None else place - camera.centre
            sight = None if sight is None else sight / max(math.sqrt(sight.dot(sight)), 1e-6)
            assert estimate.up is not None
            self._walk.update(seconds, place, sight, estimate.pose.orientations[0][:, 2], estimate.up)
        self._place, self._landmarks, self.seen_ns = place, estimate.pose.landmarks, stamp_ns

    def unseen_s(self, stamp_ns: int) -> float:
        """Return s since the person was last tracked; infinite before the first time."""
        return float("inf") if self.seen_ns is None else (stamp_ns - self.seen_ns) * 1e-9

    def status_at(self, stamp_ns: int, stale_after: float = math.inf) -> Status:
        """Return the status at a time up to which no message has arrived. The state does not change.

        stale_after: s, upper limit of `lost_after`, until which the tracker itself keeps the person.
        """
        patience = min(self.tracker.config.lost_after, stale_after)
        lost = self.status is Status.TRACKING and self.unseen_s(stamp_ns) > patience
        return Status.LOST if lost else self.status

    def predicted_landmarks(
        self, stamp_ns: int, camera: CameraPose = HERE, walks_s: float = LONGEST_PREDICTION_S
    ) -> np.ndarray | None:
        """Return the predicted landmarks (l, 2) in the image of a camera, normalised; None without a pose of it.

        They are those of the last pose, moved with the velocity across the line of sight, for `walks_s` s at most.
        """
        camera = self._corrected(camera)
        if self._landmarks is None or not camera.known:
            return None
        shift = self._walk.velocity * min(self.unseen_s(stamp_ns), walks_s)
        shift = shift if camera.is_identity else camera.rotation @ shift
        shift[2] = 0.0  # depth from one camera is too noisy to extrapolate
        return project(camera.into_camera(self._landmarks) + shift)
