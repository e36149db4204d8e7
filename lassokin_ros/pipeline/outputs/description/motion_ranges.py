"""How far people's joints turn, as limits of the URDF's joints.

Ranges of motion: American Academy of Orthopaedic Surgeons, Joint Motion: Method of Measuring and Recording, 1965; the
rotation of the shin, the forefoot, the carrying angle and the collar bone: A. Kapandji, The Physiology of the Joints.
A ball joint's three angles are no goniometer's, so `MARGIN` is added on both sides. Published angles are not limited.
"""

from __future__ import annotations

import numpy as np

FINGERS = ("index", "middle", "ring", "pinky")
MARGIN = 10.0
"""Degrees."""
SPINE = {"x": (-12.5, 40.0), "y": (-22.5, 22.5), "z": (-17.5, 17.5)}
"""Half of thorax and loin together (extension 25, flexion 80, rotation 45, bending to the side 35): the model's three
joints share a bend, and one of them may take half of it."""
NECK = {"x": (-45.0, 45.0), "y": (-60.0, 60.0), "z": (-45.0, 45.0)}
"""Extension, flexion; rotation; to the side. Neck and head share it, and one of them may take all."""
RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "spine1": SPINE,
    "spine2": SPINE,
    "spine3": SPINE,
    "neck": NECK,
    "head": NECK,
    "hip": {"x": (-120.0, 30.0), "y": (-45.0, 45.0), "z": (-30.0, 45.0)},
    "knee": {"x": (0.0, 135.0), "y": (-30.0, 40.0), "z": (0.0, 0.0)},
    "ankle": {"x": (-20.0, 50.0), "y": (-20.0, 10.0), "z": (-35.0, 15.0)},
    "foot": {"x": (-70.0, 45.0), "y": (0.0, 0.0), "z": (0.0, 0.0)},
    "collar": {"x": (-45.0, 45.0), "y": (-30.0, 30.0), "z": (-10.0, 45.0)},
    "shoulder": {"x": (-90.0, 70.0), "y": (-135.0, 90.0), "z": (-135.0, 90.0)},
    "elbow": {"x": (-80.0, 80.0), "y": (-150.0, 0.0), "z": (0.0, 20.0)},
    "wrist": {"x": (0.0, 0.0), "y": (-20.0, 30.0), "z": (-80.0, 70.0)},
    "hand": {"x": (0.0, 0.0), "y": (0.0, 0.0), "z": (-90.0, 45.0)},
    **{f"{finger}1": {"x": (0.0, 0.0), "y": (-25.0, 25.0), "z": (-90.0, 45.0)} for finger in FINGERS},
    **{f"{finger}2": {"x": (0.0, 0.0), "y": (0.0, 0.0), "z": (-100.0, 0.0)} for finger in FINGERS},
    **{f"{finger}3": {"x": (0.0, 0.0), "y": (0.0, 0.0), "z": (-90.0, 10.0)} for finger in FINGERS},
    "thumb1": {"x": (-15.0, 70.0), "y": (-50.0, 50.0), "z": (-45.0, 45.0)},
    "thumb2": {"x": (0.0, 0.0), "y": (-10.0, 50.0), "z": (0.0, 0.0)},
    "thumb3": {"x": (0.0, 0.0), "y": (-15.0, 80.0), "z": (0.0, 0.0)},
}
"""Degrees about x (left), y (up) and z (front) of the T-pose, for the left side. The right side has y and z mirrored.

Hip, x: flexion, extension; y: inwards, outwards; z: adduction, abduction. Knee, x: flexion. Ankle, x: dorsal, plantar;
z: inversion, eversion. Shoulder, x: rotation outwards, inwards; y: across the chest 135, back 45, but with a hanging
arm it is the arm's rotation, 90; z: down to the side 90 and on to the other side 45, up 90. Elbow, x: rotation of the
forearm; y: flexion; z: carrying angle. Wrist, y: to the thumb, to the little finger; z: flexion, extension. Fingers, z:
flexion, extension; y: to the thumb, to the little finger. Thumb, y: extension, flexion; x of its root: abduction."""


def range_of(joint: str, axis: str) -> tuple[float, float] | None:
    """Return the least and the largest angle, rad, of a joint about an axis; None for a joint without a range."""
    side, _, part = joint.partition("_")
    ranges = RANGES.get(part if side in ("left", "right") else joint)
    if ranges is None:
        return None
    low, high = ranges[axis]
    if side == "right" and axis in "yz":
        low, high = -high, -low
    return float(np.radians(low - MARGIN)), float(np.radians(high + MARGIN))
