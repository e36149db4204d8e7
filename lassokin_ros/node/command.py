"""The commands of the nodes: keypoints to a skeleton, images to keypoints, a webcam to images, a person to a robot."""

from __future__ import annotations

import sys

from lassokin_ros.node.executable import node_command

tracker = node_command(
    "tracker",
    "Track 2D keypoints with camera_info, and publish a 3D skeleton with joint angles.",
    "-p height:=1.80 --params-file FILE -r keypoints:=/detector/keypoints",
    "lassokin_ros.node.node:TrackerNode",
)
detector = node_command(
    "detector",
    "Detect a person in images, and publish 2D keypoints.",
    "-p detector:=mediapipe -r image_raw:=/camera/image_raw",
    "lassokin_ros.detector.node:DetectorNode",
)
camera = node_command(
    "camera",
    "Publish a webcam, a video file or a folder of images as image_raw and camera_info.",
    "-p source:=0 -p fov:=70.0",
    "lassokin_ros.camera.node:CameraNode",
)
imitate = node_command(
    "imitate",
    "Publish joint_commands of a humanoid that imitates the person of a tracker, once enabled.",
    "-p robot:=g1; the URDF comes on the topic robot_description",
    "lassokin_ros.robot.node:ImitateNode",
)

if __name__ == "__main__":
    sys.exit(tracker())
