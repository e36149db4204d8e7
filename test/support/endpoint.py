"""A process that the tests may stop or kill: a source of keypoints, or a subscriber of everything.

python test/support/endpoint.py source|sink NAMESPACE
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import rclpy  # noqa: E402
from live import BACKEND  # noqa: E402
from messages import camera_info, cloud, pixels_of_motion  # noqa: E402

from lassokin_ros.node.message_types import message_class  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402

RATE = 60.0


def source(node):
    """Keypoints and camera_info at `RATE`, stamped with the time of sending."""
    keypoints = node.create_publisher(message_class("sensor_msgs/msg/PointCloud2"), topics.KEYPOINTS, 10)
    camera = node.create_publisher(message_class(topics.CAMERA_INFO_TYPE), topics.CAMERA_INFO, 10)
    pixels, sent = pixels_of_motion(120, RATE), iter(range(sys.maxsize))

    def send():
        camera.publish(camera_info(BACKEND))
        keypoints.publish(cloud(BACKEND, time.time_ns(), pixels[next(sent) % len(pixels)]))

    node.create_timer(1 / RATE, send)


def sink(node):
    """A reliable subscription on every output of a frame."""
    for topic in topics.FRAME_OUTPUTS:
        name = topic.name.replace("~", "tracker")
        node.create_subscription(message_class(topic.message_type), name, lambda message: None, 10)
    print("ready", flush=True)


if __name__ == "__main__":
    rclpy.init()
    endpoint = rclpy.create_node(sys.argv[1], namespace=sys.argv[2])
    {"source": source, "sink": sink}[sys.argv[1]](endpoint)
    rclpy.spin(endpoint)
