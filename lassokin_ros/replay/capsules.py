"""The body as capsules between joints, for the report, the output video and the viewer."""

from __future__ import annotations

from lassokin_ros.core.body.roles import BONES, SIDES, Bone, is_finger
from lassokin_ros.core.body.skeleton import Skeleton

Capsule = tuple[int, int, float, str]
"""Joints at both ends, radius in m, and "left", "right" or "middle"."""

HANDS = tuple(Bone(f"{side}_wrist", f"{side}_hand", radius=0.016) for side in SIDES)
"""They are shown, but have no mass and no surface for a depth camera: keypoints end at the wrists."""
FINGER_RADIUS = 0.0045
"""/ height, of the bones of the hand in a skeleton with fingers."""


def capsules(skeleton: Skeleton) -> list[Capsule]:
    """Return the capsules of a skeleton. Those whose joints it lacks are left out."""
    names, height = skeleton.joint_names, skeleton.height
    joints = [(joint, parent) for joint, parent in zip(names, skeleton.parents) if is_finger(joint)]
    fingers = tuple(Bone(names[parent], joint, radius=FINGER_RADIUS) for joint, parent in joints)
    return [
        (names.index(bone.first), names.index(bone.last), bone.radius * height, side_of(bone.first, bone.last))
        for bone in (*BONES, *(fingers or HANDS))
        if bone.radius and {bone.first, bone.last} <= set(names)
    ]


def side_of(a: str, b: str) -> str:
    """Return "left" or "right" for a limb between two joints, "middle" for the trunk."""
    side = a.split("_")[0]
    trunk = a.endswith("_hip") and b.endswith("_shoulder")
    return side if side in ("left", "right") and side == b.split("_")[0] and not trunk else "middle"
