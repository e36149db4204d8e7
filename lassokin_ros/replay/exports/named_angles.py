"""Angles in degrees as people name them: flexion and abduction of the limbs, and the lean of the trunk.

They are computed from joint positions, so they do not depend on the axes of a skeleton's joints; those of fingers and,
with fingers, of the wrists from their joints' rotations. In a T-pose all angles are 0 but the abduction of the
shoulders (90).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.body.roles import is_finger
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.replay.motion import Motion

SIDES = {"left": 1.0, "right": -1.0}
TRUNK = tuple(f"{side}_{joint}" for side in SIDES for joint in ("hip", "shoulder"))
HAND_ANGLES = {
    "wrist": (("flexion", 2, -1.0), ("radial deviation", 1, -1.0)),
    "finger1": (("MCP flexion", 2, -1.0), ("MCP deviation", 1, -1.0)),
    "finger2": (("PIP flexion", 2, -1.0),),
    "finger3": (("DIP flexion", 2, -1.0),),
    "thumb1": (("CMC flexion", 1, 1.0), ("CMC palmar abduction", 0, 1.0)),
    "thumb2": (("MCP flexion", 1, 1.0),),
    "thumb3": (("IP flexion", 1, 1.0),),
}
"""Name, axis (x, y, z) and sign of the angles of a joint of the left hand; the right one has y and z mirrored.
Deviations are positive to the thumb's side."""


def named_angles(motion: Motion) -> dict[str, np.ndarray]:
    """Return (f,) degrees by name, see `angles_of` and `finger_angles`."""
    names = motion.skeleton.joint_names
    angles = angles_of(names, motion["joint_positions"] @ motion.scene.level.T)
    return angles | finger_angles(names, motion["joint_rotations"]) if any(map(is_finger, names)) else angles


def finger_angles(names: Sequence[str], rotations: np.ndarray) -> dict[str, np.ndarray]:
    """Return (f,) degrees by the names of hand surgeons, such as "left_index PIP flexion".

    names: of n joints. rotations: (f, n, 3, 3), of each in its parent's frame.
    """
    angles: dict[str, np.ndarray] = {}
    for joint, name in enumerate(names):
        side, _, part = name.partition("_")
        if not is_finger(name) and part != "wrist":
            continue
        turn = np.degrees(logarithm(rotations[:, joint])) * [1.0, SIDES[side], SIDES[side]]
        for what, axis, sign in HAND_ANGLES.get(part) or HAND_ANGLES[f"finger{part[-1]}"]:
            angles[f"{name.rstrip('123')} {what}"] = sign * turn[:, axis]
    return angles


def angles_of(names: Sequence[str], positions: np.ndarray) -> dict[str, np.ndarray]:
    """Return (f,) degrees by name, such as "left_knee flexion"; NaN in degenerate poses.

    Knees and elbows: 0 if straight. Hips and shoulders: flexion in the trunk's sagittal plane, 0 hanging along the
    trunk, positive to the front; abduction positive outwards, of a hip from the sagittal plane, of a shoulder in the
    frontal plane. names: of n joints; angles whose joints are lacking are left out. positions: (f, n, 3) m in a level
    frame, y down.
    """
    place, angles = {name: positions[:, index] for index, name in enumerate(names)}, dict[str, np.ndarray]()
    trunk = _trunk(place) if set(TRUNK) <= place.keys() else None
    for side, sign in SIDES.items():
        for joint, above, below in (("knee", "hip", "ankle"), ("elbow", "shoulder", "wrist")):
            first, middle, last = (place.get(f"{side}_{part}") for part in (above, joint, below))
            if first is not None and middle is not None and last is not None:
                angles[f"{side}_{joint} flexion"] = _between(middle - first, last - middle)
        for joint, end in (("hip", "knee"), ("shoulder", "elbow")):
            if trunk is None or f"{side}_{end}" not in place:
                continue
            limb, (left, up, front) = place[f"{side}_{end}"] - place[f"{side}_{joint}"], trunk
            aside, along = sign * _dot(limb, left), _dot(limb, up)
            angles[f"{side}_{joint} flexion"] = _raised(_dot(limb, front), along)
            share = np.clip(aside / np.linalg.norm(limb, axis=-1), -1.0, 1.0)
            outwards = np.degrees(np.arcsin(share)) if joint == "hip" else _raised(aside, along)
            angles[f"{side}_{joint} abduction"] = outwards
    if {"neck", "pelvis"} <= place.keys():
        angles["trunk lean"] = _between(place["neck"] - place["pelvis"], np.array([0.0, -1.0, 0.0]))
    return angles


def _raised(aside: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the angle from down to `aside`, from -90 to 270 degrees, so that an arm held overhead does not wrap."""
    return np.asarray((np.degrees(np.arctan2(aside, -up)) + 90.0) % 360.0 - 90.0)


def _trunk(place: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the unit vectors (f, 3) to the person's left, along the trunk, and to the front."""
    hips = 0.5 * (place["left_hip"] + place["right_hip"])
    up = _unit(0.5 * (place["left_shoulder"] + place["right_shoulder"]) - hips)
    across = place["left_hip"] - place["right_hip"] + place["left_shoulder"] - place["right_shoulder"]
    left = _unit(across - _dot(across, up)[:, None] * up)
    return left, up, np.cross(left, up)


def _unit(vectors: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray((a * b).sum(axis=-1))


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angle between vectors (f, 3), degrees."""
    return np.degrees(np.arccos(np.clip(_dot(_unit(a), _unit(np.broadcast_to(b, a.shape))), -1.0, 1.0)))
