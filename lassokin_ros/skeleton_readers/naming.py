"""Map the joint names of other programs to ours.

names.yaml contains the names. The joints of another program are connected as in our own tree (SMPL's): only their
positions are taken from the file's tree, so that additional joints, and fingers, are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.yaml_files import check_keys, load_mapping, read_text
from lassokin_ros.skeleton_readers.rest_pose import OURS, SIDES, RestTree

OWN_NAMES = "lassokin_ros"
ROOT_JOINTS = ("root_x", "root_y", "root_z")
"""Names in our own URDF of the three prismatic joints for the translation of the pelvis, m."""
REQUIRED = (
    "pelvis",
    "neck",
    "head",
    *(f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for side in SIDES),
)
"""Required joints. Neck and pelvis are derived from the others if they are missing. A missing spine joint, collar, hand
or foot is left out."""
MOST_LISTED, MOST_EXAMPLES = 60, 3
"""Number of the file's joints that an error lists, and of lines in its example of a file of names."""


@cache
def tables() -> dict[str, dict[str, str]]:
    """{program: {our joint: its name there}}, our own names first."""
    text = (resources.files(__package__) / "names.yaml").read_text(encoding="utf-8")
    own = {joint: joint for joint in Skeleton.load(OURS, 1.0).joint_names}
    result = {OWN_NAMES: own}
    for program, names in load_mapping(text, "names.yaml", SkeletonError).items():
        left_and_right = {
            joint.replace("SIDE", side): name.replace("SIDE", given) for joint, name in names["joints"].items()
            for side, given in zip(SIDES, names["sides"])
        }  # fmt: skip
        result[program] = left_and_right
    return result


def in_our_names(tree: RestTree, source: str) -> RestTree | None:
    """Return the tree with our names, parents and orders of rotations; None if the names are of no known program.

    A file beside `source` (see `names_file`) adds names. A missing pelvis is placed where the legs meet, a missing neck
    above the middle of the shoulders. Raises SkeletonError if other required joints are missing.
    """
    exact = {program: _exact(tree, names) for program, names in tables().items()}
    program = max(exact, key=lambda key: _score(exact[key]))
    found, given = exact[program], _given(tree, Path(source))
    if given or not found.keys() >= set(REQUIRED):
        relaxed = {name: _relaxed(tree, names) for name, names in tables().items()}
        other = max(relaxed, key=lambda key: _score(relaxed[key]))
        if _score(relaxed[other]) > _score(found):
            program, found = other, relaxed[other]
        return _completed(tree, {**found, **given}, program, source, bool(given))
    if program == OWN_NAMES:
        return _with_more_joints(tree, found) or _in_our_tree(tree, found, own_orders=True)
    return _in_our_tree(tree, found, own_orders=False)


def with_our_orders(tree: RestTree) -> RestTree:
    """Return the tree with our orders of rotations at joints with our names; those of a file are the file format's."""
    ours = Skeleton.load(OURS, 1.0)
    known = dict(zip(ours.joint_names, ours.axes))
    return replace(tree, axes=tuple(known.get(name.split(":")[-1], axes) for name, axes in zip(tree.names, tree.axes)))


def names_file(path: Path) -> Path:
    """Return the file beside a skeleton file that maps our joints to its names: `walk.names.yaml` of `walk.bvh`."""
    return path.with_suffix(".names.yaml")


def _score(found: Mapping[str, int]) -> tuple[int, int]:
    return len(found.keys() & set(REQUIRED)), len(found)


def _exact(tree: RestTree, names: Mapping[str, str]) -> dict[str, int]:
    """Return {our joint: index in the tree} for unchanged names, except for a namespace ("mixamorig:Hips")."""
    places = {name.split(":")[-1]: index for index, name in reversed(list(enumerate(tree.names)))}
    return {joint: places[name] for joint, name in names.items() if name in places}


def _relaxed(tree: RestTree, names: Mapping[str, str]) -> dict[str, int]:
    """Return the same, ignoring case, separators, and a common prefix of the names."""
    plain = [_plain(name) for name in tree.names]
    wanted = {joint: _plain(name) for joint, name in names.items()}
    ends = [(name, end) for end in (wanted["pelvis"], wanted["head"]) for name in plain if name.endswith(end)]
    prefixes = dict.fromkeys(["", *(name.removesuffix(end) for name, end in ends)])
    candidates = []
    for prefix in prefixes:
        places = {name.removeprefix(prefix): index for index, name in reversed(list(enumerate(plain)))}
        candidates.append({joint: places[name] for joint, name in wanted.items() if name in places})
    return max(candidates, key=_score)


def _plain(name: str) -> str:
    return re.sub(r"[\s_.-]", "", re.split(r"[:|]", name)[-1]).casefold()


