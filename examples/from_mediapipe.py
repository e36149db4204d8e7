"""A video's skeleton from MediaPipe Pose, without ROS: python3 from_mediapipe.py walk.mp4 1.72 (height in m)."""

import sys

import cv2
import mediapipe
import numpy as np

from lassokin_ros import Lens, Tracker, TrackerConfig, observation_from_pixels

video, height = cv2.VideoCapture(sys.argv[1]), float(sys.argv[2])
video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)  # a phone's video is turned, which OpenCV 4.11 does not do by default
size = np.array([video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)])
focal = size.max() / 2 / np.tan(np.radians(60) / 2)  # px, for a field of view of 60 degrees along the longer side
lens = Lens(np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]]), size=size)
tracker, pose = Tracker(TrackerConfig(height=height, landmarks="mediapipe33")), mediapipe.solutions.pose.Pose()
while (image := video.read()[1]) is not None:
    found = pose.process(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)).pose_landmarks
    points = np.array([(p.x, p.y, p.visibility) for p in found.landmark]) if found else np.zeros((33, 3))
    points[((points < 0) | (points > 1)).any(axis=1), 2] = 0  # outside of the image MediaPipe guesses
    seconds = video.get(cv2.CAP_PROP_POS_MSEC) / 1000
    estimate = tracker.track(observation_from_pixels(seconds, points * [*size, 1], lens))
    print(f"{seconds:.2f} s", estimate.pose.positions[0].round(2) if estimate.accepted else estimate.rejection)
