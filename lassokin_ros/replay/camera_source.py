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
    file. info: CameraInfo of the file, or the first one of a topic that begins after the keypoints; None for another
    topic.
    """

    name: str
    title: str
    recorded: tuple[RecordedTopic, ...] = ()
    info: Any = None

    def messages(self, bag: BagReader, read: Sequence[RecordedTopic]) -> Iterator[tuple[str, int, Any]]:
        """Yield (topic, recording time in ns, message) of `read`; `info` comes first, under `name`."""
        pending = self.info
        for topic, time_ns, message in bag.messages(read):
            if pending is not None:
                yield self.name, time_ns, pending
                pending = None
            yield topic, time_ns, message


def camera_source(
    bag: BagReader, options: argparse.Namespace, rectified: bool, keypoints: RecordedTopic
) -> CameraSource:
    """Return the source that the options select. The file replaces camera_info of the recording.

    rectified: the parameter of the tracker. keypoints: their topic. Raises BagError, CameraError.
    """
    file = options.camera_info
    if file is None:
        instead = f"give the calibration with {FILE_OPTION} FILE"
        topic = bag.find(
            topics.CAMERA_INFO_TYPE, options.camera_info_topic, topics.CAMERA_INFO, OPTION, instead=instead
        )
        return _with_late_camera(bag, keypoints, topic)
    if options.camera_info_topic is not None:
        raise CameraError(f"{OPTION} and {FILE_OPTION} exclude each other; expected one of them")
    calibration = read_calibration(file)
    try:
        info = calibration.message(RosbagsBackend(bag.types), 0, "", rectified)
    except CameraError as error:
        raise CameraError(f"{FILE_OPTION} '{file}': {error}") from None
    return CameraSource(f"file {file}", f"file {file}", (), info)


def _with_late_camera(bag: BagReader, keypoints: RecordedTopic, camera: RecordedTopic) -> CameraSource:
    """Return the topic as source. If it begins after the keypoints, its first message is used for those before it.

    A camera that published once, when something connected, is recorded late; its intrinsics are the same before.
    """
    times = {topic.name: next(bag.messages([topic]), None) for topic in (keypoints, camera)}
    first, info = times[keypoints.name], times[camera.name]
    if first is None or info is None or info[2] is None or info[1] <= first[1]:
        return CameraSource(camera.name, str(camera), (camera,))
    late_s = (info[1] - first[1]) * 1e-9
    title = f"{camera}; its first message is also used for the {late_s:.1f} s of keypoints before it"
    return CameraSource(camera.name, title, (camera,), info[2])
