"""The roles of joints in a human body, as far as several modules use them.

A joint has a role by its name in SMPL's tree. A skeleton may lack some, or have further joints; evidence without its
roles is then off, and `missing_roles` says so.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

SIDES = ("left", "right")


def sided(*kinds: str) -> tuple[str, ...]:
    """Names of joints of both sides, for example left_hip and right_hip for "hip"."""
    return tuple(f"{side}_{kind}" for side in SIDES for kind in kinds)


def without_side(name: str) -> str:
    """The name without left or right: "hip" for "left_hip"."""
    return name.removeprefix("left_").removeprefix("right_")


class Bone(NamedTuple):
    """A part of the body between two joints.

    mass: share of the body's mass; centre: place of the centre of mass from the first joint to the second (Winter,
    Biomechanics and motor control of human movement, 2009, table 4.1; for the trunk, which has other joints here, 0.5).
    radius: of the capsule around the bone / height, None for none.
    """

    first: str
    last: str
    mass: float = 0.0
    centre: float = 0.0
    radius: float | None = None


def _both_sides(bone: Bone) -> list[Bone]:
    return [bone._replace(first=f"{side}_{bone.first}", last=f"{side}_{bone.last}") for side in SIDES]


BONES = (
    Bone("neck", "pelvis", 0.497, 0.5),
    Bone("head", "head", 0.081, 0.0),
    Bone("pelvis", "spine2", radius=0.060),
    Bone("spine2", "neck", radius=0.060),
    Bone("neck", "head", radius=0.036),
    Bone("left_hip", "right_hip", radius=0.055),
    Bone("left_shoulder", "right_shoulder", radius=0.038),
    *_both_sides(Bone("hip", "shoulder", radius=0.048)),
    *_both_sides(Bone("hip", "knee", 0.100, 0.433, 0.042)),
    *_both_sides(Bone("knee", "ankle", 0.0465, 0.433, 0.029)),
    *_both_sides(Bone("ankle", "foot", 0.0145, 0.5, 0.020)),
    *_both_sides(Bone("shoulder", "elbow", 0.028, 0.436, 0.027)),
    *_both_sides(Bone("elbow", "wrist", 0.022, 0.682, 0.021)),
)
LIMBS = tuple(sided_chain for side in SIDES for sided_chain in (
    tuple(f"{side}_{joint}" for joint in ("hip", "knee", "ankle")),
    tuple(f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist"))))  # fmt: skip
"""Chains of joints from the trunk outwards. Each joint except the last one rotates the bone to the next joint."""
LIMB_BONES = tuple(bone for limb in LIMBS for bone in zip(limb, limb[1:]))
FEET = sided("ankle", "foot")
ANKLES = sided("ankle")
PELVIS = "pelvis"
FINGERS = ("index", "middle", "pinky", "ring", "thumb")
FINGER_JOINTS = tuple(f"{finger}{number}" for finger in FINGERS for number in (1, 2, 3))
"""The joints of a hand in SMPL-H's order, from the knuckle outwards (of the thumb from its base), without the side."""


def is_finger(joint: str) -> bool:
    """Whether a joint is one of a finger."""
    return joint != without_side(joint) and without_side(joint) in FINGER_JOINTS


THICKNESS = {
    "hip": 0.055, "knee": 0.034, "ankle": 0.021, "foot": 0.018, "neck": 0.036, "head": 0.045, "shoulder": 0.040,
    "elbow": 0.025, "wrist": 0.016, "hand": 0.010, "pelvis": 0.060, "spine1": 0.060, "spine2": 0.060, "spine3": 0.060,
    **dict.fromkeys(FINGER_JOINTS, 0.005),
}  # fmt: skip
"""Half of the body's thickness at a joint / height, typical of adults in light clothing."""

LENGTHS = {
    "hip width": (sided("hip"), "x"),
    "hip drop": (sided("hip"), "yz"),
    "thigh": (sided("knee"), "xyz"),
    "shank": (sided("ankle"), "xyz"),
    "foot": (sided("foot"), "xyz"),
    "shoulder width": (sided("collar", "shoulder"), "x"),
    "shoulder height": (sided("collar", "shoulder"), "yz"),
    "upper arm": (sided("elbow"), "xyz"),
    "forearm": (sided("wrist"), "xyz"),
    "hand": (sided("hand", *FINGER_JOINTS), "xyz"),
    "trunk": (("spine1", "spine2", "spine3"), "xyz"),
    "neck": (("neck",), "xyz"),
    "head": (("head",), "xyz"),
}
"""The lengths that calibration learns: name -> (joints, components of their offsets from their parents)."""

STANDING_HEIGHT = {
    "head_top": 1.0, "nose": 0.93, "left_ear": 0.93, "right_ear": 0.93, "head": 0.9, "neck": 0.85, "left_shoulder":
    0.82, "right_shoulder": 0.82, "mid_hip": 0.53, "left_hip": 0.53, "right_hip": 0.53, "left_knee": 0.28, "right_knee":
    0.28, "left_ankle": 0.04, "right_ankle": 0.04,
}  # fmt: skip
"""Height of points of a standing person, in heights. Arms are left out, because they point anywhere."""

BALANCE_JOINTS = frozenset(joint for bone in BONES if bone.mass for joint in (bone.first, bone.last))
NETWORK_JOINTS = frozenset(("head", *sided("hip", "knee", "ankle", "shoulder", "elbow", "wrist")))
"""Joints without which the depth network cannot be used."""
PRIOR_JOINTS = frozenset((*sided("hip", "knee", "ankle", "collar", "shoulder", "elbow", "wrist"), "spine1", "spine2",
                          "spine3", "neck", "head"))  # fmt: skip
"""Joints with a pose prior learned from motion capture."""


def body_joints(names: Sequence[str]) -> np.ndarray:
    """(k,) index of the joints that are no fingers, for figures of whole bodies; of all in a hand alone."""
    own = np.flatnonzero(~np.isin(names, sided(*FINGER_JOINTS)))
    return own if len(own) > 1 else np.arange(len(names))


def of_body(names: Sequence[str]) -> np.ndarray:
    """(n,) bool: joints that a body with and without fingers has in common, as the depth network and the prior see it.

    Those of the hands, whose wrists are turned by other keypoints, are False; all are True without fingers, and in a
    hand alone.
    """
    own = ~np.isin(names, sided("wrist", *FINGER_JOINTS))
    return own if own.any() and any(map(is_finger, names)) else np.ones(len(names), dtype=bool)


def missing_roles(names: Collection[str]) -> str:
    """What is off for a skeleton with these joints, in one line; empty if nothing is."""
    if not set(names) - set(sided("wrist", "hand", *FINGER_JOINTS)):
        return ""  # a hand alone has no use for the roles of a body
    uses = (
        ("depth network", NETWORK_JOINTS),
        ("balance", BALANCE_JOINTS),
        ("pose prior of these joints", PRIOR_JOINTS),
    )
    off = [use for use, needed in uses if needed - set(names)]
    if not off:
        return ""
    joints = dict.fromkeys(joint for _, needed in uses for joint in sorted(needed - set(names)))
    return f"the skeleton has no joint {', '.join(joints)}; off: {', '.join(off)}. Name joints as SMPL does to use them"
