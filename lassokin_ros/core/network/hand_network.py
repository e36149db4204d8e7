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
MIRROR = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
"""Factors on the coordinates of the left and of the right hand that make left hands of both."""


def hand_index(kinematics: Kinematics, side: str) -> np.ndarray | None:
    """(21,) index of the layout's landmark at each of `POINTS`; None if one is missing.

    The last one is chosen: the layouts have the points of the hands after those of the body, which has a wrist, too.
    """
    layout, skeleton, found = kinematics.layout, kinematics.skeleton, []
    at_centre = np.linalg.norm(layout.offsets, axis=1) <= 0.005 * skeleton.height  # a tip is further away
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
    return outputs[..., :DEPTHS], np.exp(np.clip(outputs[..., DEPTHS:], -6.0, 1.0))


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

    def estimate(self, points: np.ndarray, seen: np.ndarray, mirrors: np.ndarray) -> list[HandDepths]:
        """The depths of h hands, at least `LEAST_SEEN` of whose points are visible.

        points: (h, 21, 2) normalised, any finite value if not visible; seen: (h, 21) bool; mirrors: (h, 3), see
        `MIRROR`.
        """
        inputs, sizes, rotations = features(points * mirrors[:, None, :2], seen)
        depths, deviations = interpreted(self(inputs).astype(float))
        hands = zip(rotations[:, 2] * mirrors, sizes[:, None] * depths, sizes[:, None] * deviations)
        return [HandDepths(sight, ratios, self.whitening / scale) for sight, ratios, scale in hands]


class HandEstimator:
    """The hand network's estimates for the hands of one layout."""

    def __init__(self, kinematics: Kinematics) -> None:
        self._network = shipped_hand_network()
        indices = [hand_index(kinematics, side) for side in SIDES]
        self._sides = np.array([side for side, index in enumerate(indices) if index is not None])
        self._indices = np.array([index for index in indices if index is not None])

    @staticmethod
    def fits(kinematics: Kinematics) -> bool:
        """Whether skeleton and layout have all points of a hand."""
        return any(hand_index(kinematics, side) is not None for side in SIDES)

    def estimate(
        self, points: np.ndarray, seen: np.ndarray, camera: CameraPose
    ) -> tuple[HandDepths | None, HandDepths | None]:
        """Of the left and the right hand, with the line of sight in the frame of the skeleton; None if fewer than
        `LEAST_SEEN` points of a hand are visible.

        points: (l, 2) normalised; seen: (l,) bool.
        """
        given: list[HandDepths | None] = [None, None]
        shown = seen.take(self._indices)
        enough = np.flatnonzero(np.count_nonzero(shown, axis=1) >= LEAST_SEEN)
        if len(enough):
            places = points.take(self._indices[enough], axis=0)
            found = self._network.estimate(places, shown[enough], MIRROR[self._sides[enough]])
            for side, hand in zip(self._sides[enough], found):
                given[side] = hand if camera.is_identity else replace(hand, sight=camera.rotation.T @ hand.sight)
        return given[0], given[1]


def load_weights(file: Path | None = None) -> HandNetwork:
    """The network of an npz file (default: the shipped one)."""
    source = file or resources.files("lassokin_ros.core.network") / "hand_network.npz"
    with source.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
        return HandNetwork(data)


@cache
def shipped_hand_network() -> HandNetwork:
    """The network that is shipped with the package, read once."""
    return load_weights()
