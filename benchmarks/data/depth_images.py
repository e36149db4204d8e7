"""Measured depth: a simulated sensor at each keypoint, and depth images of a body made of capsules.

The images are those of a depth camera registered to the colour camera. The radii are anthropometric means
(circumference / (2 pi), half depth for the trunk), chosen without regard to the tracker's own offsets (`THICKNESS` in
`core/body/roles.py`). The images contain what a sensor per landmark does not: the surface in front of each joint, limbs
hidden by the own body, pixels of the wall beside thin limbs, and furniture in front of the person.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lassokin_ros.pipeline.depth.depth_images import sample_depth
from msg_adapters.depth_image import DepthImage

OCCLUDERS = 0.1, 0.5
"""Range of the distance between occluder and landmark, m, uniformly drawn."""


@dataclass(frozen=True)
class DepthSensor:
    """Errors of the measured depth.

    noise: standard deviation of each measurement, m. noise_z2: the same of an error that grows with the square of the
    depth, as with stereo cameras, 1/m. bias: standard deviation of the constant error of each landmark, m. occluded:
    share of the measurements that are those of an occluder.
    """

    noise: float = 0.0
    bias: float = 0.0
    occluded: float = 0.0
    noise_z2: float = 0.0

    def measured(self, depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """(f, l) m: measurements of the depths (f, l) of landmarks along the optical axis."""
        result = depth + self.noise * random.normal(size=depth.shape) + self.bias * random.normal(size=depth.shape[1])
        result += self.noise_z2 * depth**2 * random.normal(size=depth.shape)
        occluded = random.random(depth.shape) < self.occluded
        result[occluded] -= random.uniform(*OCCLUDERS, occluded.sum())
        return np.asarray(result)


SIZE = 848, 480
"""px: width and height of the depth images."""
CAPSULES = (
    ("pelvis", "neck", 0.105),
    ("l_hip", "r_hip", 0.105),
    ("l_hip", "l_shoulder", 0.085),
    ("r_hip", "r_shoulder", 0.085),
    ("l_shoulder", "r_shoulder", 0.06),
    ("neck", "head", 0.06),
    ("head", "head_top", 0.095),
    *((f"{s}_hip", f"{s}_knee", 0.075) for s in "lr"),
    *((f"{s}_knee", f"{s}_ankle", 0.05) for s in "lr"),
    *((f"{s}_ankle", f"{s}_toe", 0.035) for s in "lr"),
    *((f"{s}_shoulder", f"{s}_elbow", 0.045) for s in "lr"),
    *((f"{s}_elbow", f"{s}_wrist", 0.035) for s in "lr"),
)
"""Ends and radius, m, of each capsule, of an adult of 1.75 m."""
ADULT = 1.75
"""m: height to which the radii belong."""
WALL = 2.0
"""m from the person to the wall."""
FURNITURE = 0.6
"""m from the person to the furniture in front."""


@dataclass(frozen=True)
class DepthCamera:
    """Errors of the images and what stands in front of the person.

    noise: standard deviation of each pixel, m. noise_z2: the same that grows with the square of the depth, 1/m. bias:
    standard deviation of a factor on all depths of a view, 1. holes: share of pixels without a measurement. covered:
    share of the person's height in the image, from below, that furniture covers.
    """

    noise: float = 0.01
    noise_z2: float = 0.002
    bias: float = 0.005
    holes: float = 0.1
    covered: float = 0.0

    def sampled(
        self,
        joints: Mapping[str, np.ndarray],
        height: float,
        focal: float,
        pixels: np.ndarray,
        size: tuple[int, int],
        random: np.random.Generator,
    ) -> np.ndarray:
        """(f, l) m: the depth that the node samples at keypoints, NaN = none.

        joints: (f, 3) m each, camera frame. height: m, of the person. focal, pixels (f, l, 2), size: of the colour
        image, px; its principal point is the middle.
        """
        factor = 1 + self.bias * random.normal()
        result = np.full(pixels.shape[:2], np.nan)
        for frame in range(len(pixels)):
            places = {name: place[frame] for name, place in joints.items()}
            depth = factor * self._spoiled(render(places, height, focal * SIZE[0] / size[0], self.covered), random)
            values = np.round(1000 * depth).astype(np.uint16)
            result[frame] = sample_depth(DepthImage(None, "", values, 0.001), pixels[frame], size)
        return result

    def _spoiled(self, depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """The image (h, w) m with noise; 0 = no measurement."""
        noise = random.standard_normal(depth.shape, dtype=np.float32)
        spoiled = depth + (self.noise + self.noise_z2 * depth**2) * noise
        spoiled[random.random(depth.shape, dtype=np.float32) < self.holes] = 0.0
        return np.asarray(spoiled)


def render(joints: Mapping[str, np.ndarray], height: float, focal: float, covered: float = 0.0) -> np.ndarray:
    """(480, 848) m: depth along the optical axis of the body, the wall behind it and the furniture in front.

    joints: (3,) m each, camera frame. focal: px of this image. covered: see `DepthCamera`.
    """
    middle = float(joints["pelvis"][2])
    image = np.full(SIZE[::-1], middle + WALL, np.float32)
    top, bottom = SIZE[1], 0
    for start, end, radius in CAPSULES:
        ends, radius = np.array([joints[start], joints[end]]), radius * height / ADULT
        if ends[:, 2].min() <= 2 * radius:
            continue
        centre, reach = focal * ends[:, :2] / ends[:, 2:], focal * radius / (ends[:, 2:] - radius)
        low = np.clip((centre - reach).min(0) + 0.5 * np.array(SIZE), 0, SIZE).astype(int)
        high = np.clip((centre + reach).max(0) + 0.5 * np.array(SIZE) + 1, 0, SIZE).astype(int)
        window = image[low[1] : high[1], low[0] : high[0]]
        x, y = ((np.arange(low[i], high[i]) - 0.5 * (SIZE[i] - 1)) / focal for i in (0, 1))
        np.minimum(window, _capsule_depth(x[None, :], y[:, None], ends, radius), out=window)
        top, bottom = min(top, low[1]), max(bottom, high[1])
    if covered:
        edge = round(bottom - covered * (bottom - top))
        np.minimum(image[edge:], middle - FURNITURE, out=image[edge:])
    return image


def _capsule_depth(x: np.ndarray, y: np.ndarray, ends: np.ndarray, radius: float) -> np.ndarray:
    """(h, w) m: depth at which rays (x, y, 1) enter a capsule with the axis `ends` (2, 3), infinite if they miss it."""
    start, axis = ends[0], ends[1] - ends[0]
    length2 = float(axis @ axis) + 1e-12
    ray2 = x * x + y * y + 1
    along = x * axis[0] + y * axis[1] + axis[2]  # ray . axis
    towards = x * start[0] + y * start[1] + start[2]  # ray . start
    start_along = float(start @ axis)
    a = length2 * ray2 - along**2
    b = -length2 * towards + start_along * along
    c = length2 * float(start @ start) - start_along**2 - radius**2 * length2
    depth = np.full(np.broadcast_shapes(x.shape, y.shape), np.inf)
    inside = b * b - a * c
    with np.errstate(invalid="ignore", divide="ignore"):
        side = (-b - np.sqrt(inside)) / a
    place = side * along - start_along
    on_side = (inside >= 0) & (place > 0) & (place < length2)
    depth[on_side] = side[on_side]
    for end in ends:
        middle = x * end[0] + y * end[1] + end[2]
        inside = middle**2 - ray2 * (float(end @ end) - radius**2)
        with np.errstate(invalid="ignore"):
            ball = (middle - np.sqrt(inside)) / ray2
        np.fmin(depth, ball, out=depth)
    return depth
