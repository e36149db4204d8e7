"""Recordings for the replay tests, and their content."""

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.demo.synthetic import WEBCAM, detections, exact_pixels, motion
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.replay.bag_writer import BagWriter
from lassokin_ros.replay.bags import BagReader, typestore
from lassokin_ros.replay.keypoint_recording import write_keypoint_recording
from msg_adapters.backends import RosbagsBackend
from msg_adapters.inputs import camera_info, point_cloud

RATE, START_NS = 30.0, 1_700_000_000_000_000_000
CLOUD, INFO = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/CameraInfo"


def synthetic_pixels(frames, seed=0):
    """Stamps in ns, detected pixels and confidences of the synthetic motion at 30 Hz."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinematics = Kinematics(skeleton, Layout.load("coco17", skeleton))
    times = np.arange(frames) / RATE
    pixels, confidence = detections(exact_pixels(kinematics, motion(skeleton, times)), RATE, seed)
    return START_NS + np.round(times * 1e9).astype(np.int64), pixels, confidence


def write_recording(path, frames=60, storage="mcap", spoil=None):
    """A recording of the synthetic motion; spoil(stamps, pixels, confidence) changes it in place."""
    stamps, pixels, confidence = synthetic_pixels(frames)
    if spoil is not None:
        spoil(stamps, pixels, confidence)
    write_keypoint_recording(path, stamps, pixels, confidence, WEBCAM.K, WEBCAM.D, WEBCAM.size, storage=storage)
    return path


def write_messages(path, messages, storage="mcap", types=None):
    """A recording of any messages (topic, type, time in ns, message or bytes); types: of rosbags, default Jazzy's."""
    types = types or typestore()
    with BagWriter(path, storage, types) as writer:
        for topic, message_type, time_ns, message in messages:
            write = writer.write_raw if isinstance(message, bytes) else writer.write
            write(topic, message_type, time_ns, message)
    return path


def clouds(frames, frame_id="camera_optical_frame", topic="/keypoints", spoil=None, times=None):
    """Keypoint messages (topic, type, time in ns, message) of the synthetic motion, see `write_recording`.

    times: returns the recording times for the stamps, which are the same otherwise.
    """
    backend, (stamps, pixels, confidence) = RosbagsBackend(typestore()), synthetic_pixels(frames)
    recorded = stamps.copy() if times is None else times(stamps.copy())
    if spoil is not None:
        spoil(stamps, pixels, confidence)
    for time_ns, stamp_ns, *seen in zip(recorded.tolist(), stamps.tolist(), pixels, confidence):
        yield topic, CLOUD, time_ns, point_cloud(backend, stamp_ns, frame_id, *seen)


def beginning_of(video, path, frames):
    """The first images of a video, as a file."""
    import cv2

    images = cv2.VideoCapture(str(video))
    size = tuple(int(images.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), images.get(cv2.CAP_PROP_FPS), size)
    for _ in range(frames):
        writer.write(images.read()[1])
    writer.release()
    return path


def webcam_info(stamp_ns=START_NS, frame_id="camera_optical_frame"):
    """A camera_info of the webcam, for rosbags."""
    return camera_info(RosbagsBackend(typestore()), stamp_ns, frame_id, WEBCAM.K, WEBCAM.D, WEBCAM.size)


def read(path, topic):
    """[(time of recording in ns, message)] of one topic."""
    with BagReader(path) as bag:
        chosen = [t for t in bag.topics if t.name == topic]
        return [(time_ns, message) for _, time_ns, message in bag.messages(chosen)]


def contents(folder):
    """Bytes of every file below a folder, by relative path."""
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


FRAME_TOPICS = {f"/{topic.name}".replace("/~", "/tracker"): topic.message_type for topic in topics.FRAME_OUTPUTS}
"""Full name -> type of the topics that have one message per accepted frame."""
