"""Messages of detectors whose packages are not part of Jazzy, with the definitions of msg_adapters."""

import numpy as np
from rosbags.typesys import Stores, get_typestore

from lassokin_ros.replay.bags import register_types
from msg_adapters.backends import RosbagsBackend
from msg_adapters.output_messages.builders import set_header

HRI, YOLO, ZED = "hri_msgs/msg/Skeleton2D", "yolo_msgs/msg/DetectionArray", "zed_msgs/msg/ObjectsStamped"


def detector_types():
    """A typestore of Jazzy with the definitions of these packages."""
    types = get_typestore(Stores.ROS2_JAZZY)
    register_types(types)
    return types


def hri_skeleton(backend, stamp_ns, frame_id, pixels, confidence, size):
    """pixels: (18, 2) px."""
    message = backend.make(HRI)
    set_header(message.header, stamp_ns, frame_id)
    for point, (x, y), score in zip(message.skeleton, np.asarray(pixels) / size, confidence):
        point.x, point.y, point.c = float(x), float(y), float(score)
    return message


def yolo_detections(backend, stamp_ns, frame_id, people, ids):
    """people: for each a pair of pixels (17, 2) and confidences (17,); points of confidence 0 are left out."""
    message = backend.make(YOLO)
    set_header(message.header, stamp_ns, frame_id)
    for (pixels, confidence), name in zip(people, ids):
        detection = backend.make("yolo_msgs/msg/Detection")
        detection.class_name, detection.id, detection.score = "person", name, 0.9
        for index in np.flatnonzero(np.asarray(confidence) > 0)[::-1].tolist():
            point = backend.make("yolo_msgs/msg/KeyPoint2D")
            point.id, point.score = index + 1, float(confidence[index])
            point.point.x, point.point.y = (float(value) for value in pixels[index])
            detection.keypoints.data.append(point)
        message.detections.append(detection)
    return message


def zed_objects(backend, stamp_ns, people, ids, body_format=2, tracked=True):
    """people: for each pixels (n, 2), NaN where not found; the confidence of all is 90."""
    message = backend.make(ZED)
    set_header(message.header, stamp_ns, "zed_left_camera_frame")
    for pixels, number in zip(people, ids):
        body = backend.make("zed_msgs/msg/Object")
        body.label, body.label_id, body.confidence = f"Body_{number}", number, 90.0
        body.skeleton_available, body.body_format, body.tracking_available = True, body_format, tracked
        body.tracking_state = 1 if tracked else 0
        for point, xy in zip(body.skeleton_2d.keypoints, pixels):
            point.kp = np.asarray(xy, dtype=np.float32)
        message.objects.append(body)
    return message


def backend():
    """A function that makes these messages."""
    return RosbagsBackend(detector_types())
