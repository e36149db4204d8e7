"""Proportions of a skeleton: about a dozen log-lengths, the same left and right, and their effect on the body."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.roles import LENGTHS, without_side
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.record import record


@record
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
