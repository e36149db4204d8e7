"""Message types of detectors whose packages Jazzy does not bring, as their repositories define them.

hri_msgs: github.com/ros4hri/hri_msgs. yolo_msgs: github.com/mgonzs13/yolo_ros. zed_msgs:
github.com/stereolabs/zed-ros2-interfaces. Field names, types and order; nothing else matters on the wire.
"""

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from msg_adapters.backends import RosbagsBackend
from msg_adapters.output_messages.builders import set_header

DEFINITIONS = {
    "hri_msgs/msg/NormalizedPointOfInterest2D": "float32 x\nfloat32 y\nfloat32 c",
    "hri_msgs/msg/Skeleton2D": "std_msgs/Header header\nhri_msgs/NormalizedPointOfInterest2D[18] skeleton",
    "hri_msgs/msg/IdsList": "std_msgs/Header header\nstring[] ids",
    "yolo_msgs/msg/Point2D": "float64 x\nfloat64 y",
    "yolo_msgs/msg/Vector2": "float64 x\nfloat64 y",
    "yolo_msgs/msg/Pose2D": "yolo_msgs/Point2D position\nfloat64 theta",
    "yolo_msgs/msg/BoundingBox2D": "yolo_msgs/Pose2D center\nyolo_msgs/Vector2 size",
    "yolo_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\nstring frame_id",
    "yolo_msgs/msg/Mask": "int32 height\nint32 width\nyolo_msgs/Point2D[] data",
    "yolo_msgs/msg/KeyPoint2D": "int32 id\nyolo_msgs/Point2D point\nfloat64 score",
    "yolo_msgs/msg/KeyPoint2DArray": "yolo_msgs/KeyPoint2D[] data",
    "yolo_msgs/msg/KeyPoint3D": "int32 id\ngeometry_msgs/Point point\nfloat64 score",
    "yolo_msgs/msg/KeyPoint3DArray": "yolo_msgs/KeyPoint3D[] data\nstring frame_id",
    "yolo_msgs/msg/Detection": (
        "int32 class_id\nstring class_name\nfloat64 score\nstring id\nyolo_msgs/BoundingBox2D bbox\n"
        "yolo_msgs/BoundingBox3D bbox3d\nyolo_msgs/Mask mask\nyolo_msgs/KeyPoint2DArray keypoints\n"
        "yolo_msgs/KeyPoint3DArray keypoints3d"
    ),
    "yolo_msgs/msg/DetectionArray": "std_msgs/Header header\nyolo_msgs/Detection[] detections",
    "zed_msgs/msg/Keypoint2Df": "float32[2] kp",
    "zed_msgs/msg/Keypoint2Di": "uint32[2] kp",
    "zed_msgs/msg/Keypoint3D": "float32[3] kp",
    "zed_msgs/msg/BoundingBox2Df": "zed_msgs/Keypoint2Df[4] corners",
    "zed_msgs/msg/BoundingBox2Di": "zed_msgs/Keypoint2Di[4] corners",
    "zed_msgs/msg/BoundingBox3D": "zed_msgs/Keypoint3D[8] corners",
    "zed_msgs/msg/Skeleton2D": "zed_msgs/Keypoint2Df[70] keypoints",
    "zed_msgs/msg/Skeleton3D": "zed_msgs/Keypoint3D[70] keypoints",
    "zed_msgs/msg/Object": (
        "string label\nint16 label_id\nstring sublabel\nfloat32 confidence\nfloat32[3] position\n"
        "float32[6] position_covariance\nfloat32[3] velocity\nbool tracking_available\nint8 tracking_state\n"
        "int8 action_state\nzed_msgs/BoundingBox2Di bounding_box_2d\nzed_msgs/BoundingBox3D bounding_box_3d\n"
        "float32[3] dimensions_3d\nbool skeleton_available\nint8 body_format\n"
        "zed_msgs/BoundingBox2Df head_bounding_box_2d\nzed_msgs/BoundingBox3D head_bounding_box_3d\n"
        "float32[3] head_position\nzed_msgs/Skeleton2D skeleton_2d\nzed_msgs/Skeleton3D skeleton_3d\n"
        "float32[70] skeleton_keypoint_confidence"
    ),
    "zed_msgs/msg/ObjectsStamped": "std_msgs/Header header\nzed_msgs/Object[] objects",
}
HRI, YOLO, ZED = "hri_msgs/msg/Skeleton2D", "yolo_msgs/msg/DetectionArray", "zed_msgs/msg/ObjectsStamped"


def detector_types():
    """A typestore of Jazzy with the definitions above."""
    types = get_typestore(Stores.ROS2_JAZZY)
    definitions = {}
    for name, text in DEFINITIONS.items():
        definitions.update(get_types_from_msg(text, name))
    types.register(definitions)
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
    """A maker of these messages."""
    return RosbagsBackend(detector_types())
