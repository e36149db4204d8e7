"""Other programs' joint names to ours.

The names stand in names.yaml. What is found of another program's is hung into our own tree (SMPL's): of the file's tree
only the places of the joints are used, so that joints in between, and fingers, do no harm.
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
from lassokin_ros.core.yaml_files import load_mapping, read_text
from lassokin_ros.skeleton_readers.rest_tree import RestTree

OURS = "anthropometric"
"""The built-in skeleton, whose tree and names are SMPL's."""
OWN_NAMES = "lassokin_ros"
SIDES = ("left", "right")
NAMES_SUFFIX = ".names.yaml"
"""Of a file beside a skeleton, with the suffix replaced by this one, that maps our joints to the skeleton's."""
MOST_LISTED = 40
REQUIRED = (
    "pelvis",
    "neck",
    "head",
    *(f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for side in SIDES),
)
"""Without these nobody can be followed; a spine joint, collar, hand or foot that is missing is left out."""


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
    """The tree with our names, parents and orders of turns; None when the names are no known program's.

    Raises SkeletonError when they are, but joints that are needed are missing.
    """
    programs = _own_table(source) or tables()
    places = {name.split(":")[-1]: index for index, name in reversed(list(enumerate(tree.names)))}  # "mixamorig:Hips"
    program, found = _best(programs, places)
    if not found.keys() >= set(REQUIRED):
        other, loosely = _best_loosely(programs, tree.names)
        if _fit(loosely)[0] > _fit(found)[0]:
            program, found = other, loosely
    missing = [joint for joint in REQUIRED if joint not in found]
    if len(missing) > len(REQUIRED) // 2 and programs is tables():
        return None
    if missing == ["neck"]:
        tree, found = _with_neck(tree, found)
    elif missing:
        raise SkeletonError(
            _missing_text(tree, source, program, [(joint, programs[program][joint]) for joint in missing])
        )
    if program == OWN_NAMES:
        return _with_more_joints(tree, found) or _hung_into_our_tree(tree, found, own_orders=True)
    return _hung_into_our_tree(tree, found, own_orders=False)


def _best(programs: Mapping[str, Mapping[str, str]], places: Mapping[str, int]) -> tuple[str, dict[str, int]]:
    """Return the program most of whose names are there, and {our joint: index}."""
    found = {
        program: {joint: places[name] for joint, name in names.items() if name in places}
        for program, names in programs.items()
    }
    program = max(found, key=lambda key: _fit(found[key]))
    return program, found[program]


def _best_loosely(programs: Mapping[str, Mapping[str, str]], names: tuple[str, ...]) -> tuple[str, dict[str, int]]:
    """Return the same for names with a common prefix, in another case, or with other separators.

    The prefix is what stands before the name of the pelvis: "Bip01 Pelvis", "mixamorigHips", "Character1_Hips".
    """
    plain = [_plain(name.split(":")[-1]) for name in names]
    best: tuple[str, dict[str, int]] = OWN_NAMES, {}
    for program, theirs in programs.items():
        wanted = {joint: _plain(name) for joint, name in theirs.items()}
        root = wanted.get("pelvis", "")
        prefixes = {name.removesuffix(root) for name in plain[:MOST_LISTED] if name.endswith(root)}
        for prefix in sorted(prefixes, key=len):
            places = {name.removeprefix(prefix): index for index, name in reversed(list(enumerate(plain)))}
            found = {joint: places[name] for joint, name in wanted.items() if name in places}
            if _fit(found) > _fit(best[1]):
                best = program, found
    return best


