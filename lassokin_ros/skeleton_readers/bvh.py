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
    tree = _Hierarchy(source)
    try:
        for word in words:
            tree.read_keyword(word, words)
    except SkeletonError:
        raise
    except (StopIteration, IndexError, ValueError):
        near = tree.names[-1] if tree.names else "0"
        raise SkeletonError(f"{source}: its HIERARCHY is broken near joint {near}") from None
    return tree.rest()


class _Hierarchy:
    """The joints read so far: name, parent (-1: none), offset from it, and order of rotations of each."""

    def __init__(self, source: str) -> None:
        """source: the file, for error messages."""
        self.names: list[str] = []
        self._source = source
        self._parents: list[int] = []
        self._offsets: list[list[float]] = []
        self._axes: list[str] = []
        self._open: list[int] = []  # joints of the open blocks, the innermost last; -1 for an end site

    def read_keyword(self, word: str, words: Iterator[str]) -> None:
        """Read one keyword with its values. Raises StopIteration, IndexError or ValueError for a broken file."""
        if word in ("ROOT", "JOINT"):
            self._begin_joint(_name(words))
        elif word == "End":
            _name(words)
            self._open.append(-1)
        elif word == "}":
            self._open.pop()
        elif word == "OFFSET":
            numbers = [float(next(words)) for _ in range(3)]
            if self._open[-1] >= 0:
                self._offsets[self._open[-1]] = numbers
        elif word == "CHANNELS":
            channels = [next(words) for _ in range(int(next(words)))]
            self._axes[self._open[-1]] = _order(channels, self._axes[self._open[-1]])
        else:
            raise SkeletonError(
                f"{self._source}: '{word[:40]}' in HIERARCHY; expected JOINT, End Site, OFFSET, CHANNELS"
            )

    def _begin_joint(self, name: str) -> None:
        if len(self.names) == MOST_JOINTS:
            raise SkeletonError(f"{self._source} has more than {MOST_JOINTS} joints")
        self.names.append(name)
        self._parents.append(self._open[-1] if self._open else -1)
        self._open.append(len(self.names) - 1)
        self._offsets.append([0.0, 0.0, 0.0])
        self._axes.append("xzy")

    def rest(self) -> RestTree:
        """Return the complete tree. Raises SkeletonError."""
        if self._open or not self.names or self._parents.count(-1) != 1:
            raise SkeletonError(f"{self._source}: its HIERARCHY is broken; expected one ROOT, and as many }} as {{")
        positions = np.array(self._offsets)
        positions[0] = 0.0  # the position of a root at rest is no bone
        if not (np.abs(positions) < LARGEST_OFFSET).all():  # NaN too
            raise SkeletonError(f"{self._source}: an OFFSET is not finite, or larger than {LARGEST_OFFSET:g}")
        for joint in range(1, len(self.names)):
            positions[joint] += positions[self._parents[joint]]
        return RestTree(tuple(self.names), tuple(self._parents), positions, tuple(self._axes))


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