def _given(tree: RestTree, path: Path) -> dict[str, int]:
    """Return {our joint: index in the tree} of the file of names; empty if there is none. Raises SkeletonError."""
    file = names_file(path)
    if not file.is_file():
        return {}
    data = load_mapping(read_text(file, SkeletonError), str(file), SkeletonError)
    check_keys(data, tuple(tables()[OWN_NAMES]), str(file), SkeletonError)
    for joint, name in data.items():
        if str(name) not in tree.names:
            raise SkeletonError(f"{file}: {joint} is '{name}', which is no joint of {path}; {_listing(tree)}")
    return {joint: tree.names.index(str(name)) for joint, name in data.items()}


def _listing(tree: RestTree) -> str:
    more = ", ..." if len(tree.names) > MOST_LISTED else ""
    return f"its joints are: {', '.join(tree.names[:MOST_LISTED])}{more}"


def _completed(tree: RestTree, found: dict[str, int], program: str, source: str, names_given: bool) -> RestTree | None:
    """Return the tree in our names after adding pelvis and neck where they are missing; see `in_our_names`."""
    if "pelvis" not in found and {"left_hip", "right_hip"} <= found.keys():
        found["pelvis"] = _common_joint(tree, found["left_hip"], found["right_hip"])
    if "neck" not in found and {"left_shoulder", "right_shoulder", "head"} <= found.keys():
        tree, found["neck"] = _with_neck(tree, found), len(tree.names)
    missing = [joint for joint in REQUIRED if joint not in found]
    if len(missing) > len(REQUIRED) // 2 and not names_given:
        return None
    if missing:
        theirs = ", ".join(tables()[program].get(joint, joint) for joint in missing)
        lines = ", ".join(f"'{joint}: NAME'" for joint in missing[:MOST_EXAMPLES])
        raise SkeletonError(
            f"{source} has the joint names of {program}, but not {theirs}; write their names in the file to "
            f"'{names_file(Path(source)).name}' beside it, in lines such as {lines}; {_listing(tree)}"
        )
    return _in_our_tree(tree, found, own_orders=False)


def _common_joint(tree: RestTree, one: int, other: int) -> int:
    """Return the lowest joint above both; the root if there is no other."""
    above = set()
    while one >= 0:
        one = tree.parents[one]
        above.add(one)
    while other > 0 and other not in above:
        other = tree.parents[other]
    return max(other, 0)


def _with_neck(tree: RestTree, found: Mapping[str, int]) -> RestTree:
    """Return the tree with a neck as its last joint, between the middle of the shoulders and the head."""
    ours = Skeleton.load(OURS, 1.0)

    def middle(positions: np.ndarray, left: int, right: int) -> np.ndarray:
        between: np.ndarray = 0.5 * (positions[left] + positions[right])
        return between

    rest = ours.rest_positions
    start = middle(rest, ours.index("left_shoulder"), ours.index("right_shoulder"))
    way = rest[ours.index("head")] - start
    fraction = (rest[ours.index("neck")] - start) @ way / (way @ way)
    base = middle(tree.positions, found["left_shoulder"], found["right_shoulder"])
    neck = base + fraction * (tree.positions[found["head"]] - base)
    parent = tree.parents[found["head"]]
    return RestTree(
        (*tree.names, "neck"), (*tree.parents, parent), np.vstack([tree.positions, neck]), (*tree.axes, "xzy")
    )


def _with_more_joints(tree: RestTree, found: dict[str, int]) -> RestTree | None:
    """Return the file's tree, our joints first and in our order; None if another joint is above one of ours."""
    places = [found[joint] for joint in tables()[OWN_NAMES] if joint in found]
    places += [place for place in range(len(tree.names)) if place not in places]
    parents = [places.index(tree.parents[place]) if tree.parents[place] >= 0 else -1 for place in places]
    if any(parent >= joint for joint, parent in enumerate(parents)):
        return None
    ours = {place: joint for joint, place in found.items()}  # without the part before a colon
    names = tuple(ours.get(place, tree.names[place]) for place in places)
    axes = tuple(tree.axes[place] for place in places)
    return RestTree(names, tuple(parents), tree.positions[places], axes)


def _in_our_tree(tree: RestTree, found: dict[str, int], own_orders: bool) -> RestTree:
    ours = Skeleton.load(OURS, 1.0)
    names = [joint for joint in ours.joint_names if joint in found]
    parents = []
    for joint in names:
        above = int(ours.parents[ours.index(joint)])
        while above >= 0 and ours.joint_names[above] not in found:
            above = int(ours.parents[above])
        parents.append(-1 if above < 0 else names.index(ours.joint_names[above]))
    places = [found[joint] for joint in names]
    # The orders of rotations of other programs have other purposes; ours keep everyday poses away from gimbal lock.
    axes = [tree.axes[found[joint]] if own_orders else ours.axes[ours.index(joint)] for joint in names]
    return RestTree(tuple(names), tuple(parents), tree.positions[places], tuple(axes))
