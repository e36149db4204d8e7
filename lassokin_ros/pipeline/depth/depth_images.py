"""The depth images of the last second: matched to keypoint messages by stamp, and sampled at the keypoints.

A keypoint gets one depth, robust against holes, noise and the background.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np

from lassokin_ros.pipeline.depth.depth_check import MISFIT, DepthCheck
from lassokin_ros.pipeline.input_checks.messages import FROZEN_S, same_image
from msg_adapters.depth_image import CompressedDepth, DepthImage, decode_compressed_depth, decode_depth_image
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

KEPT = 16
"""Depth images in memory. If a detector's delay is longer than this many periods, its image is no longer in memory."""
OLDEST = 1.5
"""Periods by which the newest depth image may be older than the keypoints, if the image of their time has not come."""
LONGEST_PERIOD_NS = 200_000_000
"""ns: assumed period of the depth images before two have come, and its upper limit."""
OVERTAKEN_NS = 500_000_000
"""ns: an image that is older than the newest one by less than this has been overtaken and is not kept. Otherwise time
has jumped back; as `stamps.JUMP_BACK_S` for keypoints."""
LARGEST_ASPECT_ERROR = 0.02
"""Largest difference of width / height between a depth image and the image of its camera_info."""

RADIUS = 0.004
"""Half of the window's side, by the width of the depth image; at least SMALLEST_RADIUS px."""
SMALLEST_RADIUS = 2
MEASURED_SHARE = 0.2
"""Least share of the window's pixels with a measurement."""
NEAR_QUANTILE = 0.25
"""Quantile of the window's depths about which the sample is taken. The body is in front of the background, so
a keypoint at the edge of a limb gets the depth of the limb."""
SAME_SURFACE = 0.1
"""m: depths this near to the quantile are of the same surface."""

REGISTERED_NAMES = ("aligned_depth_to_color", "depth_registered", "depth_to_rgb")
"""Parts of topic names of depth images that drivers register to the colour image."""

RECEIVED, MATCHED, UNMATCHED = "depth: received", "depth: matched", "depth: no image of the keypoints' time"
REFUSED, NOT_REGISTERED = "depth: refused", "depth: not registered"
EARLIER, REPEATED = "depth: matched, the image before", "depth: repeated"
COUNTS = (RECEIVED, REPEATED, MATCHED, EARLIER, UNMATCHED, REFUSED, NOT_REGISTERED)
"""Keys of the counts: depth images received, repeated and refused; keypoint messages with and without a depth image.
Those with the image of the period before are part of MATCHED."""


def key_of_camera(key: str, camera: str) -> str:
    """Return the key of the count of one camera; camera: its name, empty for the only one. key: of that of all."""
    return f"{key}: {camera}" if camera else key


