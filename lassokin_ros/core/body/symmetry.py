"""Left and right of a body: pairs of names, and the symmetry of their lengths.

If the lengths of a given skeleton are not symmetric, they were probably guessed and not measured.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton

LARGEST_ASYMMETRY = 0.045
"""Asymmetry above which a skeleton's lengths count as guesses. Skeletons fitted to motion capture have up to 0.043;
lengths with independent random errors of 5 % have about 0.07."""


def other_side(name: str) -> str:
    """Swap left and right: left_knee for right_knee, mouth_right for mouth_left. Names without a side do not change."""
    for side, other in (("left", "right"), ("right", "left")):
        if name.startswith(f"{side}_"):
            return other + name.removeprefix(side)
        if name.endswith(f"_{side}"):
            return name.removesuffix(side) + other
    return name


def partners(names: Sequence[str]) -> np.ndarray:
    """(n,) index of each name's counterpart on the other side, its own without one."""
    places = {name: index for index, name in enumerate(names)}
    return np.array([places.get(other_side(name), index) for index, name in enumerate(names)], dtype=int)


def limb_groups(skeleton: Skeleton) -> np.ndarray:
    """(n,) group number of each joint: one for both arms, one for both legs, -1 for the trunk."""
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
    """Root mean square of log(left / right) over the pairs of bones; 0 if there are no pairs."""
    paired, ratios = _ratios(skeleton)
    return float(np.sqrt(np.mean(ratios[paired] ** 2))) if paired.any() else 0.0


def symmetric_skeleton(skeleton: Skeleton, average: bool) -> tuple[Skeleton, float]:
    """The skeleton with which calibration starts, and the difference of its sides if they were averaged, else 0.

    Both sides are averaged if `average` is set and their difference exceeds `LARGEST_ASYMMETRY`.
    """
    difference = asymmetry(skeleton)
    if average and difference > LARGEST_ASYMMETRY:
        return symmetrised(skeleton), difference
    return skeleton, 0.0


def symmetrised(skeleton: Skeleton) -> Skeleton:
    """The skeleton with both bones of each pair at their geometric mean length; directions do not change."""
    _, ratios = _ratios(skeleton)
    return skeleton.with_bone_scales(np.exp(-0.5 * ratios))


def _ratios(skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """For the bone that ends in each joint, (n,) each: whether it has a partner, and log(length / partner's length)."""
    others, lengths = partners(skeleton.joint_names), np.linalg.norm(skeleton.offsets, axis=1)
    paired = (others != np.arange(len(lengths))) & (lengths > 0) & (lengths[others] > 0)
    ratios = np.zeros(len(lengths))
    ratios[paired] = np.log(lengths[paired] / lengths[others[paired]])
    return paired, ratios
