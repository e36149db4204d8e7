"""The rest pose of a BVH file: its HIERARCHY; the motion is not read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.skeleton import AXIS_ORDERS, Skeleton
from lassokin_ros.core.yaml_files import read_text
from lassokin_ros.skeleton_readers.naming import in_our_names
from lassokin_ros.skeleton_readers.rest_pose import in_metres, in_our_pose
from lassokin_ros.skeleton_readers.rest_tree import MOST_JOINTS, RestTree, to_skeleton


def read(path: Path, height: float) -> Skeleton:
    """The skeleton of a BVH file, for a person of `height` m. Raises SkeletonError.

    Names that are known (see naming) are hung into our tree, brought to metres and into a T-pose; a file with other
    names keeps its tree as it is, which then has to be in our axes and pose.
    """
    source = str(path)
    tree = parse_hierarchy(read_text(path, SkeletonError), source)
    named = in_our_names(tree, source)
    if named is None:
        return to_skeleton(in_metres(tree, height, source), height, source, path.stem)
    return to_skeleton(in_our_pose(in_metres(named, height, source), source), height, source, path.stem)


def parse_hierarchy(text: str, source: str) -> RestTree:
    """The tree in the file's own unit; text: the file's beginning, HIERARCHY whole. Raises SkeletonError."""
    head, separator, _ = text.partition("\nMOTION")
    words = iter(head.split())
    if next(words, "") != "HIERARCHY" or not separator:
        raise SkeletonError(f"{source} is no BVH file; expected HIERARCHY at its beginning and MOTION behind that")
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    axes: list[str] = []
    above: list[int] = []  # the open blocks' joints; -1 for an end site
    block = -1
    try:
        for word in words:
            if word in ("ROOT", "JOINT"):
                block = len(names)
                names.append(next(words))
                parents.append(above[-1] if above else -1)
                offsets.append([0.0, 0.0, 0.0])
                axes.append("xzy")
            elif word == "End":
                next(words)
                block = -1
            elif word == "{":
                above.append(block)
            elif word == "}":
                above.pop()
            elif word == "OFFSET":
                numbers = [float(next(words)) for _ in range(3)]
                if above[-1] >= 0:
                    offsets[above[-1]] = numbers
            elif word == "CHANNELS":
                channels = [next(words) for _ in range(int(next(words)))]
                axes[above[-1]] = _order(channels, axes[above[-1]])
            else:
                raise SkeletonError(f"{source}: '{word[:40]}' in HIERARCHY; expected JOINT, End Site, OFFSET, CHANNELS")
            if len(names) > MOST_JOINTS:
                raise SkeletonError(f"{source} has more than {MOST_JOINTS} joints")
    except SkeletonError:
        raise
    except (StopIteration, IndexError, ValueError):
        raise SkeletonError(f"{source}: its HIERARCHY is broken near joint {names[-1] if names else '0'}") from None
    if above or not names or parents.count(-1) != 1:
        raise SkeletonError(f"{source}: its HIERARCHY is broken; expected one ROOT, and as many }} as {{")
    positions = np.array(offsets)
    positions[0] = 0.0  # where a root stands at rest is nobody's bone
    for joint in range(1, len(names)):
        positions[joint] += positions[parents[joint]]
    if not np.isfinite(positions).all():
        raise SkeletonError(f"{source}: an OFFSET is not finite")
    return RestTree(tuple(names), tuple(parents), positions, tuple(axes))


def _order(channels: list[str], default: str) -> str:
    """The order of a joint's turns; the default where they are not three."""
    order = "".join(channel[0].lower() for channel in channels if channel.endswith("rotation"))
    return order if order in AXIS_ORDERS else default