class DepthImages:
    """Keeps the newest depth images. No content raises an error: see `fault`."""

    def __init__(self, counts: Any, topic: str = "", camera: str = "") -> None:
        """counts: a Counter that receives the numbers of messages, see COUNTS; with the name of one of several cameras
        they are also counted for it, see `key_of_camera`.

        topic: of the images. If it has one of REGISTERED_NAMES, images with another frame_id than the colour image's
        are registered to it nevertheless.
        """
        self._counts, self._camera = counts, camera
        self._registered = any(name in topic for name in REGISTERED_NAMES)
        self._images: deque[DepthImage | CompressedDepth] = deque(maxlen=KEPT)
        self._period_ns = LONGEST_PERIOD_NS
        self._newest: tuple[int, np.ndarray] | None = None  # stamp, ns, and content of the last image, repeated or not
        self._refused = False  # `fault` is that of a refused image
        self.received, self.arrival_ns = 0, 0
        """Number of images, usable or not, and the arrival of the last one, ns."""
        self.fault = ""
        """Why depth images are not used, in words; empty if they are."""
        self.check = DepthCheck()
        """Whether they show the tracked people."""
        self.note = ""
        """What is unusual about the depth images that are used, in words; empty if nothing is."""

    def reset(self) -> None:
        """Forget the images, because time or camera have changed, and whether they show the people."""
        self._forget_images()
        self.check.reset()

    def _forget_images(self) -> None:
        self._images.clear()
        self._period_ns, self._newest = LONGEST_PERIOD_NS, None

    @property
    def refusal(self) -> str:
        """Why the last image was refused, in words; empty if it was not."""
        return self.fault if self._refused else ""

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest image, ns; None before the first one."""
        return None if self._newest is None else self._newest[0]

    @property
    def frozen(self) -> bool:
        """True if the same image has been received for more than FROZEN_S."""
        first = self._images[-1].stamp_ns if self._images else None
        return self._newest is not None and first is not None and self._newest[0] - first > FROZEN_S * 1e9

    @property
    def tolerance_ns(self) -> int:
        """Half a period, ns: keypoints and their depth image are at most this far apart."""
        return self._period_ns // 2

    def add(self, message: Any, arrival_ns: int) -> str | None:
        """Keep a sensor_msgs/Image or CompressedImage. Return the key of the reason if it is refused.

        arrival_ns: ns, the stamp of an image that has none.
        """
        self.received, self.arrival_ns = self.received + 1, arrival_ns
        self._count(RECEIVED)
        try:
            image = decode_compressed_depth(message) if hasattr(message, "format") else decode_depth_image(message)
        except AdapterError as error:
            return self._refuse(error)
        if self._refused and isinstance(image, DepthImage):
            self.fault, self._refused = "", False
        image = replace(image, stamp_ns=image.stamp_ns or arrival_ns)
        assert image.stamp_ns is not None
        if (newest := self.newest_ns) is not None:
            step = image.stamp_ns - newest
            if -OVERTAKEN_NS < step <= 0:
                return None
            if step <= 0:
                self._forget_images()  # a bag loop, or a seek
        self._keep(image, image.stamp_ns)
        return None

    def _keep(self, image: DepthImage | CompressedDepth, stamp_ns: int) -> None:
        """Keep an image. A repeated one is no new measurement: it keeps the stamp of its first occurrence."""
        content = image.values if isinstance(image, DepthImage) else np.frombuffer(image.data, np.uint8)
        before, self._newest = self._newest, (stamp_ns, content)
        if before is not None and same_image(content, before[1]):
            self._count(REPEATED)
            return
        if self._images:
            first_ns = self._images[-1].stamp_ns
            assert first_ns is not None
            self._period_ns = min(stamp_ns - first_ns, 2 * self._period_ns, LONGEST_PERIOD_NS)
        self._images.append(image)

    def may_receive(self, stamp_ns: int | None) -> bool:
        """Return True if the depth image of keypoints with this stamp may still come."""
        newest = self.newest_ns
        return stamp_ns is not None and newest is not None and newest < stamp_ns - self.tolerance_ns

    def with_depth(self, keypoints: Keypoints, stamp_ns: int, size: tuple[int, int], frame_id: str) -> Keypoints:
        """Return the keypoints with the depths of the image of their time, or unchanged if there is none.

        If the image of their time has not come, that of the period before is used, see `Keypoints.depth_age`.
        stamp_ns: ns. size: (width, height) px of the keypoints' image. frame_id: of camera_info. Depths that the
        message brings itself take precedence.
        """
        if keypoints.depth is not None:
            return keypoints
        if self.check.fault:
            self._counts[MISFIT] += 1
        image = self._nearest(stamp_ns)
        if image is None:
            self._count(UNMATCHED)
            return keypoints
        try:
            image = self._unpacked(image)
        except AdapterError as error:
            self._refuse(error)
            return keypoints
        if fault := self._registration_fault(image, size, (keypoints.frame_id, frame_id)):
            self.fault, self._refused = fault, False
            self._count(NOT_REGISTERED)
            return keypoints
        self._count(MATCHED)
        self.fault, self._refused = "", False
        depth = sample_depth(image, keypoints.xy, size)
        assert image.stamp_ns is not None
        age_ns = stamp_ns - image.stamp_ns
        if age_ns > self.tolerance_ns:
            self._count(EARLIER)
        if not np.isfinite(depth).any():
            return keypoints
        return replace(keypoints, depth=depth, depth_of_surface=True, depth_age=1e-9 * age_ns)

    def _count(self, key: str) -> None:
        self._counts.update({key, key_of_camera(key, self._camera)})

    def _refuse(self, error: AdapterError) -> str:
        self._count(REFUSED)
        self.fault, self._refused = f"depth image refused: {error}", True
        return error.reason

    def _unpacked(self, image: DepthImage | CompressedDepth) -> DepthImage:
        """Return the pixels of one of the images. Raises AdapterError for damaged ones."""
        if isinstance(image, DepthImage):
            return image
        pixels = image.unpacked()
        self._images[self._images.index(image)] = pixels  # several people's messages may need the same image
        return pixels

    def _nearest(self, stamp_ns: int) -> DepthImage | CompressedDepth | None:
        """Return the image nearest to a stamp, at most half a period away, or the newest one before; None without."""
        apart = [abs(image.stamp_ns - stamp_ns) for image in self._images if image.stamp_ns is not None]
        if not apart:
            return None
        nearest = self._images[apart.index(min(apart))]
        older = self.may_receive(stamp_ns) and min(apart) <= OLDEST * self._period_ns
        return nearest if older or min(apart) <= self.tolerance_ns else None

    def _registration_fault(self, image: DepthImage, size: tuple[int, int], frames: tuple[str, str]) -> str:
        """Return why an image cannot be registered to the colour image; empty if it can. frames: of the latter."""
        width, height = image.size
        if min(size) <= 0:
            return "camera_info has no image size: depth is not used"
        advice = "depth is not used; subscribe to the depth image that is registered (aligned) to the colour image"
        if abs((width / height) / (size[0] / size[1]) - 1) > LARGEST_ASPECT_ERROR:
            return (
                f"the depth image has {width} x {height} px, the colour image {size[0]} x {size[1]}, "
                f"a different shape: {advice}, and check that camera_info is of the same camera"
            )
        if not image.frame_id or not any(frames) or image.frame_id in frames:
            return ""
        differs = (
            f"the depth image has the frame_id '{image.frame_id}', the colour image '{next(filter(None, frames))}'"
        )
        if not self._registered:
            return f"{differs}: {advice}, or if it is, remap the topic depth_registered to it, and name that in depth"
        self.note = f"{differs}: the depth image is used as registered to the colour image"
        return ""


def sample_depth(image: DepthImage, xy: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the depth of the surface at keypoints (k, 2) px, as (k,) m, NaN = not measured.

    size: (width, height) px of the image of the keypoints. The depth image may have another resolution.
    """
    width, height = image.size
    scale = np.array([width / size[0], height / size[1]])
    with np.errstate(invalid="ignore"):
        centre = np.floor((xy + 0.5) * scale)  # pixel i covers [i, i + 1) of the scaled image
        inside = ((centre >= 0) & (centre < [width, height])).all(axis=1)
    result = np.full(len(xy), np.nan)
    if not inside.any():
        return result
    radius = max(SMALLEST_RADIUS, round(RADIUS * width))
    steps = np.arange(-radius, radius + 1)
    columns, rows = (centre[inside].astype(int)[:, :, None] + steps).swapaxes(0, 1)
    windows = image.metres(rows.clip(0, height - 1)[:, :, None], columns.clip(0, width - 1)[:, None, :])
    result[inside] = _nearest_surface(windows.reshape(len(windows), -1))
    return result


def _nearest_surface(windows: np.ndarray) -> np.ndarray:
    """Return the mean depth (k,) of the nearest surface in windows (k, n), m, NaN = missing."""
    ordered = np.sort(windows, axis=1)  # NaN last
    count = np.count_nonzero(np.isfinite(ordered), axis=1)
    enough = count >= max(1.0, MEASURED_SHARE * windows.shape[1])
    quantile = ordered[np.arange(len(ordered)), (NEAR_QUANTILE * np.maximum(count - 1, 0)).astype(int)]
    with np.errstate(invalid="ignore"):
        same = np.abs(ordered - quantile[:, None]) <= SAME_SURFACE
    total = np.where(same, ordered, 0.0).sum(axis=1)
    return np.where(enough, total / np.maximum(np.count_nonzero(same, axis=1), 1), np.nan)
