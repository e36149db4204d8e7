"""Where the camera of a recording comes from: its camera_info topic, or the calibration file of --camera-info."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera.calibration_file import read_calibration
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.replay.bags import BagReader, RecordedTopic
from msg_adapters.backends import RosbagsBackend

OPTION, FILE_OPTION = "--camera-info-topic", "--camera-info"


@dataclass(frozen=True)
class CameraSource:
    """The source of camera_info.

    name: the topic, or the file as the user wrote it. title: the same for the summary. recorded: the topic, empty for a
    file. info: CameraInfo of the file, None for a topic.
    """

    name: str
    title: str
    recorded: tuple[RecordedTopic, ...] = ()
    info: Any = None

    def messages(self, bag: BagReader, read: Sequence[RecordedTopic]) -> Iterator[tuple[str, int, Any]]:
        """Yield (topic, recording time in ns, message) of `read`; a file's CameraInfo comes first, under `name`."""
        pending = self.info
        for topic, time_ns, message in bag.messages(read):
            if pending is not None:
                yield self.name, time_ns, pending
                pending = None
            yield topic, time_ns, message


def camera_source(bag: BagReader, options: argparse.Namespace, rectified: bool) -> CameraSource:
    """Return the source that the options select. The file replaces camera_info of the recording.

    rectified: the parameter of the tracker. Raises BagError, CameraError.
    """
    file = options.camera_info
    if file is None:
        instead = f"give the calibration with {FILE_OPTION} FILE"
        topic = bag.find(
            topics.CAMERA_INFO_TYPE, options.camera_info_topic, topics.CAMERA_INFO, OPTION, instead=instead
        )
        return CameraSource(topic.name, str(topic), (topic,))
    if options.camera_info_topic is not None:
        raise CameraError(f"{OPTION} and {FILE_OPTION} exclude each other; expected one of them")
    calibration = read_calibration(file)
    try:
        info = calibration.message(RosbagsBackend(bag.types), 0, "", rectified)
    except CameraError as error:
        raise CameraError(f"{FILE_OPTION} '{file}': {error}") from None
    return CameraSource(f"file {file}", f"file {file}", (), info)
