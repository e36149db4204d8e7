"""Where the camera of a recording comes from: its camera_info topic, or the calibration file of --camera-info."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.calibration_file import Calibration, read_calibration, read_cameras
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.bags import BagReader, RecordedTopic
from msg_adapters.backends import RosbagsBackend
from msg_adapters.detectors.registry import full_type_name

OPTION, FILE_OPTION = "--camera-info-topic", "--camera-info"


@dataclass(frozen=True)
class RecordedCamera:
    """A camera of the recording: its name, empty for the only one, the topic of its keypoints, and its camera_info.

    source: the topic of camera_info, or the file as the user wrote it. title: the same for the summary. recorded: the
    topic, empty for a file. info: CameraInfo of the file, or the first one of a topic that begins after the keypoints;
    None for another topic. pose: from a calibration file, None if TF gives it.
    """

    name: str
    keypoints: RecordedTopic
    source: str
    title: str
    recorded: tuple[RecordedTopic, ...] = ()
    info: Any = None
    pose: CameraPose | None = None

    @property
    def topics(self) -> tuple[RecordedTopic, ...]:
        """The topics to read."""
        return (self.keypoints, *self.recorded)


def messages_of(
    cameras: Sequence[RecordedCamera], bag: BagReader, read: Sequence[RecordedTopic]
) -> Iterator[tuple[str, int, Any]]:
    """Yield (topic, recording time in ns, message) of `read`; the cameras' `info` come first, as from `source`."""
    pending = [camera for camera in cameras if camera.info is not None]
    for topic, time_ns, message in bag.messages(read):
        for camera in pending:
            yield camera.source, time_ns, camera.info
        pending = []
        yield topic, time_ns, message


def recorded_cameras(bag: BagReader, options: argparse.Namespace, config: NodeSettings) -> list[RecordedCamera]:
    """Return the cameras that the settings name, with their topics or the calibration file that the options select.

    Raises BagError, CameraError.
    """
    kind, names, file = full_type_name(config.keypoints_type), config.camera_names, options.camera_info
    topic, info_topic, several = options.keypoints_topic, options.camera_info_topic, names != ("",)
    for option, given in (("--keypoints-topic", topic), (OPTION, info_topic)) if several else ():
        if given is not None:
            raise CameraError(f"{option} '{given}' with several cameras; their topics are <name>/keypoints, and so on")
    if file is not None and info_topic is not None:
        raise CameraError(f"{OPTION} and {FILE_OPTION} exclude each other; expected one of them")
    in_file: dict[str, tuple[Calibration, CameraPose | None]] = {}
    if file is not None:
        in_file = {**read_cameras(file, names)} if several else {"": (read_calibration(file), None)}
    cameras = []
    for name in in_file or names:

        def find(kind: str, given: str | None, usual: str, option: str, instead: str = "") -> RecordedTopic:
            if several:
                return bag.find(kind, full_name(bag, topics.of_camera(usual, name)), "", "-p cameras:=")
            return bag.find(kind, given, usual, option, instead)

        keypoints = find(kind, topic, topics.KEYPOINTS, "--keypoints-topic")
        if in_file:
            cameras.append(_of_file(bag, file, name, *in_file[name], config.rectified, keypoints))
        else:
            instead = f"give the calibration with {FILE_OPTION} FILE"
            found = find(topics.CAMERA_INFO_TYPE, info_topic, topics.CAMERA_INFO, OPTION, instead)
            cameras.append(_of_topic(bag, name, keypoints, found))
    return cameras


def full_name(bag: BagReader, topic: str) -> str:
    """Return the name in the recording of a topic that may be in a namespace. Raises CameraError for several."""
    found = [t.name for t in bag.topics if f"/{t.name.strip('/')}".endswith(f"/{topic}")]
    found = [name for name in found if name.strip("/") == topic] or found
    if len(found) > 1:
        raise CameraError(
            f"{bag.path} has several topics '{topic}': {', '.join(found)}; expected one, or one without a namespace; "
            "copy the recording without the others"
        )
    return found[0] if found else topic


def _of_file(
    bag: BagReader,
    file: Path,
    name: str,
    calibration: Calibration,
    pose: CameraPose | None,
    rectified: bool,
    keypoints: RecordedTopic,
) -> RecordedCamera:
    try:
        info = calibration.message(RosbagsBackend(bag.types), 0, name, rectified)
    except CameraError as error:
        raise CameraError(f"{FILE_OPTION} '{file}': {error}") from None
    title = f"file {file}:{name}" if name else f"file {file}"
    return RecordedCamera(name, keypoints, title, title, (), info, pose)


def _of_topic(bag: BagReader, name: str, keypoints: RecordedTopic, camera: RecordedTopic) -> RecordedCamera:
    """Return a camera with its topic. If it begins after the keypoints, its first message is used for those before it.

    A camera that published once, when something connected, is recorded late; its intrinsics are the same before.
    """
    first, info = (next(bag.messages([topic]), None) for topic in (keypoints, camera))
    if first is None or info is None or info[2] is None or info[1] <= first[1]:
        return RecordedCamera(name, keypoints, camera.name, str(camera), (camera,))
    late_s = (info[1] - first[1]) * 1e-9
    title = f"{camera}; its first message is also used for the {late_s:.1f} s of keypoints before it"
    return RecordedCamera(name, keypoints, camera.name, title, (camera,), info[2])
