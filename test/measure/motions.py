"""Synthetic motions of a person who walks or squats, for the tests of `lassokin measure`."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from lassokin_ros.measure.poses import Poses

RATE, THIGH, SHANK = 50.0, 0.45, 0.42
LIMBS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
NAMES = ("pelvis", "neck", *(f"{side}_{joint}" for side in ("left", "right") for joint in LIMBS))


def body(seconds, thighs, knees, lean=0.0, speed=0.0, heading=0.0):
    """A person who faces the camera at heading 0. thighs: (f, 2) degrees to the front; knees: (f, 2) flexion."""
    front, up, left = np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    lean = np.radians(np.broadcast_to(lean, seconds.shape))[:, None]
    trunk = np.cos(lean) * up + np.sin(lean) * front
    legs, joints = {}, {}
    for number, (side, across) in enumerate((("left", left), ("right", -left))):
        thigh, shank = np.radians(thighs[:, number])[:, None], np.radians(thighs[:, number] - knees[:, number])[:, None]
        hip = np.tile(0.1 * across, (len(seconds), 1))
        knee = hip + THIGH * (np.sin(thigh) * front - np.cos(thigh) * up)
        legs[side] = knee + SHANK * (np.sin(shank) * front - np.cos(shank) * up)
        shoulder = 0.5 * trunk + 0.2 * across
        joints |= {f"{side}_hip": hip, f"{side}_knee": knee, f"{side}_ankle": legs[side], f"{side}_shoulder": shoulder}
        joints |= {f"{side}_elbow": shoulder - 0.3 * up, f"{side}_wrist": shoulder - 0.5 * up}
    joints |= {"pelvis": np.zeros((len(seconds), 3)), "neck": 0.5 * trunk}
    lowest = np.minimum(legs["left"] @ up, legs["right"] @ up)
    places = np.stack([joints[name] for name in NAMES], axis=1) - (lowest[:, None] * up)[:, None]
    places += (speed * seconds[:, None] * front)[:, None]
    turned = places @ Rotation.from_rotvec([0, heading, 0]).as_matrix().T + [0.3, 1.0, 4.0]
    return Poses(seconds, NAMES, turned, np.zeros(len(seconds), dtype=bool))


def walk(cadence=108.0, speed=1.3, swing=24.0, knee=55.0, seconds=6.0, heading=0.0):
    """The thighs swing by +-swing degrees; each knee bends by 5 to `knee` degrees."""
    t = np.arange(round(seconds * RATE)) / RATE
    phase = 2 * np.pi * cadence / 120 * t[:, None] + np.array([0.0, np.pi])
    return body(t, swing * np.cos(phase), 5 + (knee - 5) * (0.5 - 0.5 * np.cos(phase + 2.0)), 0.0, speed, heading)


def squats(depths=(100.0, 60.0, 90.0), period=3.0):
    """Squats with these flexions of the knees, one per period; the hips bend as far, the trunk leans by 0.4 of it."""
    t = np.arange(round(len(depths) * period * RATE)) / RATE
    which = np.minimum((t / period).astype(int), len(depths) - 1)
    bend = np.array(depths)[which] * np.clip(np.sin(2 * np.pi * (t / period - 0.25)), 0, None)
    return body(t, np.column_stack([0.5 * bend] * 2), np.column_stack([bend, bend]), 0.4 * bend)


def hidden(poses, *joints, seen=lambda seconds: np.zeros(len(seconds), dtype=bool)):
    """The motion with joints that no keypoint shows, but for the frames `seen`."""
    observed = np.ones(poses.positions.shape[:2], dtype=bool)
    observed[:, [NAMES.index(joint) for joint in joints]] = seen(poses.seconds)[:, None]
    return replace(poses, observed=observed)


def saved(path, *people, tilt=0.0):
    """An export with the motions of some people, in the frame of a camera that looks down by `tilt`."""
    level = Rotation.from_rotvec([tilt, 0, 0]).as_matrix()
    arrays = {
        "stamp_ns": np.concatenate([np.round(one.seconds * 1e9).astype(np.int64) + 10**9 for _, one in people]),
        "person": np.concatenate([[name] * len(one.seconds) for name, one in people]),
        "people": np.array([name for name, _ in people]),
        "joint_names": np.array(NAMES),
        "joint_positions": np.concatenate([one.positions @ level for _, one in people]),
        "level": level,
        "likely_wrong": np.concatenate([one.likely_wrong for _, one in people]),
        "joint_observed": np.concatenate(
            [
                one.observed if one.observed is not None else np.ones(one.positions.shape[:2], dtype=bool)
                for _, one in people
            ]
        ),
        "joint_contacts": np.concatenate([np.zeros(one.positions.shape[:2], dtype=bool) for _, one in people]),
        "start_ns": np.array(10**9),
    }
    np.savez(path, **arrays)
    return str(path)
