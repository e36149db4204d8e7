"""Feeds one person's keypoints to the depth network, and converts its outputs to `JointDepths`.

The network was trained with people who stand in nearly level images. A camera may be on its side or upside down, and a
person may lie: the input is then turned by the multiple of 90 degrees after which the body points up.
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.roles import NETWORK_JOINTS, STANDING_HEIGHT
from lassokin_ros.core.body.skeleton import Skeleton, has_built_in_proportions
from lassokin_ros.core.image.frame_data import JointDepths
from lassokin_ros.core.network.depth_network import (
    LEAST_SEEN,
    NAMES,
    History,
    Network,
    Scene,
    canonical_index,
    lengths_of,
)
from lassokin_ros.core.observation import has_passed


class ImageRoll:
    """Finds the quarter turn for one person's images."""

    def __init__(self, names: tuple[str, ...]) -> None:
        """names: of the points."""
        self._used = np.array([name in STANDING_HEIGHT for name in names])
        self._rows = np.array([[STANDING_HEIGHT.get(name, 0.0) for name in names], np.ones(len(names))])
        self.reset()

    def reset(self) -> None:
        """Return to the image as it is."""
        self.turn = np.eye(2)
        """(2, 2) rotation of points, x right and y down."""
        self._up: np.ndarray | None = None
        self._newest = -math.inf

    @property
    def turned(self) -> bool:
        """True if the image is turned."""
        return bool(self.turn[0, 0] < 0.5)

    def update(self, stamp: float, points: np.ndarray, seen: np.ndarray) -> None:
        """Use a frame, if the last one used is older than 0.1 s.

        stamp: s; points: (k, 2) normalised, any finite value if not seen; seen: (k,) bool.
        """
        if not has_passed(stamp - self._newest, 0.1):
            return
        up = self._direction(points, seen & self._used)
        if up is None:
            return
        share = 1.0 if self._up is None else 1 - math.exp(-max(stamp - self._newest, 0.0) / 0.5)  # s
        mean = up if self._up is None else self._up + share * (up - self._up)
        self._up, self._newest = mean, stamp
        size = math.hypot(*mean)
        if size > 0 and -(self.turn[1] @ mean) < 0.5 * size:  # more than 60 degrees from the top
            # The turn by a multiple of 90 degrees that brings the mean direction nearest to (0, -1).
            quarter = round(math.atan2(mean[0], -mean[1]) / (math.pi / 2))
            c, s = round(math.cos(quarter * math.pi / 2)), round(math.sin(quarter * math.pi / 2))
            self.turn = np.array([[c, s], [-s, c]], dtype=float)

    def _direction(self, points: np.ndarray, used: np.ndarray) -> np.ndarray | None:
        """(2,) unit vector in which the height of the visible points increases in the image; None if undefined."""
        heights = self._rows[0][used]
        if len(heights) < 2 or heights.max() - heights.min() < 0.28:  # of the height: shoulders and head alone may lean
            return None
        rows = self._rows * used
        sums, (height, count) = rows @ points, rows.sum(axis=1)
        direction = sums[0] - height / count * sums[1]
        size = math.hypot(*direction)
        return direction / size if size > 1e-6 else None


class DepthEstimator:
    """Runs the network on the recent keypoints of one person."""

    def __init__(self, network: Network, kinematics: Kinematics) -> None:
        """The skeleton's lengths are input to the network if they are not the built-in proportions."""
        self._network, self._kinematics = network, kinematics
        index = canonical_index(kinematics.layout, kinematics.skeleton)
        self._index, self._in_layout = np.maximum(index, 0), index >= 0
        self.use_lengths(kinematics.skeleton, not has_built_in_proportions(kinematics.skeleton))
        self._history, self._roll = History(), ImageRoll(NAMES)
        self._mount: np.ndarray | None = None
        self._level: np.ndarray | None = None
        self.reset()

    @staticmethod
    def fits(kinematics: Kinematics) -> bool:
        """Whether the skeleton has the joints, and the layout enough of the points, that the network uses."""
        if not set(kinematics.skeleton.joint_names) >= NETWORK_JOINTS:
            return False
        return int(np.count_nonzero(canonical_index(kinematics.layout, kinematics.skeleton) >= 0)) >= LEAST_SEEN

    def use_lengths(self, skeleton: Skeleton, known: bool) -> None:
        """Input a skeleton's bone lengths to the network from the next frame on, or none if they are not known."""
        self._lengths, self._lengths_known = lengths_of(skeleton), np.array(known)

    def reset(self) -> None:
        """Forget the past keypoints."""
        self._history.reset()
        self._roll.reset()
        self.places: np.ndarray | None = None
        """(k, 3) m: `PLACES` relative to the middle of the hips, camera frame; None without `joint_depths`."""
        self.joint_depths: JointDepths | None = None
        """Of the newest frame, with `sight` in the camera frame; None if fewer than `LEAST_SEEN` points are visible."""

    def carry(self, rotation: np.ndarray, shift: np.ndarray) -> None:
        """Continue in the image of the camera after it has moved; see `projection.carried`. shift: (l, 3)."""
        self._history.carry(rotation, shift.take(self._index, axis=0))

    def update(
        self, stamp: float, points: np.ndarray, seen: np.ndarray, up: np.ndarray | None, mount: np.ndarray
    ) -> None:
        """Estimate the joints' depths after a frame's keypoints.

        stamp: s, later than the last. points: (l, 2) normalised; seen: (l,) bool. up: (3,) the vertical in the camera
        frame, None if unknown. mount: (3,) the vertical by the camera's mount, by which a rolled image is turned
        upright. If the body does not point up in that image, see `ImageRoll`, the vertical is not used.
        """
        shown = seen.take(self._index) & self._in_layout
        if mount is not self._mount:
            self._mount, self._level = mount, _upright_image(mount)
        level, canonical = self._level, points.take(self._index, axis=0)
        self._history.add(stamp, canonical, shown)
        self._roll.update(stamp, canonical if level is None else canonical @ level[:2, :2].T, shown)
        self.places = self.joint_depths = None
        if np.count_nonzero(shown) < LEAST_SEEN:
            return
        past, known = self._history.sampled()
        if self._roll.turned:
            turn = np.eye(3)
            turn[:2, :2] = self._roll.turn
            level, up = turn if level is None else turn @ level, None
        if level is not None:
            past, up = past @ level[:2, :2].T, up if up is None else level @ up
        vertical = np.zeros(3) if up is None else up
        scene = Scene(past, known, vertical, np.array(up is not None), self._lengths, self._lengths_known)
        places, depths, whitening, rotation = self._network.estimate(scene, self._kinematics.skeleton.height)
        rotation = rotation if level is None else rotation @ level
        self.places, self.joint_depths = places @ rotation, JointDepths(rotation[2], depths, whitening)


def _upright_image(up: np.ndarray) -> np.ndarray | None:
    """(3, 3) rotation about the optical axis after which the vertical (3,) points up in the image, to -y.

    None if it does so already, or if the camera looks straight up or down.
    """
    size = float(np.hypot(up[0], up[1]))
    if size < 0.1 or (up[0] == 0 and up[1] < 0):
        return None
    s, c = up[0] / size, -up[1] / size
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
