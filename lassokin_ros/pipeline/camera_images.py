"""From the messages of one camera to images of people: decode, check, add measured depth, order by stamps."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.height import FEWEST_DEPTHS
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE, Camera, View
from lassokin_ros.pipeline.depth.depth_check import MISFIT, DepthCheck
from lassokin_ros.pipeline.depth.depth_images import DepthImages, key_of_camera
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.input_checks.hands import HandCheck
from lassokin_ros.pipeline.input_checks.image_size import ImageSize
from lassokin_ros.pipeline.input_checks.messages import (
    LEADING_SLASH,
    LandmarkIds,
    OwnDepth,
    check_layout,
    has_leading_slash,
    without_skipped,
)
from lassokin_ros.pipeline.input_checks.placeholders import PLACEHOLDERS, checked_positions, people_shown
from lassokin_ros.pipeline.input_checks.stamps import StampRate, StampWatch
from lassokin_ros.pipeline.seen import Image, people_in
from lassokin_ros.pipeline.settings import NODE, NodeSettings
from msg_adapters.detectors.registry import keypoint_adapter
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

NOBODY = "nobody in view"
"""Key of the count of messages without any confident keypoint."""
UNUSED = "keypoints below min_confidence"
"""Key of the count of messages with keypoints, none of which reaches `min_confidence`."""
DEPTH_IN_MESSAGE = "depth: in the message"
"""Key of the count of keypoint messages with depths of their own."""
RESIDUALS = 30
"""Number of images whose residuals are kept."""
UNREADABLE, UNREADABLE_WORDS = "not_deserialised", "the message could not be deserialised"
"""Rejection of a message of a recording that is damaged."""
DELAY_SHARE = 0.1
"""Weight of a new message in the average of the delays."""
UNSCORED = "keypoints without confidence"
"""Key of the count of messages with the positions of a body, all with a confidence of 0 or NaN."""


class CameraImages:
    """The inputs of one camera, and what is known about them."""

    def __init__(
        self,
        name: str,
        tracker_config: TrackerConfig,
        config: NodeSettings,
        layout: Layout,
        counts: Counter[str],
        body: str = "",
    ) -> None:
        """name: of the camera, empty if it is the only one. counts: of all messages, see `Session.counts`. body: id of
        the person whose topic it is, see `of_body`.
        """
        self.name, self.counts, self.body = name, counts, body
        self.tracker_config, self.config, self._layout = tracker_config, config, layout
        self._adapter = keypoint_adapter(config.keypoints_type)
        self.camera = Camera(config.rectified)
        """The camera of each image, from camera_info."""
        depth = config.depth_topic(name)
        self.depth = DepthImages(counts, depth, name) if depth else None
        """The depth images, None if the setting `depth` names no topic."""
        self.depth_check = DepthCheck()
        """Whether the depth images show the tracked people."""
        self.stamps = StampWatch()
        self.stamp_rate = StampRate()
        """The rates of the stamps and of the arrivals."""
        self.own_depth = OwnDepth()
        """What is unusual about depths in the keypoint messages."""
        self.image_size = ImageSize()
        """Whether camera_info is of an image of the size of the keypoints' one."""
        self.landmark_ids = LandmarkIds(layout.names)
        """Which landmarks have appeared."""
        self.hands = HandCheck(layout.names, counts)
        """Whose hands are in the image."""
        self.nobody_in_view = False
        """True if the last message had no confident keypoint."""
        self.unused_confidence = 0.0
        """Largest confidence in the last message without a confident keypoint; 0 if that had no keypoint."""
        self.received, self.arrival_ns = 0, 0
        """Number of messages, and the arrival of the last one since the last reset, ns."""
        self.residuals: deque[float] = deque(maxlen=RESIDUALS)
        """px: median distance of the person's landmarks from the keypoints of the last images, with several cameras."""
        self.delay_s: float | None = None
        """s from stamp to arrival, averaged; None before the first stamp."""
        self.stamp_ns, self.frame_id = 0, ""
        """Of the last message, as far as they are known: ns, and the frame_id, or that of its camera_info."""
        self.image_frame = ""
        """frame_id of the last image that was not refused."""
        self._unplaced = CameraPose(name)
        self._optical_frame: str | None = None  # frame_id of the camera_info of the last image

    def of_body(self, body: str) -> CameraImages:
        """Return the inputs of the topic of one body in these images, with stamps and checks of their own."""
        own = CameraImages(self.name, self.tracker_config, self.config, self._layout, self.counts, body)
        own.camera, own.depth, own.depth_check = self.camera, self.depth, self.depth_check
        return own

    def image(self, message: Any, arrival_ns: int) -> tuple[Image, bool]:
        """Return the image of a keypoint message, and whether time jumped back so that everybody must be forgotten.

        arrival_ns: ns, the stamp of a message that has none. Raises AdapterError if the message cannot be used.
        """
        self.nobody_in_view = False
        self.received, self.arrival_ns = self.received + 1, arrival_ns
        if self.name:
            self.counts[self.key("received")] += 1
        self.stamp_ns, self.frame_id = arrival_ns, ""
        keypoints, view = self._decode(message)
        view = self.image_size.view(keypoints, view)
        self.frame_id = keypoints.frame_id or view.intrinsics.frame_id
        decoded, keypoints = keypoints, self._remove_placeholders(keypoints, view)
        shown = people_shown(decoded, keypoints, self.tracker_config.min_confidence)
        inside = view.contains(keypoints.xy)  # the usual case
        self._count_nobody_and_outside(keypoints, view, shown, inside)
        self.image_size.refuse_outside(keypoints, view, self.tracker_config.min_confidence, inside)
        if keypoints.stamp_ns is None:
            self.counts["unstamped"] += 1
        else:
            self.stamp_rate.add(keypoints.stamp_ns, arrival_ns)
        stamped = keypoints.stamp_ns is not None
        stamp_ns = self.stamp_ns = keypoints.stamp_ns or self.stamps.estimate(arrival_ns)
        keypoints, sampled = self._with_depth(self.own_depth.checked(keypoints, stamp_ns), stamp_ns, view)
        count, config = len(self._layout.names), self.tracker_config
        people = self.hands.checked(people_in(keypoints, count, view.lens, config, sampled))
        numbers = keypoints.persons is not None, self._has_persistent_numbers(keypoints)
        how = (*numbers, stamped, self._unplaced, shown)
        image = Image(people, stamp_ns, self.frame_id, view.lens, *how, body=self.body)
        jumped = self._is_back_in_time(image, arrival_ns)
        if jumped:
            self._check_jump(image)
            self.stamps.seen(stamp_ns, True)
            self.delay_s = None
        if stamped:
            delay_s = (arrival_ns - stamp_ns) * 1e-9
            before_s = delay_s if self.delay_s is None else self.delay_s
            self.delay_s = before_s + DELAY_SHARE * (delay_s - before_s)
        self.image_frame = self.frame_id
        changed = self._optical_frame not in (None, view.intrinsics.frame_id)
        self._optical_frame = view.intrinsics.frame_id
        return image, jumped or changed

    def compare(self, images: Sequence[Image], frames: Sequence[FrameResult]) -> None:
        """Compare the results of an instant with the keypoints of one of several cameras, and with the depth image."""
        if self.config.several_cameras:
            self.residuals += [px for frame in frames for px in _residuals(frame, self.name)]
        if self.tracker_config.smoothing_lag == 0:
            for image in images:
                if image.camera.name == self.name:
                    self.depth_check.update(image.people, frames, self.name)

    def key(self, count: str) -> str:
        """Return the key of the count of this camera alone; count: the key of that of all cameras."""
        return key_of_camera(count, self.name)

    def reset(self) -> None:
        """Forget the stamps; everything that concerns the people was forgotten."""
        self.stamps.reset()
        self.image_size.reset()
        self.arrival_ns = 0  # its clock may have jumped back
        self.delay_s = None
        self._optical_frame = None

    def _decode(self, message: Any) -> tuple[Keypoints, View]:
        """Return the keypoints and the camera of their image."""
        if message is None:
            raise AdapterError(UNREADABLE, UNREADABLE_WORDS)
        present = self.camera.at(None)
        keypoints = self._decoded(message, present.size)
        view = self.camera.at(keypoints.stamp_ns, keypoints.frame_id)
        if view is not present:
            keypoints = self._decoded(message, view.size)
        if has_leading_slash(message):
            self.counts[LEADING_SLASH] += 1
        check_layout(keypoints, self._layout, self.tracker_config.landmarks)
        return without_skipped(keypoints, self._layout), view

    def _decoded(self, message: Any, size: tuple[int, int]) -> Keypoints:
        return message if isinstance(message, Keypoints) else self._adapter.decode(message, size)

    def _remove_placeholders(self, keypoints: Keypoints, view: View) -> Keypoints:
        """Remove placeholder coordinates, and count the message. Raises AdapterError for fractions or percent."""
        kept = checked_positions(keypoints, view.lens)
        if kept is not keypoints:
            self.counts[PLACEHOLDERS] += 1
        return kept

    def _count_nobody_and_outside(self, keypoints: Keypoints, view: View, shown: int, inside: bool) -> None:
        self.nobody_in_view = shown == 0
        if self.nobody_in_view:
            self.counts[NOBODY] += 1
            self.unused_confidence = float(keypoints.confidence.compress(keypoints.present).max(initial=0.0))
            self.counts[UNUSED] += self.unused_confidence > 0
            if self.unused_confidence == 0 and keypoints.unscored >= self.tracker_config.min_landmarks:
                self.counts[UNSCORED] += 1
        if inside:
            return
        confident = keypoints.confidence >= self.tracker_config.min_confidence  # others may be out of view
        if view.has_outside(keypoints.xy.compress(confident, axis=0)):
            self.counts.update({OUTSIDE_IMAGE, self.key(OUTSIDE_IMAGE)})

    def _with_depth(self, keypoints: Keypoints, stamp_ns: int, view: View) -> tuple[Keypoints, Keypoints | None]:
        """Return the keypoints with the depths that are used, and with those of a depth image, None without one.

        Depths that the message brings itself take precedence.
        """
        self.landmark_ids.add(keypoints)
        if keypoints.depth is not None:
            self.counts[DEPTH_IN_MESSAGE] += bool(np.count_nonzero(keypoints.depth > 0) >= FEWEST_DEPTHS)
        elif self.depth is not None:
            sampled = self.depth.with_depth(keypoints, stamp_ns, view.size, view.intrinsics.frame_id)
            self.counts[MISFIT] += bool(self.depth_check.fault)
            return keypoints if self.depth_check.fault else sampled, sampled
        return keypoints, None

    def _is_back_in_time(self, image: Image, arrival_ns: int) -> bool:
        """Return True if the people must be forgotten. Raises AdapterError for an old stamp, see `StampWatch.check`."""
        try:
            return self.stamps.check(image.stamp_ns, arrival_ns)
        except AdapterError:
            if not self.stamps.is_first_stamp(image.stamped):
                raise
            return True  # arrival times were of another clock than the stamps

    def _check_jump(self, image: Image) -> None:
        """Raise AdapterError if nobody in an image from an earlier time can be tracked."""
        if not any(one.trackable for one in image.people):
            raise AdapterError("too_few_landmarks", "the message is from an earlier time and contains no person")

    def _has_persistent_numbers(self, keypoints: Keypoints) -> bool:
        """Return True if the message's person numbers identify people over time."""
        persons = keypoints.persons
        if persons is None or not keypoints.persistent or self.config.person_ids == NODE:
            return False
        return len(persons) == 0 or bool(persons.min() >= 0)


def _residuals(frame: FrameResult, camera: str) -> Iterator[float]:
    """Yield how far an accepted body is from the keypoints of a camera, px, the median."""
    estimate = frame.estimate
    if not frame.accepted or estimate is None or estimate.pose is None:
        return
    for one in frame.images:
        apart = np.linalg.norm(project(one.camera.into_camera(estimate.pose.landmarks)) - one.points, axis=1)
        if one.camera.name == camera and np.isfinite(apart).any():
            yield one.lens.focal * float(np.median(apart[np.isfinite(apart)]))
