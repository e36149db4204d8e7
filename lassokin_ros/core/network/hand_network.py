"""A small network that estimates the depths of a hand's points from its keypoints in one image.

Input. The keypoints are turned into a virtual camera that looks at the middle of the hand, and divided by their size in
that image, with a mask for those that are not seen. Those of a right hand are mirrored.

Output. For each of `POINTS` but the wrist, the depth relative to the wrist's, along the line of sight to the middle of
the hand, as a share of the wrist's depth and in units of the size in the image; and the logarithm of its deviation. The
errors of the points of one hand are correlated, alike for all hands: `whitening` makes them independent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.roles import FINGERS, SIDES
from lassokin_ros.core.image.frame_data import HandDepths
from lassokin_ros.core.network.depth_network import camera_towards
from lassokin_ros.core.observation import CameraPose

POINTS = ("wrist", *(f"{finger}{end}" for finger in FINGERS for end in ("1", "2", "3", "_tip")))
"""The joints of a hand, and the tip of each finger, which is fixed to its last joint."""
DEPTHS = len(POINTS) - 1
INPUTS, OUTPUTS = 3 * len(POINTS), 2 * DEPTHS
LEAST_SEEN = 8
"""Smallest number of points that must be visible."""
LARGEST_OFFSET = 0.005
"""In heights: largest distance of a landmark from the centre of its joint. A tip is further away."""
LOG_SCALES = -6.0, 1.0
"""Limits of the logarithm of the deviation."""


def hand_index(kinematics: Kinematics, side: str) -> np.ndarray | None:
    """(21,) index of the layout's landmark at each of `POINTS`; None if one is missing.

    The last one is chosen: the layouts have the points of the hands after those of the body, which has a wrist, too.
    """
    layout, skeleton, found = kinematics.layout, kinematics.skeleton, []
    at_centre = np.linalg.norm(layout.offsets, axis=1) <= LARGEST_OFFSET * skeleton.height
    for point in POINTS:
        tip = point.endswith("_tip")
        joint = f"{side}_{point.removesuffix('_tip')}3" if tip else f"{side}_{point}"
        if joint not in skeleton.joint_names:
            return None
        there = np.flatnonzero((layout.joints == skeleton.index(joint)) & (at_centre != tip))
        if len(there) == 0:
            return None
        found.append(int(there[-1]))
    return np.array(found)


def features(points: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(inputs (..., INPUTS) float32, size (...,), rotation (..., 3, 3) from the camera into the virtual one).

    points: (..., 21, 2) normalised, of a left hand or mirrored, any finite value if not visible; seen: (..., 21) bool.
    """
    shown = seen.astype(float)[..., None]
    count = np.maximum(shown.sum(-2), 1.0)
    rotation = camera_towards((points * shown).sum(-2) / count)
    turned = points @ rotation[..., :, :2].swapaxes(-1, -2) + rotation[..., None, :, 2]
    places = turned[..., :2] / np.maximum(turned[..., 2:], 0.1)
    places = (places - ((places * shown).sum(-2) / count)[..., None, :]) * shown
    size = np.sqrt((places * places).sum((-1, -2)) / count[..., 0]) + 1e-9
    scaled = np.clip(places / size[..., None, None], -6.0, 6.0)
    inputs = np.concatenate([scaled.reshape(*size.shape, -1), shown[..., 0]], axis=-1)
    return inputs.astype(np.float32), size, rotation


def interpreted(outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(depths, deviations), each (..., DEPTHS), in units of the size in the image, from outputs (..., OUTPUTS)."""
    return outputs[..., :DEPTHS], np.exp(np.clip(outputs[..., DEPTHS:], *LOG_SCALES))


class HandNetwork:
    """A perceptron with two hidden layers of rectified linear units."""

    def __init__(self, weights: Mapping[str, np.ndarray]) -> None:
        """weights: W0, b0, W1, b1, W2, b2, and `whitening` (DEPTHS, DEPTHS) of errors divided by their deviations."""
        self.layers = [(weights[f"W{i}"].astype(np.float32), weights[f"b{i}"].astype(np.float32)) for i in range(3)]
        self.whitening = weights["whitening"].astype(float)

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """(..., OUTPUTS) of inputs (..., INPUTS), float32."""
        h = inputs
        for W, b in self.layers[:-1]:
            h = np.maximum(h @ W + b, 0.0)
        W, b = self.layers[-1]
        return np.asarray(h @ W + b)

    def estimate(self, points: np.ndarray, seen: np.ndarray, side: str) -> HandDepths | None:
        """The depths of one hand; None if fewer than `LEAST_SEEN` of its points are visible.

        points: (21, 2) normalised, any finite value if not visible; seen: (21,) bool.
        """
        if np.count_nonzero(seen) < LEAST_SEEN:
            return None
        mirror = np.array([1.0 if side == SIDES[0] else -1.0, 1.0, 1.0])
        inputs, size, rotation = features(points * mirror[:2], seen)
        depths, deviations = interpreted(self(inputs).astype(float))
        return HandDepths(rotation[2] * mirror, size * depths, self.whitening / (size * deviations))


class HandEstimator:
    """The hand network's estimates for the hands of one layout."""

    def __init__(self, kinematics: Kinematics) -> None:
        self._network = shipped_hand_network()
        self._indices = [hand_index(kinematics, side) for side in SIDES]

    @staticmethod
    def fits(kinematics: Kinematics) -> bool:
        """Whether skeleton and layout have all points of a hand."""
        return any(hand_index(kinematics, side) is not None for side in SIDES)

    def estimate(
        self, points: np.ndarray, seen: np.ndarray, camera: CameraPose
    ) -> tuple[HandDepths | None, HandDepths | None]:
        """Of the left and the right hand, with the line of sight in the frame of the skeleton.

        points: (l, 2) normalised; seen: (l,) bool.
        """
        left, right = (self._one(index, side, points, seen, camera) for index, side in zip(self._indices, SIDES))
        return left, right

    def _one(
        self, index: np.ndarray | None, side: str, points: np.ndarray, seen: np.ndarray, camera: CameraPose
    ) -> HandDepths | None:
        if index is None:
            return None
        given = self._network.estimate(points.take(index, axis=0), seen.take(index), side)
        if given is None or camera.is_identity:
            return given
        return replace(given, sight=camera.rotation.T @ given.sight)


def load_weights(file: Path | None = None) -> HandNetwork:
    """The network of an npz file (default: the shipped one)."""
    source = file or resources.files("lassokin_ros.core.network") / "hand_network.npz"
    with source.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
        return HandNetwork(data)


@cache
def shipped_hand_network() -> HandNetwork:
    """The network that is shipped with the package, read once."""
    return load_weights()
