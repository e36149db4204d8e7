"""The live chain on real DDS: images of a video at a constant rate, detector, tracker, joints.

    python -m benchmarks.webcam VIDEO [--rate 30] [--images 600] [--height 1.72] [--detector mediapipe] [--json FILE]

The nodes `detector` and `tracker` run as processes. The video is played forwards and backwards until all images are
published. Latencies are those between publication and arrival in this process, by the images' stamps.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from itertools import chain, cycle, islice
from typing import Any, Sequence

import numpy as np

from benchmarks.common.option_types import command_line, count, positive
from benchmarks.common.report import Record, exit_code, table, write_json

GRACE_S, LONGEST_START_S, QUIET_S = 10.0, 60.0, 2.0
COLUMNS = {"leg": "<", "in": "d", "out": "d", "dropped_percent": ".1f", "p50_ms": ".1f", "p99_ms": ".1f"}


@dataclass
class Times:
    """Times by stamp, s: publication of the images, arrival of the keypoints, and of the joints."""

    images: dict[int, float] = field(default_factory=dict)
    keypoints: dict[int, float] = field(default_factory=dict)
    joints: dict[int, float] = field(default_factory=dict)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the chain and print the table; exit code 1 if nothing came out, or if a node failed."""
    options = _parser().parse_args(arguments)
    os.environ.setdefault("ROS_DOMAIN_ID", "87")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    from lassokin_ros.detector.backend import make_detector
    from lassokin_ros.video.sources import open_source

    detector = make_detector(options.detector)
    layout = detector.landmarks
    detector.close()
    source = open_source(options.video)  # what cannot be opened is refused before the nodes start
    detector_node = start("detector", f"detector:={options.detector}")
    tracker_node = start("tracker", f"height:={options.height}", f"landmarks:={layout}")
    try:
        times = play(source, options)
    finally:
        codes = [stop(process) for process in (detector_node, tracker_node)]
    records = legs(times)
    print(f"{source.name} at {options.rate:g} Hz, {options.side} px; exit codes of detector and tracker: {codes}")
    print(table(records, COLUMNS))
    strangers = set(times.joints) - set(times.images)
    print(f"joints whose stamp is none of an image: {len(strangers)}")
    write_json(options.json, records)
    return 0 if times.joints and not strangers and codes == [0, 0] else 1


def _parser() -> argparse.ArgumentParser:
    result = command_line(__doc__)
    result.add_argument("video")
    result.add_argument("--rate", type=positive, default=30.0, help="images per second (30)")
    result.add_argument("--images", type=count, default=600, help="number of images (600)")
    result.add_argument("--side", type=count, default=640, help="longer side of the published images, px (640)")
    result.add_argument("--height", type=positive, default=1.75, help="of the person, m (1.75)")
    result.add_argument("--detector", default="mediapipe", help="mediapipe (default), or an ONNX file")
    return result


def legs(times: Times) -> list[Record]:
    """Return one record per leg of the chain."""
    ends = {
        "image to keypoints (detector)": (times.images, times.keypoints),
        "keypoints to joints (tracker)": (times.keypoints, times.joints),
        "image to joints": (times.images, times.joints),
    }
    return [_leg(name, *pair) for name, pair in ends.items()]


def _leg(name: str, sent: dict[int, float], came: dict[int, float]) -> Record:
    """Return latency and loss from one topic to another. With nothing sent the figures are NaN."""
    latency = 1e3 * np.array([came[stamp] - sent[stamp] for stamp in came if stamp in sent])
    p50, p99 = np.percentile(latency, [50, 99]) if len(latency) else (np.nan, np.nan)
    dropped = 100 * (1 - len(latency) / len(sent)) if sent else np.nan
    figures = {"dropped_percent": float(dropped), "p50_ms": float(p50), "p99_ms": float(p99)}
    return {"leg": name, "in": len(sent), "out": len(latency), **figures}


