"""The prior of hands: postures of the fingers, and wrists that move.

The motion capture of the prior has stiff wrists and no fingers. Fingers get the Gaussian of priors/hands.yaml, which
training/hand_prior.py writes, the right hand's mirrored. It is used for skeletons with SMPL-H's finger joints.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.roles import FINGER_JOINTS, SIDES
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.yaml_files import shipped_mapping

WRIST_DEVIATION, WRIST_MOTION = (0.5, 0.2, 0.35), 0.02
"""rad about x (the forearm's twist), y and z (flexion); and rad per frame at 60 Hz."""
HAND_MOTION = 0.03
"""rad per frame: of a hand alone."""
OTHER_DEVIATION, OTHER_MOTION = 0.05, 0.004
"""rad: of axes about which a finger's joint hardly turns, in a skeleton whose joints are not locked."""


def add_hands(skeleton: Skeleton, mean: np.ndarray, covariance: np.ndarray, motion: np.ndarray) -> None:
    """Write the prior of each hand that the skeleton has into mean (n, 3), covariance (3 n, 3 n) and motion (3 n,)."""
    for side in SIDES:
        if {f"{side}_wrist", *(f"{side}_{joint}" for joint in FINGER_JOINTS)} <= set(skeleton.joint_names):
            _add_fingers(skeleton, side, mean, covariance, motion)
            wrist = skeleton.index(f"{side}_wrist")
            own = slice(3 * wrist, 3 * wrist + 3)
            if wrist == 0:
                motion[own] = HAND_MOTION
                continue
            covariance[own] = covariance[:, own] = 0.0
            covariance[own, own] = np.diag(np.square(WRIST_DEVIATION))
            motion[own] = WRIST_MOTION


def _add_fingers(skeleton: Skeleton, side: str, mean: np.ndarray, covariance: np.ndarray, motion: np.ndarray) -> None:
    data = shipped_mapping("lassokin_ros.core.evidence", "priors/hands.yaml")
    fingers = [skeleton.index(f"{side}_{joint}") for joint in FINGER_JOINTS]
    every = (3 * np.array(fingers)[:, None] + np.arange(3)).ravel()
    covariance[every] = covariance[:, every] = 0.0
    covariance[every, every] = OTHER_DEVIATION**2
    motion[every] = OTHER_MOTION
    angles = [name.split("_") for name in data["angles"]]
    places = [3 * skeleton.index(f"{side}_{joint}") + "xyz".index(axis) for joint, axis in angles]
    mirror = np.array([1.0 if side == SIDES[0] or axis == "x" else -1.0 for _, axis in angles])
    own = np.zeros((len(places), len(places)))
    own[np.tril_indices(len(places))] = np.concatenate([np.array(row, dtype=float) for row in data["covariance"]])
    own += np.tril(own, -1).T
    mean.reshape(-1)[places] = mirror * data["mean"]
    covariance[np.ix_(places, places)] = own * np.outer(mirror, mirror)
    motion[places] = data["motion"]
