"""From a keypoint message to an estimate: what the node and the replay share, so that both give the same bytes.

pipeline = Pipeline(TrackerConfig(), NodeConfig())
pipeline.set_camera(camera_info)
frame = pipeline.process(keypoints, arrival_ns)      # Frame: accepted, or rejected with a reason
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.joint_angles import JointAngleReader
from lassokin_ros.core.tracker import Estimate, Observation, Status, Tracker
from lassokin_ros.lens import Lens
from lassokin_ros.node_config import NodeConfig
from msg_adapters.camera_info import Intrinsics, decode_camera_info
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints
from msg_adapters.registry import keypoint_adapter


@dataclass(frozen=True, eq=False)
class Frame:
    """What became of one keypoint message.

    Attributes
    ----------
    stamp_ns: ns, the message's; its arrival where it has none. frame_id: the message's, the camera's where it has none.
    estimate: the tracker's answer; None when the message did not come so far.
    rejection: None for an accepted frame, else a short key for counting; `detail` says it in words.
    positions, velocities: (3 + 3 n,) in the order of urdf.joint_names, m and rad, m/s and rad/s; None when rejected.
    """

    stamp_ns: int
    frame_id: str
    estimate: Estimate | None = None
    rejection: str | None = None
    detail: str = ""
    positions: np.ndarray | None = None
    velocities: np.ndarray | None = None

    @property
    def accepted(self) -> bool:
        """True when there is something to publish."""
        return self.rejection is None


class Pipeline:
    """Decodes, undistorts, tracks and reads joint angles; its methods never raise for what a message may hold."""

    def __init__(self, tracker_config: TrackerConfig, node_config: NodeConfig) -> None:
        """Raises a LassokinError when the configuration cannot be used."""
        self.config = node_config.checked()
        self.tracker = Tracker(tracker_config)
        self.counts: Counter[str] = Counter()
        """Messages by what became of them: received, accepted, unstamped, resets and "rejected: <reason>"."""
        self._adapter = keypoint_adapter(self.config.keypoints_type)
        self._reader = JointAngleReader(self.tracker.skeleton.axes)
        self._lens: Lens | None = None
        self._intrinsics: Intrinsics | None = None
        self._camera_key: tuple[Any, ...] | None = None
        self.camera_fault = ""
        """Why the last camera_info was refused, in words; empty when it was taken."""
        self._forget()

    @property
    def has_camera(self) -> bool:
        """True once a usable camera_info has come."""
        return self._lens is not None

    def reset(self) -> None:
        """Forget the person; the camera and the counts stay."""
        self.tracker.reset()
        self._forget()
        self.counts["resets"] += 1

    def _forget(self) -> None:
        self.status = Status.SEARCHING
        self._reader.reset()
        self._origin_ns: int | None = None
        self._newest_ns = -1
        self._person: int | None = None
        self._last: tuple[int, np.ndarray] | None = None

    def tune(self, tracker_config: TrackerConfig, node_config: NodeConfig) -> None:
        """Take over live settings; they hold from the next frame on."""
        self.tracker.tune(tracker_config)
        self.config = node_config.checked()

    def set_camera(self, message: Any) -> str | None:
        """Take over a CameraInfo message; the reason's key when it is refused (the last good camera then stays)."""
        key = _camera_key(message)
        if key == self._camera_key and not self.camera_fault:
            return None
        self._camera_key = key
        try:
            return self._use_camera(decode_camera_info(message))
        except AdapterError as error:
            return self._refuse_camera(error.reason, str(error))

    def _use_camera(self, intrinsics: Intrinsics) -> str | None:
        try:
            self._lens = Lens.from_intrinsics(intrinsics, self.config.rectified)
        except CameraError as error:
            return self._refuse_camera("camera_unusable", str(error))
        self._intrinsics, self.camera_fault = intrinsics, ""
        return None

    def _refuse_camera(self, reason: str, detail: str) -> str:
        self.camera_fault = detail
        self.counts[f"rejected: {reason}"] += 1
        return reason

    def process(self, message: Any, arrival_ns: int) -> Frame:
        """Track one keypoint message; arrival_ns stamps those that have no stamp."""
        self.counts["received"] += 1
        frame = self._frame(message, arrival_ns)
        self.counts["accepted" if frame.accepted else f"rejected: {frame.rejection}"] += 1
        return frame

    def _frame(self, message: Any, arrival_ns: int) -> Frame:
        stamp_ns, frame_id = arrival_ns, ""
        try:
            if self._lens is None or self._intrinsics is None:
                raise AdapterError("no_camera_info", self.camera_fault or "no camera_info has come yet")
            size = (self._intrinsics.width, self._intrinsics.height)
            keypoints = self._adapter.decode(message, size)
            frame_id = keypoints.frame_id or self._intrinsics.frame_id
            if keypoints.stamp_ns is None:
                self.counts["unstamped"] += 1
            else:
                stamp_ns = keypoints.stamp_ns
            self._watch_stamp(stamp_ns)
            pixels, confidence = keypoints.as_landmarks(
                self.tracker.kinematics.landmark_count, self._choose_person(keypoints)
            )
        except AdapterError as error:
            return Frame(stamp_ns, frame_id, None, error.reason, str(error))
        points = self._lens.normalise(pixels)
        seconds = (stamp_ns - (self._origin_ns or 0)) * 1e-9
        estimate = self.tracker.track(Observation(seconds, points, confidence, self._lens.focal))
        self.status = estimate.status
        if estimate.rejection is not None:
            reason = estimate.rejection.value
            return Frame(stamp_ns, frame_id, estimate, reason, f"the tracker did not use this frame: {reason}")
        return self._accepted(stamp_ns, frame_id, estimate)

    def _watch_stamp(self, stamp_ns: int) -> None:
        """Reset when time has jumped back (bag loop, seek); AdapterError for an old or repeated stamp."""
        if self._origin_ns is None:
            self._origin_ns = stamp_ns
        elif stamp_ns <= self._newest_ns:
            behind = (self._newest_ns - stamp_ns) * 1e-9
            if behind <= self.config.jump_back:
                raise AdapterError("old_stamp", f"the stamp is {behind:.3f} s older than the newest one")
            self.reset()
            self._origin_ns = stamp_ns
        self._newest_ns = stamp_ns

    def _choose_person(self, keypoints: Keypoints) -> int | None:
        """The person who is followed: the same until lost, then the one seen with the highest confidence in all."""
        if keypoints.persons is None or len(keypoints.persons) == 0:
            return None
        if self._person is None or self.status is not Status.TRACKING:
            people, index = np.unique(keypoints.persons, return_inverse=True)
            scores = np.clip(np.nan_to_num(keypoints.confidence, posinf=0.0), 0.0, 1.0)
            self._person = int(people[np.argmax(np.bincount(index, scores))])
        return self._person

    def _accepted(self, stamp_ns: int, frame_id: str, estimate: Estimate) -> Frame:
        """The frame with its joint angles; velocities are differences of angles over stamps, 0 after initialisation."""
        assert estimate.state is not None
        if estimate.initialised:
            self._reader.reset()
            self._last = None
        angles = self._reader.read(estimate.state.rotations)
        positions = np.concatenate([estimate.state.translation, angles.ravel()])
        if self._last is None:
            velocities = np.zeros_like(positions)
        else:
            velocities = (positions - self._last[1]) / ((stamp_ns - self._last[0]) * 1e-9)
        self._last = stamp_ns, positions
        return Frame(stamp_ns, frame_id, estimate, None, "", positions, velocities)


def _camera_key(message: Any) -> tuple[Any, ...]:
    """What of a CameraInfo matters, cheap to compare: it comes with every image and hardly ever changes."""
    roi = message.roi
    image = (message.width, message.height, message.binning_x, message.binning_y)
    window = (roi.x_offset, roi.y_offset, roi.width, roi.height)
    numbers = (bytes(message.k), bytes(message.d[:32]), bytes(message.p), bytes(message.r))
    return (message.distortion_model, message.header.frame_id, *image, *window, *numbers)
