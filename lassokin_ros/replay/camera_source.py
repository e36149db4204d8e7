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


@dataclass(frozen=True)
class RecordedCamera:
    """A camera of the recording: its name, empty for the only one, the topic of its keypoints, and its camera_info.

    pose: from a calibration file, None if TF gives it.
    """

    name: str
    keypoints: RecordedTopic
    source: CameraSource
    pose: CameraPose | None = None

    @property
    def topics(self) -> tuple[RecordedTopic, ...]:
        """The topics to read."""
        return (self.keypoints, *self.source.recorded)


def messages_of(
    cameras: Sequence[RecordedCamera], bag: BagReader, read: Sequence[RecordedTopic]
) -> Iterator[tuple[str, int, Any]]:
    """Yield (topic, recording time in ns, message) of `read`; the cameras' `info` come first, under their names."""
    pending = [camera.source for camera in cameras if camera.source.info is not None]
    for topic, time_ns, message in bag.messages(read):
        for source in pending:
            yield source.name, time_ns, source.info
        pending = []
        yield topic, time_ns, message


def recorded_cameras(bag: BagReader, options: argparse.Namespace, config: NodeSettings) -> list[RecordedCamera]:
    """Return the cameras that the settings name, with their topics or the calibration file that the options select.

    Raises BagError, CameraError.
    """
    kind, names = full_type_name(config.keypoints_type), config.camera_names
    if names == ("",):
        keypoints = bag.find(kind, options.keypoints_topic, topics.KEYPOINTS, "--keypoints-topic")
        return [RecordedCamera("", keypoints, _only_source(bag, options, config.rectified, keypoints))]
    for option, given in (("--keypoints-topic", options.keypoints_topic), (OPTION, options.camera_info_topic)):
        if given is not None:
            raise CameraError(f"{option} '{given}' with several cameras; their topics are <name>/keypoints, and so on")
    if options.camera_info is not None:
        return _of_file(bag, options.camera_info, config)
    cameras = []
    for name in names:
        keypoints = bag.find(kind, full_name(bag, topics.of_camera(topics.KEYPOINTS, name)), "", "-p cameras:=")
        info = full_name(bag, topics.of_camera(topics.CAMERA_INFO, name))
        found = bag.find(topics.CAMERA_INFO_TYPE, info, "", "-p cameras:=")
        cameras.append(RecordedCamera(name, keypoints, _with_late_camera(bag, keypoints, found)))
    return cameras


def poses_in(cameras: Sequence[RecordedCamera]) -> dict[str, CameraPose] | None:
    """Return the poses of the cameras by name; None if TF gives them."""
    poses = {camera.name: camera.pose for camera in cameras if camera.pose is not None}
    return poses or None


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


def _of_file(bag: BagReader, file: Path, config: NodeSettings) -> list[RecordedCamera]:
    """Return the cameras with the lenses and the poses of a calibration file."""
    cameras, kind = [], full_type_name(config.keypoints_type)
    for name, (calibration, pose) in read_cameras(file, config.camera_names).items():
        keypoints = bag.find(kind, full_name(bag, topics.of_camera(topics.KEYPOINTS, name)), "", "-p cameras:=")
        source = _file_source(bag, file, calibration, name, config.rectified)
        cameras.append(RecordedCamera(name, keypoints, source, pose))
    return cameras


def _only_source(
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
    return _file_source(bag, file, read_calibration(file), "", rectified)


def _file_source(bag: BagReader, file: Path, calibration: Calibration, name: str, rectified: bool) -> CameraSource:
    try:
        info = calibration.message(RosbagsBackend(bag.types), 0, name, rectified)
    except CameraError as error:
        raise CameraError(f"{FILE_OPTION} '{file}': {error}") from None
    title = f"file {file}:{name}" if name else f"file {file}"
    return CameraSource(title, title, (), info)


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
