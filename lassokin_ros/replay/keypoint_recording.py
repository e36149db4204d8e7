"""Write a detector's output as a rosbag2 recording: keypoints (PointCloud2) and camera_info."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.settings import OPTICAL_FRAME
from lassokin_ros.replay.bag_writer import BagWriter
from lassokin_ros.replay.bags import typestore
from msg_adapters.backends import RosbagsBackend
from msg_adapters.inputs import camera_info, point_cloud

KEYPOINTS, CAMERA_INFO = f"/{topics.KEYPOINTS}", f"/{topics.CAMERA_INFO}"
KEYPOINTS_TYPE = "sensor_msgs/msg/PointCloud2"


def write_keypoint_recording(
    path: Path,
    stamps_ns: np.ndarray,
    pixels: np.ndarray,
    confidence: np.ndarray,
    K: np.ndarray,
    D: np.ndarray,
    size: tuple[int, int],
    frame_id: str = OPTICAL_FRAME,
    storage: str = "mcap",
    replace: bool = False,
) -> None:
    """Write one recording. A camera_info message precedes the keypoints of each image and has the same stamp.

    stamps_ns: (f,) ns. pixels: (f, l, 2) px of the raw image. confidence: (f, l), 0 = missing. K: (3, 3) px.
    D: plumb_bob coefficients. size: (width, height) px. Raises BagError if the recording cannot be written.
    """
    types = typestore()
    backend = RosbagsBackend(types)
    with BagWriter(path, storage, types, replace) as writer:
        for stamp, points, scores in zip(stamps_ns.tolist(), pixels, confidence):
            camera = camera_info(backend, stamp, frame_id, K, D, size)
            writer.write(CAMERA_INFO, topics.CAMERA_INFO_TYPE, stamp, camera)
            writer.write(KEYPOINTS, KEYPOINTS_TYPE, stamp, point_cloud(backend, stamp, frame_id, points, scores))