def _fit(found: dict[str, int]) -> tuple[int, int]:
    """Return how many of the required joints are there, and how many joints."""
    return len(found.keys() & set(REQUIRED)), len(found)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _with_neck(tree: RestTree, found: dict[str, int]) -> tuple[RestTree, dict[str, int]]:
    """Add a neck between shoulders and head, where the built-in skeleton has it."""
    ours = Skeleton.load(OURS, 1.0)
    base, neck, head = (
        ours.rest_positions[[ours.index(joint) for joint in joints]].mean(axis=0)
        for joints in (("left_shoulder", "right_shoulder"), ("neck",), ("head",))
    )
    share = float((neck - base) @ (head - base) / ((head - base) @ (head - base)))
    shoulders = 0.5 * (tree.positions[found["left_shoulder"]] + tree.positions[found["right_shoulder"]])
    place = shoulders + share * (tree.positions[found["head"]] - shoulders)
    added = replace(
        tree,
        names=(*tree.names, "neck"),
        parents=(*tree.parents, tree.parents[found["head"]]),
        positions=np.vstack([tree.positions, place]),
        axes=(*tree.axes, ours.axes[ours.index("neck")]),
    )
    return added, {**found, "neck": len(tree.names)}


def _own_table(source: str) -> dict[str, dict[str, str]] | None:
    """Return the names from the file beside the skeleton, None if there is none. Raises SkeletonError."""
    file = names_file(source)
    if not file.is_file():
        return None
    data = load_mapping(read_text(file, SkeletonError), str(file), SkeletonError)
    ours = tables()[OWN_NAMES]
    for joint in (*data, *(joint for joint in REQUIRED if joint not in data and joint != "neck")):
        if joint not in ours or joint not in data:
            raise SkeletonError(f"{file}: joint '{joint}'; expected a name for each of {', '.join(REQUIRED)}")
    return {file.name: {str(joint): str(name) for joint, name in data.items()}}


def names_file(source: str) -> Path:
    """Return the path of the file with the names of a skeleton file's joints."""
    return Path(source).with_suffix(NAMES_SUFFIX)


def _missing_text(tree: RestTree, source: str, program: str, missing: list[tuple[str, str]]) -> str:
    lines = ", ".join(f"{joint}: ..." for joint, _ in missing)
    listed = ", ".join(name[:40] for name in tree.names[:MOST_LISTED])
    return (
        f"{source} has the joint names of {program}, but not {', '.join(name for _, name in missing)}; write our names "
        f"and the file's to {names_file(source).name} beside it ({lines}, and the others of docs/files.md), or "
        f"describe the skeleton in YAML; its joints are: {listed}"
    )


def _with_more_joints(tree: RestTree, found: dict[str, int]) -> RestTree | None:
    """The file's tree, our joints first and in our order; None where another joint stands above one of ours."""
    places = [found[joint] for joint in tables()[OWN_NAMES] if joint in found]
    places += [place for place in range(len(tree.names)) if place not in places]
    parents = [places.index(tree.parents[place]) if tree.parents[place] >= 0 else -1 for place in places]
    if any(parent >= joint for joint, parent in enumerate(parents)):
        return None
    ours = {place: joint for joint, place in found.items()}  # without what stands before a colon
    names = tuple(ours.get(place, tree.names[place]) for place in places)
    axes = tuple(tree.axes[place] for place in places)
    return RestTree(names, tuple(parents), tree.positions[places], axes)


def _hung_into_our_tree(tree: RestTree, found: dict[str, int], own_orders: bool) -> RestTree:
    ours = Skeleton.load(OURS, 1.0)
    names = [joint for joint in ours.joint_names if joint in found]
    parents = []
    for joint in names:
        above = int(ours.parents[ours.index(joint)])
        while above >= 0 and ours.joint_names[above] not in found:
            above = int(ours.parents[above])
        parents.append(-1 if above < 0 else names.index(ours.joint_names[above]))
    places = [found[joint] for joint in names]
    # Others' orders of turns are chosen for their own ends; ours keep everyday poses away from gimbal lock.
    axes = [tree.axes[found[joint]] if own_orders else ours.axes[ours.index(joint)] for joint in names]
    return RestTree(tuple(names), tuple(parents), tree.positions[places], tuple(axes))
