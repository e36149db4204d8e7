"""The command `detector`: images to 2D keypoints on ROS topics."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from lassokin_ros.node.executable import node_command

_run = node_command(
    "detector",
    "Detect a person in images, and publish 2D keypoints.",
    "-p detector:=mediapipe -r image_raw:=/camera/image_raw",
    "lassokin_ros.detector.node:DetectorNode",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the detector node, see `node_command`. MediaPipe writes nothing to stderr beside our lines."""
    os.environ.setdefault("GLOG_minloglevel", "3")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    return _run(arguments)


if __name__ == "__main__":
    sys.exit(main())
