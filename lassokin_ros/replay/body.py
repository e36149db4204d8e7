"""A person's body: the capsules by which it is drawn, and the floor under its feet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lassokin_ros.core.body.roles import BONES, SIDES, Bone, is_finger
from lassokin_ros.core.body.skeleton import Skeleton

Capsule = tuple[int, int, float, str]
"""Joints at both ends, radius in m, and "left", "right" or "middle"."""
HANDS = tuple(Bone(f"{side}_wrist", f"{side}_hand", radius=0.016) for side in SIDES)
"""They are shown, but have no mass and no surface for a depth camera: keypoints end at the wrists."""
FINGER_RADIUS = 0.0045
"""/ height, of the bones of the hand in a skeleton with fingers."""
LEAST_STANDING = 0.1
"""Share of the frames in which a foot must stand still for these frames alone to give the floor."""
STANDING_PERCENTILE = 20
"""Otherwise, percentile of the lowest foot's height over time: people jump, and lie in few frames."""
SOLE = 0.012
"""Height of a foot joint above the floor, as a fraction of the person's height."""
FEET = ("_foot", "_ankle")
LYING = np.cos(np.radians(45.0))
"""Cosine between trunk and vertical below which a person lies, kneels on the hands, or bridges."""
FLESH = {"wrist": 0.012, "hand": 0.01, "elbow": 0.02, "knee": 0.03, "shoulder": 0.04, "neck": 0.04, "head": 0.05}
FLESH |= {"hip": 0.05, "pelvis": 0.05, "spine": 0.06, "collar": 0.05}
"""Height of a joint above the floor on which it rests, as a fraction of the person's height."""


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


def floor_of(skeleton: Skeleton, frames: Mapping[str, np.ndarray], level: np.ndarray) -> float:
    """Return the floor's height above the camera, m; NaN if no foot is observed in half of the frames.

    It is the median height of the lowest foot while a foot stands still; of people who lie in most frames, or support
    themselves with the hands, that of what rests on the floor, whichever part of the body it is.

    frames: `joint_positions` (f, n, 3) m in the camera frame, `joint_observed` (f, n) bool and `joint_contacts` (f, n)
    bool, ankles of feet that stand still. level: (3, 3) rotation from the camera frame to that of a level camera.
    """
    names, height, positions = skeleton.joint_names, skeleton.height, frames["joint_positions"]
    observed, contacts = frames["joint_observed"], frames["joint_contacts"]
    heights = -(positions @ level[1])
    lying = _lying(names, positions, level)
    if len(lying) and lying.mean() > 0.5:
        flesh = np.array([FLESH.get(_part(name), SOLE) for name in names]) * height
        lowest = np.where(observed, heights - flesh, np.inf).min(axis=1)[lying]
        return float(np.median(lowest[np.isfinite(lowest)])) if np.isfinite(lowest).any() else float("nan")
    feet = [i for i, name in enumerate(names) if name.endswith(FEET)]
    seen: np.ndarray = np.any(observed[:, feet], axis=1)
    if not len(seen) or seen.mean() < 0.5:
        return float("nan")
    lowest, standing = heights[seen][:, feet].min(axis=1), contacts[seen].any(axis=1)
    enough = standing.mean() >= LEAST_STANDING
    found = np.median(lowest[standing]) if enough else np.percentile(lowest, STANDING_PERCENTILE)
    return float(found) - SOLE * height


def _lying(names: Sequence[str], positions: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Return (f,) bool: the trunk is far from upright."""
    if not {"pelvis", "neck"} <= set(names):
        return np.zeros(len(positions), dtype=bool)
    trunk = positions[:, names.index("neck")] - positions[:, names.index("pelvis")]
    return np.asarray(-(trunk @ level[1]) < LYING * np.linalg.norm(trunk, axis=1))


def _part(name: str) -> str:
    """Return the part of the body: 'elbow' of left_elbow, 'spine' of spine2."""
    return name.removeprefix("left_").removeprefix("right_").rstrip("0123456789")
