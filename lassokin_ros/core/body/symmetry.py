"""A body's left and right: which is which, and that they are about as long.

Where a given skeleton's are not, they were guessed, not measured.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton

LARGEST_ASYMMETRY = 0.045
"""Asymmetry above which a skeleton's lengths are taken for guesses. Skeletons that were fitted to motion capture have
up to 0.043; lengths that are 5 % off, each at random, have about 0.07."""


def other_side(name: str) -> str:
    """left_knee for right_knee, mouth_left for mouth_right, and the other way round; a name without a side as it is."""
    for side, other in (("left", "right"), ("right", "left")):
        if name.startswith(f"{side}_"):
            return other + name.removeprefix(side)
        if name.endswith(f"_{side}"):
            return name.removesuffix(side) + other
    return name


def limb_groups(skeleton: Skeleton) -> np.ndarray:
    """(n,) of each joint a number that both arms' joints share, both legs', and all joints of the trunk (-1)."""
    names = skeleton.joint_names
    limbs = np.full(len(names), -1)
    for joint, (name, parent) in enumerate(zip(names, skeleton.parents)):
        other = other_side(name)
        if parent >= 0 and limbs[parent] >= 0:
            limbs[joint] = limbs[parent]
        elif other != name and other in names:
            limbs[joint] = min(joint, names.index(other))
    return limbs


def asymmetry(skeleton: Skeleton) -> float:
    """Root mean square over the pairs of bones of log(left / right); 0 without pairs."""
    paired, ratios = _ratios(skeleton)
    return float(np.sqrt(np.mean(ratios[paired] ** 2))) if paired.any() else 0.0


def symmetrised(skeleton: Skeleton) -> Skeleton:
    """The skeleton with both bones of each pair as long as their geometric mean; directions stay as given."""
    _, ratios = _ratios(skeleton)
    return skeleton.with_bone_scales(np.exp(-0.5 * ratios))


def _ratios(skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """(n,) of the bone that ends in each joint: is it one of a pair, and the log of its length over the other one's."""
    names, lengths = skeleton.joint_names, np.linalg.norm(skeleton.offsets, axis=1)
    places = {name: joint for joint, name in enumerate(names)}
    others = np.array([places.get(other_side(name), joint) for joint, name in enumerate(names)])
    paired = (others != np.arange(len(names))) & (lengths > 0) & (lengths[others] > 0)
    ratios = np.zeros(len(names))
    ratios[paired] = np.log(lengths[paired] / lengths[others[paired]])
    return paired, ratios
