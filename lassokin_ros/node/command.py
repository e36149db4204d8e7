"""The command `tracker`: 2D keypoints to a 3D skeleton on ROS topics."""

from __future__ import annotations

import sys

from lassokin_ros.node.executable import node_command

tracker = node_command(
    "tracker",
    "Track 2D keypoints with camera_info, and publish a 3D skeleton with joint angles.",
    "-p height:=1.80 --params-file FILE -r keypoints:=/detector/keypoints",
    "lassokin_ros.node.node:TrackerNode",
)

if __name__ == "__main__":
    sys.exit(tracker())
