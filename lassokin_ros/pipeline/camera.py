"""The camera in use: what camera_info says, and which keypoints still belong to what it said before."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.lens import Lens
from msg_adapters.camera_info import Intrinsics, decode_camera_info
from msg_adapters.errors import AdapterError

IN_FLIGHT_NS = 1_000_000_000
"""Keypoints of an image up to this much older than a change of the camera are read with the camera before it: a
detector takes its time."""
OUTSIDE_IMAGE = "beyond the image"
"""Under what messages are counted whose keypoints leave it."""
MARGIN = 0.05
"""Of the image: how far keypoints may lie beyond it, as those of a limb that it cuts do."""
FEW = 0.1
"""Share of an image's keypoints that may lie farther out."""


@dataclass(frozen=True, eq=False)
class View:
    """A camera as it is from one stamp on; stamp_ns: ns, 0 where camera_info has none."""

    lens: Lens
    intrinsics: Intrinsics
    stamp_ns: int

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) px of the image."""
        return self.intrinsics.width, self.intrinsics.height

    @cached_property
    def _limits(self) -> tuple[np.ndarray, np.ndarray]:
        """The least and greatest coordinates (2,) px that keypoints may have."""
        size = np.array(self.size, dtype=float)
        margin = np.where(size > 0, MARGIN * size, np.inf)
        return -margin, size + margin

    def is_left_by(self, xy: np.ndarray) -> bool:
        """True where many of the keypoints (k, 2), px, lie beyond the borders: they are another image's."""
        least, greatest = self._limits
        return int(np.count_nonzero(((xy < least) | (xy > greatest)).any(axis=1))) > FEW * len(xy)


class Camera:
    """Takes camera_info messages, most of which say what is known already."""

    def __init__(self, rectified: bool) -> None:
        """rectified: keypoints are pixels of the rectified image."""
        self._rectified = rectified
        self._now: View | None = None
        self._before: View | None = None
        self._key: tuple[Any, ...] | None = None
        self.fault = ""
        """Why the last camera_info was refused, in words; empty when it was taken."""

    @property
    def view(self) -> View | None:
        """The present camera, None before the first that is usable."""
        return self._now

    def update(self, message: Any) -> bool:
        """Take over a CameraInfo message; True when it is another camera's (frame_id) than before.

        Raises AdapterError when it is refused; the last good camera then stays.
        """
        key = _key(message)
        if key == self._key and not self.fault:
            return False
        self._key = key
        try:
            intrinsics = decode_camera_info(message)
            lens = Lens.from_intrinsics(intrinsics, self._rectified)
        except AdapterError as error:
            self.fault = str(error)
            raise
        except CameraError as error:
            self.fault = str(error)
            raise AdapterError("camera_unusable", self.fault) from None
        stamp = message.header.stamp
        self.fault = ""
        self._before, self._now = self._now, View(lens, intrinsics, stamp.sec * 1_000_000_000 + stamp.nanosec)
        return self._before is not None and self._before.intrinsics.frame_id != intrinsics.frame_id

    def at(self, stamp_ns: int | None) -> View:
        """The camera that took the image of this stamp; the present one where there is no stamp.

        Raises AdapterError before the first usable camera_info.
        """
        if self._now is None:
            raise AdapterError("no_camera_info", self.fault or "no camera_info has come yet")
        if self._before is None or stamp_ns is None:
            return self._now
        early = 0 < self._now.stamp_ns - stamp_ns <= IN_FLIGHT_NS
        return self._before if early else self._now


def _key(message: Any) -> tuple[Any, ...]:
    """What of a CameraInfo matters, cheap to compare: it comes with every image and hardly ever changes."""
    roi = message.roi
    image = (message.width, message.height, message.binning_x, message.binning_y)
    window = (roi.x_offset, roi.y_offset, roi.width, roi.height)
    numbers = (bytes(message.k), bytes(message.d[:32]), bytes(message.p), bytes(message.r))
    return (message.distortion_model, message.header.frame_id, *image, *window, *numbers)
