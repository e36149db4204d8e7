"""Input messages for the tests, for message objects of rclpy and of rosbags."""

from array import array

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.demo.synthetic import motion
from msg_adapters.backends import RclpyBackend, RosbagsBackend
from msg_adapters.output_messages.builders import set_header

FOCAL, WIDTH, HEIGHT = 600.0, 640, 480
FRAME = "camera_optical_frame_of_test"
CLOUD_FIELDS = (("x", 0, 7), ("y", 4, 7), ("confidence", 8, 7), ("id", 12, 6))
CLOUD_DTYPE = np.dtype([("x", "<f4"), ("y", "<f4"), ("confidence", "<f4"), ("id", "<u4")])


def rosbags_backend():
    """A backend over rosbags' Jazzy types."""
    from rosbags.typesys import Stores, get_typestore

    return RosbagsBackend(get_typestore(Stores.ROS2_JAZZY))


def bytes_field(backend, data: bytes):
    """The content of a uint8[] field."""
    return array("B", data) if isinstance(backend, RclpyBackend) else np.frombuffer(data, np.uint8)


def pixels_of_motion(
    count: int, hz: float = 60.0, seed: int = 0, noise_px: float = 1.0, layout: str = "coco17"
) -> np.ndarray:
    """(count, l, 2) px: keypoints of the synthetic motion, with a detector's noise."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinematics = Kinematics(skeleton, Layout.load(layout, skeleton))
    landmarks = kinematics.pose(motion(skeleton, np.arange(count) / hz)).landmarks
    noise = np.random.default_rng(seed).normal(size=landmarks.shape[:-1] + (2,)) * noise_px
    return project(landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2] + noise


def camera_info(backend, focal: float = FOCAL, frame_id: str = FRAME, **fields):
    """A CameraInfo without distortion; `fields` replaces d, distortion_model and so on."""
    message = backend.make("sensor_msgs/msg/CameraInfo")
    set_header(message.header, 0, frame_id)
    message.width, message.height = WIDTH, HEIGHT
    message.k = np.array([focal, 0, WIDTH / 2, 0, focal, HEIGHT / 2, 0, 0, 1.0])
    message.r = np.eye(3).ravel()
    message.p = np.array([focal, 0, WIDTH / 2, 0, 0, focal, HEIGHT / 2, 0, 0, 0, 1.0, 0])
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def cloud(backend, stamp_ns, xy, confidence=None, ids=None, frame_id=FRAME):
    """Keypoints as PointCloud2."""
    points = np.zeros(len(xy), CLOUD_DTYPE)
    points["x"], points["y"] = np.asarray(xy, dtype=float).reshape(-1, 2).T
    points["confidence"] = 0.9 if confidence is None else confidence
    points["id"] = np.arange(len(xy)) if ids is None else ids
    return raw_cloud(backend, stamp_ns, points.tobytes(), CLOUD_FIELDS, 16, len(xy), frame_id)


def with_depths(backend, message, depth):
    """The same cloud with the field `depth` (l,) m."""
    points = np.frombuffer(bytes(message.data), CLOUD_DTYPE)
    wider = np.zeros(len(points), [*CLOUD_DTYPE.descr, ("depth", "<f4")])
    for name in CLOUD_DTYPE.names:
        wider[name] = points[name]
    wider["depth"] = depth
    field = backend.make("sensor_msgs/msg/PointField")
    field.name, field.offset, field.datatype, field.count = "depth", CLOUD_DTYPE.itemsize, 7, 1
    message.fields = [*message.fields, field]
    message.point_step, message.row_step = wider.itemsize, wider.nbytes
    message.data = bytes_field(backend, wider.tobytes())
    return message


def crowd(backend, stamp_ns, people, persons=None, frame_id=FRAME):
    """A PointCloud2 of several people: pairs of pixels (l, 2) and confidences (l,), numbered as in `persons`."""
    dtype = np.dtype([*CLOUD_DTYPE.descr, ("person", "<i4")])
    rows = []
    for (xy, confidence), person in zip(people, range(len(people)) if persons is None else persons):
        points = np.zeros(len(xy), dtype)
        points["x"], points["y"] = np.asarray(xy, dtype=float).T
        points["confidence"], points["id"], points["person"] = confidence, np.arange(len(xy)), person
        rows.append(points[points["confidence"] > 0])
    data = np.concatenate([np.zeros(0, dtype), *rows])
    fields = (*CLOUD_FIELDS, ("person", 16, 5))
    return raw_cloud(backend, stamp_ns, data.tobytes(), fields, dtype.itemsize, len(data), frame_id)


def raw_cloud(backend, stamp_ns, data, fields, point_step, width, frame_id=FRAME):
    """A PointCloud2 of any fields (name, offset, datatype), unorganised."""
    message = backend.make("sensor_msgs/msg/PointCloud2")
    set_header(message.header, stamp_ns, frame_id)
    message.height, message.width, message.point_step, message.row_step = 1, width, point_step, point_step * width
    descriptions = []
    for name, offset, datatype in fields:
        field = backend.make("sensor_msgs/msg/PointField")
        field.name, field.offset, field.datatype, field.count = name, offset, datatype, 1
        descriptions.append(field)
    message.fields = descriptions
    message.data = bytes_field(backend, data)
    return message


def polygon(backend, stamp_ns, xy, confidence=None, frame_id=FRAME):
    """Keypoints as PolygonStamped."""
    message = backend.make("geometry_msgs/msg/PolygonStamped")
    set_header(message.header, stamp_ns, frame_id)
    scores = np.full(len(xy), 0.9) if confidence is None else confidence
    points = []
    for (x, y), score in zip(np.asarray(xy).tolist(), np.asarray(scores).tolist()):
        point = backend.make("geometry_msgs/msg/Point32")
        point.x, point.y, point.z = x, y, score
        points.append(point)
    message.polygon.points = points
    return message


def multi_array(backend, stamp_ns, xy, confidence=None, kind="std_msgs/msg/Float32MultiArray"):
    """Keypoints as Float32MultiArray or Float64MultiArray, which have no stamp."""
    message, code = backend.make(kind), "f" if "32" in kind else "d"
    scores = np.full(len(xy), 0.9) if confidence is None else confidence
    values = np.column_stack([xy, scores]).astype(code).ravel()
    message.data = array(code, values.tobytes()) if isinstance(backend, RclpyBackend) else values
    return message


CARRIERS = {
    "sensor_msgs/msg/PointCloud2": cloud,
    "geometry_msgs/msg/PolygonStamped": polygon,
    "std_msgs/msg/Float32MultiArray": multi_array,
}
