"""The demo's motion with a second camera, which looks from the side."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import DISTANCE, WEBCAM, detections


def side_camera() -> CameraPose:
    """Return the pose of a camera that looks at the person from 90 degrees to the side, in the first one's frame."""
    turn, middle = exponential(np.array([[0.0, np.pi / 2, 0.0]]))[0], np.array([0.0, 0.0, DISTANCE])
    return CameraPose("side", turn, middle - turn @ middle)


def track_with_second_camera(
    states: BodyState, times: np.ndarray, pixels: np.ndarray, confidence: np.ndarray
) -> np.ndarray:
    """Return the joints (f, n, 3) m, first camera's frame, tracked with a second camera's keypoints, too.

    states: the true motion (f, ...); times: (f,) s; pixels: (f, l, 2) px and confidence (f, l) of the first camera's
    detector. The second one has the same lens and detector.
    """
    tracker, lens = Tracker(TrackerConfig()), WEBCAM.lens
    front, side = CameraPose("front"), side_camera()
    seen = project(side.into_camera(tracker.kinematics.pose(states).landmarks))
    exact = lens.distort(seen.reshape(-1, 2)).reshape(seen.shape)
    views = [(front, pixels, confidence), (side, *detections(exact, 1 / float(np.diff(times).mean()), seed=2))]
    joints = np.full((len(times), tracker.skeleton.joint_count, 3), np.nan)
    for frame, stamp in enumerate(times.tolist()):
        estimate = tracker.track(
            [
                Observation(stamp, lens.normalise(found[frame]), sure[frame], lens.focal, camera=camera)
                for camera, found, sure in views
            ]
        )
        if estimate.pose is not None:
            joints[frame] = estimate.pose.positions
        elif frame:
            joints[frame] = joints[frame - 1]
    return joints
