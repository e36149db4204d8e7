"""A body state from the joint positions of the depth network, as the start of a fit.

The pelvis is oriented by hips and shoulders, the bones of the limbs by the directions between the network's positions.
All other joints are as in the prior's mean pose.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.body.skeleton import Skeleton

BONES = tuple(
    (f"{side}_{start}", f"{side}_{end}")
    for side in ("left", "right")
    for start, end in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
)
"""Bones from the trunk outwards: the first joint is rotated so that the bone points to the second."""


def state_at(places: Mapping[str, np.ndarray], skeleton: Skeleton, mean: np.ndarray) -> BodyState:
    """The state, with translation 0, whose bones point along the given positions.

    places: (3,) m by joint name, camera frame, relative to the middle of the hips. mean: (n, 3, 3) local rotations.
    """
    rotations, names = mean.copy(), skeleton.joint_names
    rotations[0] = trunk_orientation(places)
    world = np.empty_like(rotations)
    bone_of = dict(BONES)
    for joint, parent in enumerate(skeleton.parents):
        above = np.eye(3) if parent < 0 else world[parent]
        world[joint] = above @ rotations[joint]
        end = bone_of.get(names[joint])
        if end in names:
            along = places[end] - places[names[joint]]
            bone = world[joint] @ skeleton.offsets[names.index(end)]
            if along.dot(along) > 1e-6 and bone.dot(bone) > 1e-6:
                world[joint] = least_turn(bone, along) @ world[joint]
                rotations[joint] = above.T @ world[joint]
    return BodyState(rotations, np.zeros(3))


def trunk_orientation(places: Mapping[str, np.ndarray]) -> np.ndarray:
    """(3, 3): x to the person's left, y up along the trunk, z to the front."""
    y = 0.5 * (places["left_shoulder"] + places["right_shoulder"])
    across = places["left_hip"] - places["right_hip"] + 0.5 * (places["left_shoulder"] - places["right_shoulder"])
    y = y / (np.linalg.norm(y) + 1e-9)
    x = across - across.dot(y) * y
    x = x / (np.linalg.norm(x) + 1e-9)
    return np.stack([x, y, np.cross(x, y)], axis=1)
