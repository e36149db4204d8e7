"""The joints of a file in the rest pose, and their conversion to ours: metres, x to the person's left, y up, a T-pose.

The positions of landmarks, the pose prior and the joint limits are defined in that pose. With hanging arms or other
axes the poses would be wrong, without an error message.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError

OURS = "anthropometric"
"""The built-in skeleton, whose tree and names are SMPL's."""
SIDES = ("left", "right")
MOST_JOINTS = 1000
LARGEST_OFFSET = 1e9
"""Largest offset of a joint in a file, in the file's unit. It keeps sums and products of offsets finite."""


@dataclass(frozen=True, eq=False)
class RestTree:
    """Joints of a file in the rest pose.

    names: n; parents: (n,) index, parents before children, -1 for the root; positions: (n, 3); axes: n Euler orders.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: np.ndarray
    axes: tuple[str, ...]


def to_skeleton(tree: RestTree, height: float, source: str, name: str) -> Skeleton:
    """Return the skeleton of a tree in metres and body axes. Checks it as for YAML. Raises SkeletonError."""
    if len(tree.names) > MOST_JOINTS:
        raise SkeletonError(f"{source} has {len(tree.names)} joints; expected at most {MOST_JOINTS}")
    positions = tree.positions - tree.positions[0]
    joints = [
        {
            "name": joint,
            "parent": None if parent < 0 else tree.names[parent],
            "position": position,
            "axes": order,
        }
        for joint, parent, position, order in zip(tree.names, tree.parents, positions.tolist(), tree.axes)
    ]
    return Skeleton.from_mapping({"name": name, "height_unit": "metre", "joints": joints}, height, source)


UNITS = {1.0: "m", 0.01: "cm", 0.001: "mm", 0.0254: "inches", 0.3048: "feet", 0.1: "dm"}
"""Metres -> unit."""
METRIC = ("m", "cm", "mm")
"""The usual units, for which nothing is logged."""
NEAR = 1.12
"""A unit is that of a file if the person has the size of one of `height`, up to this factor. Programs also have units
of their own, and a unit of 0.8 cm is none of 1 cm."""
NEAR_UNNAMED = 1.55
"""The same for a tree with unknown joints, whose size is known roughly. It is less than the square root of 2.54, the
ratio of inch and centimetre, so that only one of both can be near."""
SHORTEST, TALLEST = 0.8, 2.3
"""m: range of the height of a person."""
PLAUSIBLE = (0.6, 2.4)
"""m: range of the longest side of a tree with unknown joints."""
LOG = logging.getLogger(__name__)
LIMBS = [[f"{side}_{joint}" for joint in limb.split()] for limb in ("shoulder elbow wrist", "hip knee ankle")
         for side in SIDES]  # fmt: skip
STRAIGHT_ENOUGH = np.radians(10)
"""rad: a bone of an arm or leg within this angle of the T-pose is not changed."""


def in_our_pose(tree: RestTree, source: str) -> RestTree:
    """Return a tree with our names, in metres, rotated upright and with straight limbs. Raises SkeletonError."""
    return _straight_limbs(replace(tree, positions=tree.positions @ _body_axes(tree, source)))


def _place(tree: RestTree, joint: str) -> np.ndarray:
    return np.asarray(tree.positions[tree.names.index(joint)])


def _middle(tree: RestTree, joint: str) -> np.ndarray:
    left, right = (_place(tree, f"{side}_{joint}") for side in SIDES)
    return np.asarray(0.5 * (left + right))


def _body_axes(tree: RestTree, source: str) -> np.ndarray:
    """Return (3, 3): the body's axes in the file's as columns, each parallel to one of the file's axes.

    A tilt of the trunk is therefore kept as a property of the body.
    """
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
    """Rotate arms and legs at shoulder, elbow, hip and knee into the built-in skeleton's T-pose; lengths are kept."""
    ours = Skeleton.load(OURS, 1.0)
    positions = tree.positions.copy()
    for limb in LIMBS:
        for near, far in zip(limb, limb[1:]):
            start, end = tree.names.index(near), tree.names.index(far)
            bone, wanted = positions[end] - positions[start], ours.offsets[ours.index(far)]
            angle = np.arctan2(np.linalg.norm(np.cross(bone, wanted)), bone @ wanted)
            if np.linalg.norm(bone) < 1e-6 or angle <= STRAIGHT_ENOUGH:
                continue
            below = {start}
            for joint in range(start + 1, len(tree.names)):  # parents precede their children
                below |= {joint} if tree.parents[joint] in below else set()
            moved = sorted(below - {start})
            turn = least_turn(bone, wanted)
            positions[moved] = positions[start] + (positions[moved] - positions[start]) @ turn.T
    return replace(tree, positions=positions)


def in_metres(tree: RestTree, height: float, source: str) -> RestTree:
    """Convert a tree of a file without a unit to metres: the unit that brings it nearest to `height`, m.

    If no unit brings it near (CMU's BVH files have their own unit), a tree with our names is scaled to `height`. This
    is logged, and units other than m, cm and mm. Raises SkeletonError for a tree with other names that is no person in
    any unit.
    """
    ankles_and_head = {"left_ankle", "right_ankle", "head"} <= set(tree.names)
    if ankles_and_head:
        size = float(np.linalg.norm(_place(tree, "head") - _middle(tree, "ankle")))
        ours = Skeleton.load(OURS, height)
        rest = ours.rest_positions
        ankles = 0.5 * (rest[ours.index("left_ankle")] + rest[ours.index("right_ankle")])
        expected = float(np.linalg.norm(rest[ours.index("head")] - ankles))
    else:
        size, expected = float(np.ptp(tree.positions, axis=0).max()), height
    if not size > 0:
        raise SkeletonError(f"{source}: the skeleton has no size; expected a person")
    unit = min(UNITS, key=lambda unit: abs(np.log(unit * size / expected)))
    if abs(np.log(unit * size / expected)) > np.log(NEAR if ankles_and_head else NEAR_UNNAMED):
        unit = _far_from_height(ankles_and_head, size, expected, height, source)
    elif UNITS[unit] not in METRIC:
        LOG.warning("%s: lengths are read in %s, which is nearest to height %.2f m", source, UNITS[unit], height)
    return replace(tree, positions=tree.positions * unit)


def _far_from_height(named: bool, size: float, expected: float, height: float, source: str) -> float:
    """Return metres per unit of a tree that no unit brings near the height. Raises SkeletonError."""
    if named:
        LOG.warning(
            "%s: the skeleton is %g units from ankles to head; no unit makes a person of %.2f m of it, so it is scaled "
            "to that height; %s",
            source,
            size,
            height,
            _height_in_units(size / expected * height),
        )
        return expected / size
    for unit, name in UNITS.items():
        if name in METRIC and PLAUSIBLE[0] <= unit * size <= PLAUSIBLE[1]:
            return unit
    raise SkeletonError(
        f"{source}: the skeleton is {size:g} units large, which is no person in {', '.join(UNITS.values())}"
    )


def _height_in_units(units: float) -> str:
    """Return the advice for a skeleton of so many units that is not scaled: the heights that keep its lengths."""
    heights = [(unit * units, name) for unit, name in UNITS.items() if SHORTEST <= unit * units <= TALLEST]
    if not heights:
        return "set height to that of the person"
    return "to keep its lengths, set height to " + " or ".join(
        f"{height:.2f} (if they are in {name})" for height, name in heights
    )
