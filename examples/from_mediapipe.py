"""A video's skeleton from MediaPipe Pose, without ROS: python3 from_mediapipe.py walk.mp4 1.72 (height in m)."""

import sys

import cv2
import numpy as np

from lassokin_ros import Lens, Tracker, TrackerConfig, observation_from_pixels
from lassokin_ros.detector.backend import make_detector

video, height = cv2.VideoCapture(sys.argv[1]), float(sys.argv[2])
video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)  # a phone's video is turned, which OpenCV 4.11 does not do by default
size = np.array([video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)])
focal = size.max() / 2 / np.tan(np.radians(60) / 2)  # px, for a field of view of 60 degrees along the longer side
lens = Lens(np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]]), size=size)
tracker, detector = Tracker(TrackerConfig(height=height, landmarks="mediapipe33")), make_detector("mediapipe")
while (image := video.read()[1]) is not None:
    seconds = video.get(cv2.CAP_PROP_POS_MSEC) / 1000
    found = detector.detect(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), seconds)
    points = np.column_stack([found[0].pixels, found[0].confidence]) if found else np.zeros((33, 3))
    points[((points[:, :2] < 0) | (points[:, :2] > size)).any(axis=1), 2] = 0  # outside of the image MediaPipe guesses
    estimate = tracker.track(observation_from_pixels(seconds, points, lens))
    print(f"{seconds:.2f} s", estimate.pose.positions[0].round(2) if estimate.accepted else estimate.rejection)
detector.close()
