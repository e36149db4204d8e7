"""The command `tracker`: 2D keypoints to a 3D skeleton on ROS topics."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any

from lassokin_ros.node.executable import run_node


def tracker(arguments: Sequence[str] | None = None) -> int:
    """Run the tracker node until SIGINT or SIGTERM. The exit code is 0, or 2 if the node cannot start."""
    return run_node(_parser(), _load, arguments)


def _load() -> Callable[[], Any]:
    from lassokin_ros.node.node import TrackerNode

    return TrackerNode


def _parser() -> argparse.ArgumentParser:
    return argparse.ArgumentParser(
        prog="tracker",
        description="Track 2D keypoints with camera_info, and publish a 3D skeleton with joint angles.",
        epilog="ROS arguments follow --ros-args: -p height:=1.80 --params-file FILE -r keypoints:=/detector/keypoints",
    )


if __name__ == "__main__":
    sys.exit(tracker())
