"""Proportions of a skeleton: about a dozen log-lengths, the same left and right, and their effect on the body; pairs of
names, and the symmetry of given lengths. If these are not symmetric, they were probably guessed and not measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.roles import LENGTHS, without_side
from lassokin_ros.core.body.skeleton import Skeleton


@dataclass(eq=False)
class LengthMotion:
    """Derivatives with respect to the log-lengths: of the landmarks (l, 3, p) and of the joints (n, 3, p), m."""

    landmarks: np.ndarray
    joints: np.ndarray


class Proportions:
    """The log-lengths (p,) of one skeleton, 0 = as given, and the offsets and landmark Jacobian that follow."""

    def __init__(self, kinematics: Kinematics) -> None:
        skeleton = kinematics.skeleton
        self._parent = np.maximum(skeleton.parents, 0)
        self._ancestors = skeleton.ancestors.astype(float)
        self._reach = self._ancestors[kinematics.layout.joints]
        moved = {name: self._reach @ np.abs(part).sum(-1) for name, part in _parts(skeleton).items()}
        self.names = tuple(name for name, motion in moved.items() if np.any(motion > 1e-6))
        self.use(skeleton)
        height = skeleton.rest_positions[:, 1]
        top, bottom = int(np.argmax(height)), int(np.argmin(height))
        path = skeleton.ancestors[top].astype(float) - skeleton.ancestors[bottom]
        #: (p,) share of each length in the stature at rest.
        self.stature_shares = self.parts[:, :, 1] @ path / max(height[top] - height[bottom], 1e-9)

    def use(self, given: Skeleton) -> None:
        """Use another skeleton with the same tree, such as one of another height. The lengths refer to it."""
        self.given, parts = given, _parts(given)
        #: (p, n, 3) m: the offsets that each length scales.
        self.parts = np.array([parts[name] for name in self.names]).reshape(-1, given.joint_count, 3)
        self._components = np.ascontiguousarray(np.moveaxis(self.parts, 0, -1))

    @property
    def count(self) -> int:
        """Number of lengths."""
        return len(self.names)

    def skeleton(self, lengths: np.ndarray) -> Skeleton:
        """The given skeleton with other lengths."""
        return self.given.with_offsets(self.offsets(lengths))

    def offsets(self, lengths: np.ndarray) -> np.ndarray:
        """Rest offsets (..., n, 3) m for log-lengths (..., p)."""
        scaled: np.ndarray = np.expm1(lengths) @ self.parts.reshape(self.count, self.given.offsets.size)
        return self.given.offsets + scaled.reshape(*scaled.shape[:-1], -1, 3)

    def motion(self, pose: BodyPose, lengths: np.ndarray) -> LengthMotion:
        """Derivatives of the body's points with respect to the log-lengths, in the pose's frame, root fixed."""
        by_offset = pose.orientations.take(self._parent, axis=0) @ (self._components * np.exp(lengths))
        bones = by_offset.reshape(len(by_offset), -1)
        moved = [(reach @ bones).reshape(len(reach), 3, self.count) for reach in (self._reach, self._ancestors)]
        return LengthMotion(*moved)


def _parts(skeleton: Skeleton) -> dict[str, np.ndarray]:
    """(n, 3) m: the offsets that belong to each length. A joint that is in no table gets a separate length."""
    names = skeleton.joint_names
    groups = {length: (list(joints), axes) for length, (joints, axes) in LENGTHS.items()}
    known = {joint for joints, _ in groups.values() for joint in joints}
    for name in (name for name in names if name not in known):
        kind = without_side(name)
        groups[kind] = ([*groups.get(kind, ([], ""))[0], name], "xyz")
    parts = {}
    for length, (joints, axes) in groups.items():
        part = np.zeros((skeleton.joint_count, 3))
        components = ["xyz".index(axis) for axis in axes]
        for joint in (names.index(joint) for joint in joints if joint in names):
            part[joint, components] = skeleton.offsets[joint, components]
        if part.any():
            parts[length] = part
    return parts


LARGEST_ASYMMETRY = 0.045
"""Asymmetry above which lengths count as guesses: fits to motion capture have up to 0.043, 5 % random errors 0.07."""


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
