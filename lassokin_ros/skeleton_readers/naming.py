"""Other programs' joint names to ours.

The names stand in names.yaml. What is found of another program's is hung into our own tree (SMPL's): of the file's tree
only the places of the joints are used, so that joints in between, and fingers, do no harm.
"""

from __future__ import annotations

from functools import cache
from importlib import resources

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.yaml_files import load_mapping
from lassokin_ros.skeleton_readers.rest_tree import RestTree

OURS = "anthropometric"
"""The built-in skeleton, whose tree and names are SMPL's."""
OWN_NAMES = "lassokin_ros"
SIDES = ("left", "right")
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
    places = {name.split(":")[-1]: index for index, name in reversed(list(enumerate(tree.names)))}  # "mixamorig:Hips"
    found = {
        program: {joint: places[name] for joint, name in names.items() if name in places}
        for program, names in tables().items()
    }
    needed = set(REQUIRED)
    program = max(found, key=lambda key: (len(found[key].keys() & needed), len(found[key])))
    missing = [tables()[program][joint] for joint in REQUIRED if joint not in found[program]]
    if len(missing) > len(REQUIRED) // 2:
        return None
    if missing:
        raise SkeletonError(
            f"{source} has the joint names of {program}, but not {', '.join(missing)}; rename the joints, or describe "
            "the skeleton in YAML"
        )
    if program == OWN_NAMES:
        return _with_more_joints(tree, found[program]) or _hung_into_our_tree(tree, found[program], own_orders=True)
    return _hung_into_our_tree(tree, found[program], own_orders=False)


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
