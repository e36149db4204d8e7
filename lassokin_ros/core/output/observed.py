"""Which joints the keypoints of one frame observe. The pose prior alone places the others."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton


class ObservedJoints:
    """Determines which joints are observed: those with a visible keypoint, or between two neighbours with one.

    An elbow between a visible shoulder and a visible wrist is observed; a hand beyond the last visible keypoint is not.
    """

    def __init__(self, skeleton: Skeleton, landmark_joints: np.ndarray) -> None:
        """landmark_joints: (l,) index of the joint to which each landmark is attached."""
        count = skeleton.joint_count
        # Numbers of keypoints and joints are floats: products of integers take twice as long.
        self._below = skeleton.ancestors.T.astype(float)
        self._attached = np.zeros((count, len(landmark_joints)))
        self._attached[landmark_joints, np.arange(len(landmark_joints))] = 1
        turned = skeleton.ancestors.T & ~np.eye(count, dtype=bool)
        turned |= np.diag(~turned.any(axis=1))  # an end: its own keypoints
        #: (n, l) number of keypoints, 0 or 1, that show how each joint is turned.
        self._shows = turned @ self._attached
        self._neighbours = np.zeros((count, count))
        child = np.flatnonzero(skeleton.parents >= 0)
        parent = skeleton.parents[child]
        self._neighbours[child, parent] = self._neighbours[parent, child] = 1

    def from_visible(self, visible: np.ndarray) -> np.ndarray:
        """Return (n,) bool. visible: (l,) bool, the keypoints of the frame that have a weight, `Estimate.visible`."""
        own = self._attached.dot(visible) > 0
        return np.asarray(own | (self._neighbours.dot(own) >= 2))

    def below_last_keypoint(self, visible: np.ndarray) -> np.ndarray:
        """Return (n,) bool: no visible keypoint is attached to the joint or to a joint below it."""
        return np.asarray(self._below.dot(self._attached.dot(visible)) == 0)

    def beyond_last_keypoint(self, visible: np.ndarray) -> np.ndarray:
        """Return (n,) bool: no visible keypoint is attached below the joint, so that none shows how it is turned.

        A joint without children counts if no visible keypoint is attached to itself.
        """
        return np.asarray(self._shows.dot(visible) == 0)
