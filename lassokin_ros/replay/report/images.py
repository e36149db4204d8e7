"""The images of a recording for the page: read from image topics, as JPEG, scaled down, and thinned to a limit."""

from __future__ import annotations

import argparse
import base64
from collections.abc import Callable, Mapping, Set
from typing import Any

import numpy as np

from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.pipeline.outputs.topics import of_camera
from lassokin_ros.replay.bags import BagReader, RecordedTopic
from lassokin_ros.replay.camera_source import full_name
from msg_adapters.errors import AdapterError
from msg_adapters.image import decode_compressed_image, decode_image
from msg_adapters.keypoints import header_stamp, stamp_of

LONGEST_SIDE = 640
"""px"""
QUALITY = 70
"""JPEG quality."""
MOST, BUDGET = 300, 6_000_000
"""Largest number of images, and bytes before base64 (which adds a third).

Above either, every second image is removed.
"""


class ReportImages:
    """Images in order of arrival. Of a long recording every n-th is kept."""

    def __init__(self) -> None:
        self._images: dict[int, bytes] = {}
        self._stride, self._count = 1, 0

    def add(self, stamp_ns: int, read: Callable[[], np.ndarray]) -> None:
        """Add an image. read: returns it, (height, width, 3) uint8 RGB; called only if the image is kept."""
        if self._count % self._stride == 0:
            self._images[stamp_ns] = jpeg(read())
        self._count += 1
        while len(self._images) > MOST or sum(map(len, self._images.values())) > BUDGET:
            self._images = dict(list(self._images.items())[::2])
            self._stride *= 2

    def move(self, moved: Callable[[int], int]) -> None:
        """Give the images other stamps. moved: returns the new stamp of an old one, ns."""
        self._images = {moved(stamp_ns): image for stamp_ns, image in self._images.items()}

    def data(self, times: Mapping[int, float], apart_ns: int = 0) -> dict[str, Any]:
        """Return the data for the page. times: s on the page's axis by stamp in ns; images without a time are left out.

        apart_ns: ns by which the stamp of an image may differ. time: of each image, increasing. jpeg: base64 of each.
        """
        stamps = np.array(sorted(times), dtype=np.int64)
        near = {stamp: stamps[np.argmin(np.abs(stamps - stamp))] for stamp in self._images} if len(stamps) else {}
        known = sorted((times[int(k)], self._images[s]) for s, k in near.items() if abs(int(k) - s) <= apart_ns)
        return {
            "time": [round(time, 4) for time, _ in known],
            "jpeg": [base64.b64encode(image).decode() for _, image in known],
        }


def jpeg(rgb: np.ndarray) -> bytes:
    """Return an image (height, width, 3), uint8 RGB, as JPEG, scaled down to LONGEST_SIDE."""
    import cv2

    scale = LONGEST_SIDE / max(rgb.shape[:2])
    if scale < 1.0:
        size = max(round(rgb.shape[1] * scale), 1), max(round(rgb.shape[0] * scale), 1)
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(data)


OPTION = "--image-topic"
DECODERS = {"sensor_msgs/msg/Image": decode_image, "sensor_msgs/msg/CompressedImage": decode_compressed_image}
"""By message type."""
AddImage = Callable[[int, Callable[[], np.ndarray]], None]
"""Stamp in ns, and a function that returns the image; see `ReportImages.add`."""


class RecordedImages:
    """Takes the messages of an image topic. Images that cannot be decoded are left out and counted."""

    def __init__(self, topic: RecordedTopic, wanted: Set[int | None], add: AddImage) -> None:
        """wanted: stamps of the keypoints, ns; other images are not decoded. add: takes the images."""
        self.topic, self._wanted, self._add, self._decode = topic, wanted, add, DECODERS[topic.message_type]
        self._count = 0
        self._reasons: dict[str, int] = {}

    def take(self, message: Any, _time_ns: int) -> None:
        """Take a message, None if it is malformed."""
        try:
            if message is None:
                raise AdapterError("not_deserialised", "")
            stamp_ns = header_stamp(message.header)
            if stamp_ns is not None and stamp_ns in self._wanted:
                self._count += 1
                self._add(stamp_ns, lambda: self._decode(message))
        except AdapterError as error:
            self._reasons[error.reason] = self._reasons.get(error.reason, 0) + 1

    def __str__(self) -> str:
        rejected = "".join(f"; not shown: {reason} {count}" for reason, count in sorted(self._reasons.items()))
        return f"{self.topic}, {self._count} have the stamp of keypoints{rejected}"


def recorded_images(
    bag: BagReader, options: argparse.Namespace, report: Any, keypoints: Mapping[str, RecordedTopic]
) -> list[RecordedImages]:
    """Return the images of --image-topic for the report, none without the option. Reads the stamps of the keypoints.

    keypoints: their topic by the name of the camera. Of several cameras the images are on <name>/<image topic>. Raises
    BagError, ConfigurationError.
    """
    if options.image_topic is None:
        return []
    if report is None:
        raise ConfigurationError(f"{OPTION} shows the images in the report; add --report HTML")
    raw, compressed = DECODERS
    recorded = {topic.name.strip("/"): topic.message_type for topic in bag.topics}
    found = []
    for name, own in keypoints.items():
        chosen = full_name(bag, of_camera(options.image_topic.strip("/"), name)) if name else options.image_topic
        message_type = compressed if recorded.get(chosen.strip("/")) == compressed else raw
        topic = bag.find(message_type, chosen, "image_raw", OPTION)
        wanted = {stamp_of(message) for _, _, message in bag.messages([own]) if message is not None}
        found.append(RecordedImages(topic, wanted, report.images[name].add))
    return found
