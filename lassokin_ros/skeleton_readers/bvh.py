"""Read the rest pose of a BVH file from its HIERARCHY; the motion is not read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lassokin_ros.core.body.skeleton import AXIS_ORDERS, Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.yaml_files import read_text
from lassokin_ros.skeleton_readers.naming import in_our_names, with_our_orders
from lassokin_ros.skeleton_readers.rest_pose import (
    LARGEST_OFFSET,
    MOST_JOINTS,
    RestTree,
    in_metres,
    in_our_pose,
    to_skeleton,
)


def read(path: Path, height: float) -> Skeleton:
    """Return the skeleton of a BVH file, for a person of `height` m. Raises SkeletonError.

    Joints with known names (see naming) are connected as in our tree, and converted to metres and a T-pose. A file with
    other names keeps its tree, which must have our axes and pose.
    """
    source = str(path)
    tree = with_our_orders(parse_hierarchy(read_text(path, SkeletonError), source))
    named = in_our_names(tree, source)
    if named is None:
        return to_skeleton(in_metres(tree, height, source), height, source, path.stem)
    return to_skeleton(in_our_pose(in_metres(named, height, source), source), height, source, path.stem)


def parse_hierarchy(text: str, source: str) -> RestTree:
    """Return the tree in the file's own unit; text: the beginning of the file with the whole HIERARCHY. Raises
    SkeletonError.
    """
    head, separator, _ = text.partition("\nMOTION")
    words = iter(head.split())
    if next(words, "") != "HIERARCHY" or not separator:
        raise SkeletonError(f"{source} is no BVH file; expected HIERARCHY at its beginning and MOTION behind that")
    names, parents, offsets, axes = list[str](), list[int](), list[list[float]](), list[str]()
    opened: list[int] = []  # joints of the open blocks, the innermost last; -1 for an end site
    try:
        for word in words:
            if word in ("ROOT", "JOINT"):
                name = _name(words)
                if len(names) == MOST_JOINTS:
                    raise SkeletonError(f"{source} has more than {MOST_JOINTS} joints")
                parents.append(opened[-1] if opened else -1)
                opened.append(len(names))
                names.append(name)
                offsets.append([0.0, 0.0, 0.0])
                axes.append("xzy")
            elif word == "End":
                _name(words)
                opened.append(-1)
            elif word == "}":
                opened.pop()
            elif word == "OFFSET":
                numbers = [float(next(words)) for _ in range(3)]
                if opened[-1] >= 0:
                    offsets[opened[-1]] = numbers
            elif word == "CHANNELS":
                channels = [next(words) for _ in range(int(next(words)))]
                axes[opened[-1]] = _order(channels, axes[opened[-1]])
            else:
                raise SkeletonError(f"{source}: '{word[:40]}' in HIERARCHY; expected JOINT, End Site, OFFSET, CHANNELS")
    except (StopIteration, IndexError, ValueError) as error:
        if isinstance(error, SkeletonError):
            raise
        raise SkeletonError(f"{source}: its HIERARCHY is broken near joint {names[-1] if names else '0'}") from None
    if opened or parents.count(-1) != 1:
        raise SkeletonError(f"{source}: its HIERARCHY is broken; expected one ROOT, and as many }} as {{")
    return RestTree(tuple(names), tuple(parents), _positions(offsets, parents, source), tuple(axes))


def _positions(offsets: list[list[float]], parents: list[int], source: str) -> np.ndarray:
    """Return the positions (n, 3) of joints by their offsets from their parents. Raises SkeletonError."""
    positions = np.array(offsets)
    positions[0] = 0.0  # the position of a root at rest is no bone
    if not (np.abs(positions) < LARGEST_OFFSET).all():  # NaN too
        raise SkeletonError(f"{source}: an OFFSET is not finite, or larger than {LARGEST_OFFSET:g}")
    for joint in range(1, len(positions)):
        positions[joint] += positions[parents[joint]]
    return positions


def _name(words: Iterator[str]) -> str:
    """Return the words before the next {, which is also read: names may contain blanks ("Bip01 Neck"). Raises
    StopIteration.
    """
    name: list[str] = []
    for word in words:
        if word == "{":
            return " ".join(name)
        name.append(word)
    raise StopIteration


def _order(channels: list[str], default: str) -> str:
    """Return the order of a joint's rotations; the default if they are not three."""
    order = "".join(channel[0].lower() for channel in channels if channel.endswith("rotation"))
    return order if order in AXIS_ORDERS else default
