"""Feeds one person's keypoints to the depth network, and converts its outputs to `JointDepths`."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.batch import BatchedCall, Steps
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.skeleton import Skeleton, has_built_in_proportions
from lassokin_ros.core.evidence.depth_network import (
    LEAST_SEEN,
    NAMES,
    TARGETS,
    History,
    Network,
    Prediction,
    Scene,
    canonical_index,
    lengths_of,
)
from lassokin_ros.core.evidence.image_roll import ImageRoll
from lassokin_ros.core.image.frame_data import JointDepths


class DepthEstimator:
    """Runs the network on the recent keypoints of one person."""

    def __init__(self, network: Network, kinematics: Kinematics) -> None:
        """The skeleton's lengths are input to the network if they are not the built-in proportions."""
        self._network, self._height = network, kinematics.skeleton.height
        index = canonical_index(kinematics.layout, kinematics.skeleton)
        self._index, self._in_layout = np.maximum(index, 0), index >= 0
        self.use_lengths(kinematics.skeleton, not has_built_in_proportions(kinematics.skeleton))
        self._history, self._roll = History(), ImageRoll(NAMES)
        self._mount: np.ndarray | None = None
        self._level = np.eye(3)
        self._prediction: Prediction | None = None
        self._rotation = np.eye(3)

    @property
    def usable(self) -> bool:
        """True if the layout has enough of the points that the network uses."""
        return int(self._in_layout.sum()) >= LEAST_SEEN

    def use_lengths(self, skeleton: Skeleton, known: bool) -> None:
        """Input a skeleton's bone lengths to the network from the next frame on, or none if they are not known."""
        self._lengths, self._lengths_known = lengths_of(skeleton), np.array(known)

    def adopt_history(self, other: DepthEstimator) -> None:
        """Copy the past keypoints and the newest estimate of another estimator for the same person."""
        self._history, self._roll = other._history, other._roll
        self._prediction, self._rotation = other._prediction, other._rotation

    def reset(self) -> None:
        """Forget the past keypoints."""
        self._history.reset()
        self._roll.reset()
        self._prediction = None
        self._rotation = np.eye(3)

    def update(
        self, stamp: float, points: np.ndarray, seen: np.ndarray, up: np.ndarray | None, mount: np.ndarray
    ) -> Steps[JointDepths | None]:
        """Estimate the joints' depths after a frame's keypoints; None if fewer than `LEAST_SEEN` are visible.

        A generator for `run_single` or `run_batched`: the network runs once for several people.

        stamp: s, later than the last. points: (l, 2) normalised; seen: (l,) bool. up: (3,) the vertical in the camera
        frame, None if unknown. mount: (3,) the vertical by the camera's mount. It is used to rotate a rolled image
        upright, because the network was trained with nearly level cameras. If the body does not point up in that image,
        it is turned further, see `ImageRoll`, and the vertical is not used.
        """
        shown = seen.take(self._index) & self._in_layout
        if mount is not self._mount:
            self._mount, self._level = mount, _upright_image(mount)
        level = self._level
        levelled = points.take(self._index, axis=0) @ level[:2, :2].T
        self._history.add(stamp, levelled, shown)
        self._roll.update(stamp, levelled, shown)
        self._prediction = None
        if np.count_nonzero(shown) < LEAST_SEEN:
            return None
        past, known = self._history.sampled()
        if self._roll.turned:
            turn = np.eye(3)
            turn[:2, :2] = self._roll.turn
            past, level, up = past @ turn[:2, :2].T, turn @ level, None
        vertical = np.zeros(3) if up is None else level @ up
        scene = Scene(past, known, vertical, np.array(up is not None), self._lengths, self._lengths_known)
        prediction = self._prediction = yield BatchedCall(self._network, "predict", (scene,))
        self._rotation = prediction.rotation @ level
        depths = self._height * prediction.places[:, 2].astype(float)
        return JointDepths(self._rotation[2], depths, prediction.whitening.astype(float) / self._height)

    def places(self) -> dict[str, np.ndarray] | None:
        """Position (3,) of each target and the right hip relative to the middle of the hips, m, camera frame.

        None without an estimate for the newest frame.
        """
        if self._prediction is None:
            return None
        found = self._height * self._prediction.places.astype(float) @ self._rotation
        result = dict(zip(TARGETS, found))
        result["right_hip"] = -result["left_hip"]
        return result


def _upright_image(up: np.ndarray) -> np.ndarray:
    """(3, 3) rotation about the optical axis after which the vertical (3,) points up in the image, to -y.

    The identity if the camera looks straight up or down.
    """
    size = float(np.hypot(up[0], up[1]))
    if size < 0.1:
        return np.eye(3)
    s, c = up[0] / size, -up[1] / size
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
