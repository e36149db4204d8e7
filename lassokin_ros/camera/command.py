"""The command `camera`: images of a webcam or of a video file on ROS topics."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any

from lassokin_ros.node.executable import run_node


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the camera node until SIGINT or SIGTERM. The exit code is 0, or 2 if the node cannot start."""
    return run_node(_parser(), _load, arguments)


def _load() -> Callable[[], Any]:
    from lassokin_ros.camera.node import CameraNode

    return CameraNode


def _parser() -> argparse.ArgumentParser:
    return argparse.ArgumentParser(
        prog="camera",
        description="Publish a webcam, a video file or a folder of images as image_raw and camera_info.",
        epilog="ROS arguments follow --ros-args: -p source:=0 -p fov:=70.0",
    )


if __name__ == "__main__":
    sys.exit(main())
