"""Tree of joints in the rest pose, as read from a file, and its conversion to a Skeleton."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError

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
