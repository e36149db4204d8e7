"""From the messages of one camera to images of people: decode, check, add measured depth, order by stamps."""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import Any

import numpy as np

from lassokin_ros.core.learned.height import FEWEST_DEPTHS
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE, Camera, View
from lassokin_ros.pipeline.depth.depth_images import DepthImages, key_of_camera
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
from lassokin_ros.pipeline.input_checks.stamps import StampWatch
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
UNREADABLE, UNREADABLE_WORDS = "not_deserialised", "the message could not be deserialised"
"""Rejection of a message of a recording that is damaged."""
UNSCORED = "keypoints without confidence"
"""Key of the count of messages with the positions of a body, all with a confidence of 0 or NaN."""


class CameraImages:
    """The inputs of one camera, and what is known about them."""

    def __init__(self, name: str, tracker: Tracker, config: NodeSettings, counts: Counter[str], body: str = "") -> None:
        """name: of the camera, empty if it is the only one. tracker: has the layout and the present settings. counts:
        of all messages, see `Session.counts`. body: id of the person whose topic it is, see `of_body`.
        """
        self.name, self.counts, self.body = name, counts, body
        self._tracker, self._config = tracker, config
        self.camera = Camera(config.rectified)
        """The camera of each image, from camera_info."""
        depth, names = config.depth_topic(name), tracker.layout.names
        self.depth = DepthImages(counts, depth, name) if depth else None
        """The depth images, None if the setting `depth` names no topic."""
        self.stamps = StampWatch()
        """Order, rate and delay of the stamps."""
        self.own_depth = OwnDepth()
        """What is unusual about depths in the keypoint messages."""
        self.image_size = ImageSize()
        """Whether camera_info is of an image of the size of the keypoints' one."""
        self.landmark_ids = LandmarkIds(names)
        """Which landmarks have appeared."""
        self.hands = HandCheck(names, counts)
        """Whose hands are in the image."""
        self.unused_confidence: float | None = None
        """Largest confidence in the last message if none of its keypoints was confident, 0 without keypoints; else
        None."""
        self.arrival_ns = 0
        """Arrival of the last message since the last reset, ns."""
        self.last = 0, ""
        """Stamp (ns) and frame_id, or that of camera_info, of the last message, as far as they are known."""
        self._optical_frame: str | None = None  # frame_id of the camera_info of the last image

    def of_body(self, body: str) -> CameraImages:
        """Return the inputs of the topic of one body in these images, with stamps and checks of their own."""
        own = CameraImages(self.name, self._tracker, self._config, self.counts, body)
        own.camera, own.depth = self.camera, self.depth
        return own

    def image(self, message: Any, arrival_ns: int) -> tuple[Image, bool]:
        """Return the image of a keypoint message, and whether time jumped back so that everybody must be forgotten.

        arrival_ns: ns, the stamp of a message that has none. Raises AdapterError if the message cannot be used.
        """
        self.unused_confidence, self.arrival_ns, self.last = None, arrival_ns, (arrival_ns, "")
        decoded, view = self._decode(message)
        frame_id, config = decoded.frame_id or view.intrinsics.frame_id, self._tracker.config
        self.last = arrival_ns, frame_id
        keypoints = checked_positions(decoded, view.lens)
        if keypoints is not decoded:
            self.counts[PLACEHOLDERS] += 1
        shown = people_shown(decoded, keypoints, config.min_confidence)
        if shown == 0:
            self._count_nobody(keypoints)
        inside = view.contains(keypoints.xy)  # the usual case
        if not inside:
            confident = keypoints.confidence >= config.min_confidence  # others may be out of view
            if view.has_outside(keypoints.xy.compress(confident, axis=0)):
                self.counts.update({OUTSIDE_IMAGE, self.key(OUTSIDE_IMAGE)})
        self.image_size.refuse_outside(keypoints, view, config.min_confidence, inside)
        stamped, stamp_ns = keypoints.stamp_ns is not None, keypoints.stamp_ns or self.stamps.estimate(arrival_ns)
        if not stamped:
            self.counts["unstamped"] += 1
        self.last = stamp_ns, frame_id
        keypoints, sampled = self._with_depth(keypoints, stamp_ns, view)
        people = people_in(keypoints, len(self._tracker.layout.names), view.lens, config, sampled)
        people = self.hands.checked(people) if self.hands.active else people
        numbers = keypoints.persons is not None, self._has_persistent_numbers(keypoints)
        how = (*numbers, stamped, _unplaced(self.name), shown)
        image = Image(people, stamp_ns, frame_id, view.lens, *how, body=self.body)
        jumped = self.stamps.check(stamp_ns, arrival_ns, stamped)
        if jumped:
            if not any(one.trackable for one in people):
                raise AdapterError("too_few_landmarks", "the message is from an earlier time and contains no person")
            self.stamps.seen(stamp_ns, True)
        changed = self._optical_frame not in (None, view.intrinsics.frame_id)
        self._optical_frame = view.intrinsics.frame_id
        return image, jumped or changed

    def key(self, count: str) -> str:
        """Return the key of the count of this camera alone; count: the key of that of all cameras."""
        return key_of_camera(count, self.name)

    def reset(self) -> None:
        """Forget the stamps; everything that concerns the people was forgotten."""
        self.stamps.reset()
        self.image_size.reset()
        self.arrival_ns = 0  # its clock may have jumped back
        self._optical_frame = None

    def _decode(self, message: Any) -> tuple[Keypoints, View]:
        """Return the keypoints, with ids of the layout, and the camera of their image."""
        if message is None:
            raise AdapterError(UNREADABLE, UNREADABLE_WORDS)
        decode = keypoint_adapter(self._config.keypoints_type).decode
        present = self.camera.at(None)
        keypoints = message if isinstance(message, Keypoints) else decode(message, present.size)
        view = self.camera.at(keypoints.stamp_ns, keypoints.frame_id)
        if view is not present and keypoints is not message:
            keypoints = decode(message, view.size)
        if has_leading_slash(message):
            self.counts[LEADING_SLASH] += 1
        check_layout(keypoints, self._tracker.layout, self._tracker.config.landmarks)
        keypoints = without_skipped(keypoints, self._tracker.layout)
        self.landmark_ids.add(keypoints)
        return keypoints, self.image_size.view(keypoints, view)

    def _count_nobody(self, keypoints: Keypoints) -> None:
        """Count a message without any confident keypoint."""
        self.unused_confidence = float(keypoints.confidence.compress(keypoints.present).max(initial=0.0))
        self.counts[NOBODY] += 1
        self.counts[UNUSED] += self.unused_confidence > 0
        if self.unused_confidence == 0 and keypoints.unscored >= self._tracker.config.min_landmarks:
            self.counts[UNSCORED] += 1

    def _with_depth(self, keypoints: Keypoints, stamp_ns: int, view: View) -> tuple[Keypoints, Keypoints | None]:
        """Return the keypoints with the depths that are used, and with those of a depth image, None without one.

        Depths that the message brings itself take precedence.
        """
        keypoints = self.own_depth.checked(keypoints, stamp_ns)
        if keypoints.depth is not None:
            self.counts[DEPTH_IN_MESSAGE] += bool(np.count_nonzero(keypoints.depth > 0) >= FEWEST_DEPTHS)
        elif self.depth is not None:
            sampled = self.depth.with_depth(keypoints, stamp_ns, view.size, view.intrinsics.frame_id)
            return keypoints if self.depth.check.fault else sampled, sampled
        return keypoints, None

    def _has_persistent_numbers(self, keypoints: Keypoints) -> bool:
        """Return True if the message's person numbers identify people over time."""
        persons = keypoints.persons
        if persons is None or not keypoints.persistent or self._config.person_ids == NODE:
            return False
        return len(persons) == 0 or bool(persons.min() >= 0)


@cache
def _unplaced(name: str) -> CameraPose:
    """Return the pose of a camera in its own frame."""
    return CameraPose(name)
