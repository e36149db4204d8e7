"""The command `detector`: images to 2D keypoints on ROS topics."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

from lassokin_ros.node.executable import run_node


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the detector node until SIGINT or SIGTERM. The exit code is 0, or 2 if the node cannot start."""
    os.environ.setdefault("GLOG_minloglevel", "3")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    return run_node(_parser(), _load, arguments)


def _load() -> Callable[[], Any]:
    from lassokin_ros.detector.node import DetectorNode

    return DetectorNode


def _parser() -> argparse.ArgumentParser:
    return argparse.ArgumentParser(
        prog="detector",
        description="Detect a person in images, and publish 2D keypoints.",
        epilog="ROS arguments follow --ros-args: -p detector:=mediapipe -r image_raw:=/camera/image_raw",
    )


if __name__ == "__main__":
    sys.exit(main())