def start(command: str, *parameters: str) -> subprocess.Popen:
    """Start a node."""
    arguments = [part for parameter in parameters for part in ("-p", parameter)]
    return subprocess.Popen([sys.executable, "-m", "lassokin_ros.cli.lassokin", command, "--ros-args", *arguments])


def stop(process: subprocess.Popen) -> int:
    """Interrupt a node, or kill it if it does not end; return its exit code."""
    process.send_signal(signal.SIGINT)
    try:
        return process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def play(source: Any, options: argparse.Namespace) -> Times:
    """Publish the images at a constant rate and return the times. SystemExit if the nodes do not answer."""
    import cv2
    import rclpy

    scale = min(1.0, options.side / max(source.size))
    size = round(source.size[0] * scale), round(source.size[1] * scale)
    images = [cv2.resize(image.rgb, size) for image in islice(source.images, options.images)]
    rclpy.init()
    camera = Camera(size)
    try:
        deadline = time.monotonic() + LONGEST_START_S
        while not camera.times.joints:
            if time.monotonic() > deadline:
                raise SystemExit(f"no joints came within {LONGEST_START_S:g} s")
            camera.publish(images[0])
            camera.spin(0.3)
        camera.spin(QUIET_S)
        camera.forget()
        began = time.monotonic()
        for number, rgb in enumerate(islice(cycle(chain(images, reversed(images))), options.images)):
            camera.spin(began + number / options.rate - time.monotonic())
            camera.publish(rgb)
        camera.spin(QUIET_S)
    finally:
        camera.node.destroy_node()
        rclpy.try_shutdown()
    return camera.times


class Camera:
    """Publishes images and records when keypoints and joints arrive."""

    def __init__(self, size: tuple[int, int]) -> None:
        """size: (width, height) px."""
        import rclpy
        from geometry_msgs.msg import PoseArray
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import CameraInfo, Image, PointCloud2

        from lassokin_ros.video.camera import DEFAULT_FOV, from_fov
        from msg_adapters.backends import RclpyBackend

        self._rclpy, self._size, self._camera = rclpy, size, from_fov(DEFAULT_FOV, size)
        self._backend, self.times = RclpyBackend(), Times()
        self.node = rclpy.create_node("camera")
        self.node.create_subscription(PointCloud2, "keypoints", self._arrival("keypoints"), qos_profile_sensor_data)
        self.node.create_subscription(PoseArray, "/tracker/joints", self._arrival("joints"), 100)
        self._images = self.node.create_publisher(Image, "image_raw", qos_profile_sensor_data)
        self._infos = self.node.create_publisher(CameraInfo, "camera_info", 10)

    def _arrival(self, topic: str) -> Any:
        def arrived(message: Any) -> None:
            stamp = message.header.stamp
            getattr(self.times, topic)[stamp.sec * 1_000_000_000 + stamp.nanosec] = time.monotonic()

        return arrived

    def publish(self, rgb: np.ndarray) -> None:
        """Publish an image and its camera_info."""
        from msg_adapters.inputs import camera_info, rgb_image

        now_ns, frame = time.time_ns(), "camera_optical_frame"
        self._infos.publish(camera_info(self._backend, now_ns, frame, self._camera.K, self._camera.D, self._size))
        message = rgb_image(self._backend, now_ns, frame, rgb)
        self.times.images[now_ns] = time.monotonic()
        self._images.publish(message)

    def spin(self, seconds: float) -> None:
        """Receive for this long; at least what has arrived."""
        end = time.monotonic() + seconds
        while True:
            self._rclpy.spin_once(self.node, timeout_sec=max(end - time.monotonic(), 0.0))
            if time.monotonic() >= end:
                return

    def forget(self) -> None:
        """Forget the times so far."""
        for times in vars(self.times).values():
            times.clear()


if __name__ == "__main__":
    sys.exit(exit_code(main))
