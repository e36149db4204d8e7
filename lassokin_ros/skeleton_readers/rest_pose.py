"""Any rest pose to ours: metres, x to the person's left, y up, z to the front, a T-pose.

Landmarks' places, the prior on posture and the limits of joints are given in that pose, so that a skeleton with its
arms hanging or in other axes would be tracked badly, without a word.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.skeleton_readers.naming import OURS, SIDES
from lassokin_ros.skeleton_readers.rest_tree import RestTree

INCH = 0.0254
UNITS = {1.0: "m", 0.01: "cm", 0.001: "mm", INCH: "inches"}
PLAUSIBLE = (0.6, 2.4)
"""m over the longest side of a skeleton of which the joints are not known."""
NEAR = 1.75
"""Largest ratio between a skeleton's size in its unit and that of a person of the given height."""
TYPICAL_HEIGHT = 1.7
"""m: if the height is unknown."""
LOGGER = logging.getLogger(__name__)
LIMBS = [[f"{side}_{joint}" for joint in limb.split()] for limb in ("shoulder elbow wrist", "hip knee ankle")
         for side in SIDES]  # fmt: skip
STRAIGHT_ENOUGH = np.radians(10)
"""rad: a bone of an arm or leg that is this near to a T-pose's stays as it is."""


def in_our_pose(tree: RestTree, source: str) -> RestTree:
    """A tree with our names, in metres, turned upright and with straight limbs. Raises SkeletonError."""
    return _straight_limbs(replace(tree, positions=tree.positions @ _body_axes(tree, source)))


def _place(tree: RestTree, joint: str) -> np.ndarray:
    place: np.ndarray = tree.positions[tree.names.index(joint)]
    return place


def _middle(tree: RestTree, joint: str) -> np.ndarray:
    left, right = (_place(tree, f"{side}_{joint}") for side in SIDES)
    middle: np.ndarray = 0.5 * (left + right)
    return middle


def _body_axes(tree: RestTree, source: str) -> np.ndarray:
    """(3, 3) a body's axes in the file's as columns, each one of the file's: a tilt of the trunk is the body's own."""
    up = _nearest_axis(_place(tree, "neck") - _middle(tree, "hip"))
    left = _place(tree, "left_hip") - _place(tree, "right_hip")
    left -= up * (left @ up)
    if np.linalg.norm(left) < 1e-6:
        raise SkeletonError(f"{source}: left_hip and right_hip are on one spot; expected a person who stands")
    left = _nearest_axis(left)
    return np.stack([left, up, np.cross(left, up)], axis=1)


def _nearest_axis(direction: np.ndarray) -> np.ndarray:
    axis = np.zeros(3)
    largest = int(np.argmax(np.abs(direction)))
    axis[largest] = 1.0 if direction[largest] >= 0 else -1.0
    return axis


def _straight_limbs(tree: RestTree) -> RestTree:
    """Arms and legs turned at shoulder, elbow, hip and knee into the T-pose of the built-in skeleton, lengths kept."""
    ours = Skeleton.load(OURS, 1.0)
    positions = tree.positions.copy()
    for limb in LIMBS:
        for near, far in zip(limb, limb[1:]):
            start, end = tree.names.index(near), tree.names.index(far)
            bone, wanted = positions[end] - positions[start], ours.offsets[ours.index(far)]
            if np.linalg.norm(bone) < 1e-6 or _angle(bone, wanted) <= STRAIGHT_ENOUGH:
                continue
            turn = least_turn(bone, wanted)
            below = [joint for joint in range(start + 1, len(tree.names)) if _is_below(tree, joint, start)]
            positions[below] = positions[start] + (positions[below] - positions[start]) @ turn.T
    return replace(tree, positions=positions)


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _is_below(tree: RestTree, joint: int, top: int) -> bool:
    while joint > top:  # parents stand before their children
        joint = tree.parents[joint]
    return joint == top


def in_metres(tree: RestTree, height: float, source: str) -> RestTree:
    """Convert a tree of a file that does not say its unit to metres.

    The unit is the one of UNITS that comes nearest to a person of `height`, m. If none comes near (CMU's BVH has units
    of its own), a tree with our names is scaled to `height`. A warning is logged for an uncommon unit and for scaling.
    Raises SkeletonError for another tree of which no unit makes a person.
    """
    ours = Skeleton.load(OURS, height if height > 0 else TYPICAL_HEIGHT)
    if {"left_ankle", "right_ankle", "head"} <= set(tree.names):
        rest = ours.rest_positions
        ankles = 0.5 * (rest[ours.index("left_ankle")] + rest[ours.index("right_ankle")])
        expected = float(np.linalg.norm(rest[ours.index("head")] - ankles))
        size = float(np.linalg.norm(_place(tree, "head") - _middle(tree, "ankle")))
        plausible = (expected / NEAR, expected * NEAR)
        scale = expected / size if size > 0 else None
    else:
        expected, scale, plausible = ours.height, None, PLAUSIBLE
        size = float(np.ptp(tree.positions, axis=0).max())
    near = {unit: name for unit, name in UNITS.items() if plausible[0] <= unit * size <= plausible[1]}
    if scale is None and len(near) > 1:
        near.pop(INCH, None)
    unit = min(near, key=lambda each: abs(np.log(each * size / expected)), default=scale)
    if unit is None or scale is None and unit == INCH and abs(np.log(unit * size / expected)) > np.log(NEAR):
        raise SkeletonError(
            f"{source}: the skeleton is {size:g} units large, which is no person in {', '.join(UNITS.values())}"
        )
    if unit not in UNITS:
        LOGGER.warning("%s is in no known unit: its skeleton is scaled to the height of %g m", source, ours.height)
    elif unit == INCH:
        LOGGER.warning("%s is read in inches, which come nearest to the height of %g m", source, ours.height)
    return replace(tree, positions=tree.positions * unit)
