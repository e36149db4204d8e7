"""The command `camera`: images of a webcam or of a video file on ROS topics."""

from __future__ import annotations

import sys

from lassokin_ros.node.executable import node_command

main = node_command(
    "camera",
    "Publish a webcam, a video file or a folder of images as image_raw and camera_info.",
    "-p source:=0 -p fov:=70.0",
    "lassokin_ros.camera.node:CameraNode",
)

if __name__ == "__main__":
    sys.exit(main())
