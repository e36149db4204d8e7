"""The camera's images of a recording, for the image plane of the report."""

from __future__ import annotations

import argparse
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
