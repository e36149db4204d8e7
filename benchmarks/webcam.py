"""The live chain on real DDS: images of a video at a constant rate, detector, tracker, joints.

    python -m benchmarks.webcam VIDEO [--rate 30] [--height 1.72] [--detector mediapipe]

Prints latency from the image's publication to the arrival of `joints` with its stamp, and the share of dropped images.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time

import numpy as np

GRACE_S = 10.0
LONGEST_START_S = 60.0


def main() -> int:
    """Run the chain and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("video")
    parser.add_argument("--rate", type=float, default=30.0, help="images per second")
    parser.add_argument("--side", type=int, default=640, help="longer side of the published images, px")
    parser.add_argument("--height", type=float, default=1.75, help="m")
    parser.add_argument("--detector", default="mediapipe")
    options = parser.parse_args()
    os.environ.setdefault("ROS_DOMAIN_ID", "87")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    from lassokin_ros.core.errors import LassokinError
    from lassokin_ros.detector.backend import make_detector

    try:
        layout = make_detector(options.detector).landmarks
        commands = [
            ["lassokin_ros.detector.command", f"detector:={options.detector}"],
            ["lassokin_ros.node.command", f"height:={options.height}", f"landmarks:={layout}"],
        ]
        processes = [start(*command) for command in commands]
        try:
            sent, came = play(options)
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
            codes = [process.wait(GRACE_S) for process in processes]
    except LassokinError as error:
        print(f"webcam: {error}", file=sys.stderr)
        return 2
    latency = 1e3 * np.array([came[stamp] - sent[stamp] for stamp in came if stamp in sent])
    answered = len(latency)
    print("| images | rate, Hz | joints | dropped | latency p50, ms | p99, ms | exit codes |")
    print("|---|---|---|---|---|---|---|")
    p50, p99 = np.percentile(latency, [50, 99]) if answered else (np.nan, np.nan)
    dropped = 100 * (1 - answered / len(sent))
    print(f"| {len(sent)} | {options.rate:g} | {answered} | {dropped:.1f} % | {p50:.1f} | {p99:.1f} | {codes} |")
    return 0 if answered else 1


def start(module: str, *parameters: str) -> subprocess.Popen:
    """Start a node."""
    arguments = [part for parameter in parameters for part in ("-p", parameter)]
    return subprocess.Popen([sys.executable, "-m", module, "--ros-args", *arguments])


def play(options: argparse.Namespace) -> tuple[dict[int, float], dict[int, float]]:
    """Publish the images; return the times of publication and of arrival by stamp, s."""
    import cv2
    import rclpy
    from geometry_msgs.msg import PoseArray
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import CameraInfo, Image

    from lassokin_ros.video.camera import DEFAULT_FOV, from_fov
    from lassokin_ros.video.sources import open_source
    from msg_adapters.backends import RclpyBackend
    from msg_adapters.inputs import camera_info

    source = open_source(options.video)
    scale = min(1.0, options.side / max(source.size))
    size = round(source.size[0] * scale), round(source.size[1] * scale)
    images = [cv2.resize(image.rgb, size) for image in source.images]
    camera = from_fov(DEFAULT_FOV, size)
    rclpy.init()
    node = rclpy.create_node("camera")
    sent: dict[int, float] = {}
    came: dict[int, float] = {}

    def on_joints(message: PoseArray) -> None:
        came[message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec] = time.monotonic()

    node.create_subscription(PoseArray, "/tracker/joints", on_joints, 100)
    image_out = node.create_publisher(Image, "image_raw", qos_profile_sensor_data)
    info_out = node.create_publisher(CameraInfo, "camera_info", 10)

    def publish(rgb: np.ndarray) -> int:
        now = time.time_ns()
        message = Image(height=rgb.shape[0], width=rgb.shape[1], step=3 * rgb.shape[1], encoding="rgb8")
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
        message.header.frame_id = "camera_optical_frame"
        message.data.frombytes(rgb.tobytes())
        backend, frame = RclpyBackend(), message.header.frame_id
        info_out.publish(camera_info(backend, now, frame, camera.K, camera.D, size))
        sent[now] = time.monotonic()
        image_out.publish(message)
        return now

    try:
        deadline = time.monotonic() + LONGEST_START_S
        while not came and time.monotonic() < deadline:
            publish(images[0])
            rclpy.spin_once(node, timeout_sec=0.3)
        time.sleep(1.0)
        sent.clear()
        began = time.monotonic()
        for number, rgb in enumerate(images):
            while (left := began + number / options.rate - time.monotonic()) > 0:
                rclpy.spin_once(node, timeout_sec=left)
            publish(rgb)
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.1)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return sent, came


if __name__ == "__main__":
    sys.exit(main())
