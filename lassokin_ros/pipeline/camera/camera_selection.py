"""The camera of an image, from the received camera_info messages."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera.lens import Lens
from msg_adapters.camera_info import Intrinsics, decode_camera_info
from msg_adapters.errors import AdapterError

IN_FLIGHT_NS = 1_000_000_000
"""ns: an image that is older than a change of the camera by at most this belongs to the previous camera, because
detectors have a delay."""
OUTSIDE_IMAGE = "beyond the image"
"""Key of the count of messages with keypoints outside the image."""
MARGIN = 0.05
"""Fraction of the image size by which keypoints may lie outside, as those of a truncated limb do."""
FEW = 0.1
"""Fraction of the keypoints of an image that may lie farther outside."""
MOST_CAMERAS = 8
"""Number of cameras on one topic that are remembered."""
RECENT, ALTERNATIONS, STEADY = 20, 3, 150
"""Several cameras share the topic if their frame_ids change at least ALTERNATIONS times among the last RECENT changes,
or if as many are returns to an earlier camera after a short time. After STEADY messages or images of one camera the
changes are forgotten."""
SHORT, LASTING = 1, 30
"""Messages, and images, for which a camera lasts at most if another publisher interrupts it; the second number if the
topic is known to have several publishers, which may be slow. A zoom to and fro of one camera lasts longer. A camera
that lasts for more than LASTING messages or images is used in any case: the other one has ended."""
SHORT_NS = 1_000_000_000
"""ns: time between the stamps of camera_info within which a camera is interrupted, too, although more images came
meanwhile; a zoom to and fro takes longer."""


@dataclass(frozen=True, eq=False)
class View:
    """A camera from one stamp on; stamp_ns: ns, 0 if camera_info has no stamp."""

    lens: Lens
    intrinsics: Intrinsics
    stamp_ns: int

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) px of the image."""
        return self.intrinsics.width, self.intrinsics.height

    @cached_property
    def _limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest coordinates (2,) px of keypoints."""
        size = np.array(self.size, dtype=float)
        margin = np.where(size > 0, MARGIN * size, np.inf)
        return -margin, size + margin

    def scaled(self, factor: float) -> View:
        """Return the camera of the same image in another size, see `Lens.scaled`."""
        lens = self.lens.scaled(factor)
        width, height = lens.size
        return View(lens, replace(self.intrinsics, K=lens.K, width=width, height=height), self.stamp_ns)

    def contains(self, xy: np.ndarray) -> bool:
        """Return True if no keypoint (k, 2), px, is outside the image, apart from a margin. NaN is not outside."""
        least, greatest = self._limits
        return not np.count_nonzero((xy < least) | (xy > greatest))

    def has_outside(self, xy: np.ndarray) -> bool:
        """Return True if many of the keypoints (k, 2), px, are outside the image: they belong to another one."""
        least, greatest = self._limits
        outside = (xy < least) | (xy > greatest)
        return int(np.count_nonzero(outside[:, 0] | outside[:, 1])) > FEW * len(xy)


@dataclass
class _Stay:
    """A camera_info message, those with the same camera after it, and the images that came meanwhile."""

    frame: str
    content: tuple[Any, ...]
    message: Any
    messages: int = 1
    images: int = 0

    def is_within(self, count: int) -> bool:
        """Whether it has lasted for at most that many messages and images."""
        return self.messages <= count and self.images <= count

    def is_same(self, other: _Stay) -> bool:
        """Whether both have the same camera."""
        return self.frame == other.frame and self.content == other.content


class Camera:
    """Receives camera_info messages and selects the camera of an image.

    The camera with the frame_id of the keypoints is used, if there is one, else the newest camera.
    """

    def __init__(self, rectified: bool) -> None:
        """rectified: keypoints are pixels of the rectified image."""
        self._rectified = rectified
        self._newest: tuple[View | None, View | None] = None, None  # now, before
        self._by_frame: dict[str, tuple[View, View | None]] = {}
        self._keys: dict[str, tuple[Any, ...]] = {}
        self._recent: deque[_Stay] = deque(maxlen=RECENT)
        self._ignored: _Stay | None = None  # the newest camera_info, if it is that of another camera on the topic
        self.publishers = 0
        """Number of publishers of the topic, 0 if it is not known."""
        self._frame = ""  # of the last keypoints
        self.fault = ""
        """Why the last camera_info was refused, in words; empty if it was accepted."""

    @property
    def view(self) -> View | None:
        """The present camera, None before the first usable camera_info."""
        return self._views(self._frame)[0]

    @property
    def warning(self) -> str:
        """Why the camera_info in use may be wrong, in words; empty if nothing indicates that."""
        if (view := self.view) is None:
            return ""
        if self._frames_alternate:
            names = ", ".join(f"'{name[:40]}'" for name in sorted({stay.frame for stay in self._recent})[:MOST_CAMERAS])
            return (
                f"camera_info of several cameras on one topic ({names}); used is '{view.intrinsics.frame_id[:40]}'; "
                "expected one camera, or keypoints with the frame_id of their camera"
            )
        frame = view.intrinsics.frame_id
        if self._alternates(frame):
            used, other = f"fx = {view.intrinsics.K[0, 0]:g} px and {view.size[0]} x {view.size[1]} px", ""
            if self._ignored is not None and self._ignored.frame == frame:
                info = self._ignored.message
                other = f", the other one has fx = {info.k[0]:g} px and {info.width} x {info.height} px"
            return (
                f"camera_info of two cameras with the frame_id '{frame[:40]}' on one topic; used is the one with {used}"
                f"{other}; expected one publisher: remap camera_info to that of the detector's image, or give the "
                "drivers different frame_ids"
            )
        return view.lens.warning

    @property
    def is_shared(self) -> bool:
        """True if several cameras share the topic."""
        view = self.view
        return self._frames_alternate or (view is not None and self._alternates(view.intrinsics.frame_id))

    @property
    def _frames_alternate(self) -> bool:
        frames = [stay.frame for stay in self._recent]
        return sum(a != b for a, b in zip(frames, frames[1:])) >= ALTERNATIONS

    def _alternates(self, frame: str) -> bool:
        """Return True if camera_info of this frame_id returns again and again, soon, to an earlier one."""
        stays = self._stays_of(frame)
        returns = 0
        for i in range(2, len(stays)):
            before, stay = stays[i - 1 : i + 1]
            since_ns = _stamp_ns(before.message)
            soon = 0 < since_ns < _stamp_ns(stay.message) <= since_ns + SHORT_NS and before.messages <= SHORT
            if soon or before.is_within(SHORT if self.publishers < 2 else LASTING):
                returns += any(map(stay.is_same, stays[: i - 1]))
        return returns >= ALTERNATIONS

    def _stays_of(self, frame: str) -> list[_Stay]:
        """Return the cameras that this frame_id had, in order, whatever other frame_ids were between."""
        stays: list[_Stay] = []
        for stay in self._recent:
            if stay.frame == frame:
                if stays and stays[-1].is_same(stay):
                    joined = stays.pop()
                    both = joined.messages + stay.messages, joined.images + stay.images
                    stay = replace(stay, messages=both[0], images=both[1])
                stays.append(stay)
        return stays

    def update(self, message: Any) -> bool:
        """Apply a CameraInfo message, Intrinsics or a Lens. Return True if the camera changes to another frame_id.

        Raises AdapterError if the message is refused; the last good camera then stays.
        """
        before = self.view
        if isinstance(message, (Intrinsics, Lens)):
            arrays = message if isinstance(message, Intrinsics) else message.intrinsics
            self._newest = self._viewed(arrays, 0), self._newest[0]
            return before is not None and before.intrinsics.frame_id != arrays.frame_id
        stay = _Stay(message.header.frame_id.lstrip("/"), _key(message), message)
        frame = stay.frame
        shared = frame in self._by_frame and self._alternates(frame)
        if self._recent and self._recent[-1].is_same(stay):
            self._recent[-1].messages += 1
            self._forget_changes(self._recent[-1].messages)
        else:
            self._recent.append(stay)
        if not shared or stay.content == self._keys[frame] or not self._stays_of(frame)[-1].is_within(LASTING):
            self._use(stay)
        elif self._ignored is None or not self._ignored.is_same(stay):
            self._ignored = replace(stay)
        now = self.view
        return before is not None and now is not None and before.intrinsics.frame_id != now.intrinsics.frame_id

    def _use(self, stay: _Stay) -> None:
        """Use the camera of a message for its frame_id, and as the newest one. Raises AdapterError."""
        frame, content = stay.frame, stay.content
        if self._ignored is not None and self._ignored.frame == frame:
            self._ignored = None
        if content == self._keys.get(frame):
            self.fault = ""
        else:
            try:
                intrinsics = decode_camera_info(stay.message, self._rectified)
            except AdapterError as error:
                self.fault = str(error)
                raise
            view = self._viewed(intrinsics, _stamp_ns(stay.message))
            previous = self._by_frame.pop(frame, (None, None))[0]
            if len(self._by_frame) >= MOST_CAMERAS:
                oldest = next(iter(self._by_frame))
                del self._by_frame[oldest], self._keys[oldest]
            self._by_frame[frame], self._keys[frame] = (view, previous), content
        view, newest = self._by_frame[frame][0], self._newest[0]
        if newest is None or newest.intrinsics is not view.intrinsics:
            self._newest = replace(view, stamp_ns=_stamp_ns(stay.message)), newest

    def _note_image(self) -> None:
        """Count an image. An ignored camera is used if no other one comes, also if it was published only once."""
        if not self._recent:
            return
        self._recent[-1].images += 1
        self._forget_changes(self._recent[-1].images)
        if self._ignored is not None:
            self._ignored.images += 1
            if self._ignored.images > LASTING:
                with suppress(AdapterError):  # see `fault`
                    self._use(self._ignored)

    def _forget_changes(self, count: int) -> None:
        """Forget the changes before the present camera if it has lasted for this number of messages or images."""
        if count == STEADY:
            self._recent = deque([self._recent[-1]], maxlen=RECENT)

    def _viewed(self, intrinsics: Intrinsics, stamp_ns: int) -> View:
        try:
            lens = Lens.from_intrinsics(intrinsics, self._rectified)
        except CameraError as error:
            self.fault = str(error)
            raise AdapterError("camera_unusable", self.fault) from None
        self.fault = ""
        return View(lens, intrinsics, stamp_ns)

    def _views(self, frame: str) -> tuple[View | None, View | None]:
        """Return the present and the previous camera for keypoints of this frame."""
        return self._by_frame.get(frame, self._newest) if frame else self._newest

    def at(self, stamp_ns: int | None, frame: str | None = None) -> View:
        """Return the camera of the image with this stamp (ns) and frame_id; without stamp the present camera.

        frame: None = that of the last keypoints. Raises AdapterError before the first usable camera_info.
        """
        if frame is not None:
            self._frame = frame
            self._note_image()
        now, before = self._views(self._frame)
        if now is None:
            raise AdapterError("no_camera_info", self.fault or "no camera_info received yet")
        if before is None or stamp_ns is None:
            return now
        early = 0 < now.stamp_ns - stamp_ns <= IN_FLIGHT_NS
        return before if early else now


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def _key(message: Any) -> tuple[Any, ...]:
    """Return the used content of a CameraInfo, for a fast comparison with the previous message."""
    roi = message.roi
    image = (message.width, message.height, message.binning_x, message.binning_y)
    window = (roi.x_offset, roi.y_offset, roi.width, roi.height)
    numbers = (bytes(message.k), bytes(message.d[:32]), bytes(message.p), bytes(message.r))
    return (message.distortion_model, message.header.frame_id, *image, *window, *numbers)
