"""Learn the shipped pose prior from the training clips, and write it with its provenance.

    python -m training.pose_prior --data DIR --output lassokin_ros/core/evidence/priors/cmu.yaml

All clips have equal weight, and each pose is also used mirrored. The training clips are never used for a reported
accuracy.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.report import exit_code
from benchmarks.data.mocap import Clip, clip_skeleton, load_clips, true_state
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.proportions import other_side
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.body.skeleton import Skeleton

# Every third clip by name is kept for evaluation; these are the others.
TRAINING = (
    "01_01 01_06 02_02 02_03 02_06 02_07 07_05 11_01 131_03 13_29 14_20 49_18 exp_basketball_1 exp_jumping_1 "
    "exp_signal_1 exp_soccer_1 exp_traffic_4 exp_walking_1 gs_charleston1 gs_charleston2 gs_zombie"
).split()
SAME_TAKE = ("02_01", "exp_walking_1")
"""Two files of one recording in two collections: their joints rotate alike in each frame, to 0.1 rad in all."""
ON_OWN_BONES = "zc_13_29"
"""The take 13_29 with the person's own bone lengths, in another folder."""
SEEN = (*TRAINING, *(clip for clip in (*SAME_TAKE, ON_OWN_BONES) if clip not in TRAINING))
"""The clips that the shipped prior was learned from: the training clips, and other files of takes among them."""
FLOOR = 0.03  # rad: smallest spread, also for a degree of freedom that does not move in the capture
COLLAR_FLOOR = 0.05  # rad: the shoulders of the capture do not shrug, those of people do
SHRINKAGE = 0.10  # added to the diagonal, as a share: 21 clips are too few for all correlations


def rotation_vectors(clip: Clip) -> np.ndarray:
    """(f, 24, 3) rad: SMPL-like local rotation vectors of a clip."""
    skeleton = clip_skeleton(clip, generic=False)
    kinematics = Kinematics(skeleton, Layout.load("smpl24", skeleton))
    return logarithm(true_state(clip, kinematics).rotations)


def mirrored(vectors: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """The rotation vectors of the mirror image: sides exchanged, rotations about y and z reversed."""
    swap = [skeleton.index(other_side(name)) for name in skeleton.joint_names]
    return vectors[:, swap] * np.array([1.0, -1.0, -1.0])


def learn(clips: list[Clip]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(mean (24, 3), covariance (72, 72), motion (24, 3)) over clips of equal weight and their mirror images."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    first, second, motion = np.zeros(72), np.zeros((72, 72)), np.zeros((24, 3))
    for clip in clips:
        vectors = rotation_vectors(clip)
        for sample in (vectors, mirrored(vectors, skeleton)):
            flat = sample.reshape(len(sample), 72)
            first += flat.mean(0) / (2 * len(clips))
            second += flat.T @ flat / len(flat) / (2 * len(clips))
            motion += np.abs(np.diff(sample, axis=0)).mean(0) * (clip.fps / 60) / (2 * len(clips))
    covariance = second - np.outer(first, first)
    diagonal = np.diag(covariance)
    covariance = (1 - SHRINKAGE) * covariance + np.diag(SHRINKAGE * diagonal + FLOOR**2)
    collars = [3 * skeleton.index(f"{side}_collar") + axis for side in ("left", "right") for axis in range(3)]
    covariance[collars, collars] = np.maximum(covariance[collars, collars], COLLAR_FLOOR**2)
    return first.reshape(24, 3), covariance, motion


def mapping(mean: np.ndarray, covariance: np.ndarray, motion: np.ndarray) -> dict[str, Any]:
    """The format of PosePrior: without the root, the covariance as its lower triangle by rows."""
    return {
        "joints": list(Skeleton.load("anthropometric", 1.75).joint_names[1:]),
        "mean": mean[1:],
        "motion": motion[1:],
        "covariance": [covariance[3 + i, 3 : 4 + i] for i in range(69)],
    }


def write(path: Path, clips: list[Clip], prior: Mapping[str, Any]) -> None:
    """Write the format of `mapping` as YAML, rounded."""
    lines = [
        "# A Gaussian on the rotation vectors (rad, SMPL's tree and T-pose) of all joints but the pelvis, and the mean",
        "# size of their change per frame at 60 Hz (rad). Written by training/pose_prior.py; do not edit.",
        "# The data used in this project was obtained from mocap.cs.cmu.edu. The database was created with funding",
        "# from NSF EIA-0196217.",
        f"# Training clips, each with its mirror image, of equal weight: {', '.join(c.name for c in clips)}",
        f"# Shrinkage to the diagonal {SHRINKAGE}, floor of spreads {FLOOR} rad. covariance: lower triangle by rows.",
        f"joints: [{', '.join(prior['joints'])}]",
        "mean:",
        *(f"  - [{', '.join(f'{v:.4f}' for v in row)}]" for row in prior["mean"]),
        "motion:",
        *(f"  - [{', '.join(f'{v:.5f}' for v in row)}]" for row in prior["motion"]),
        "covariance:",
        *(f"  - [{', '.join(f'{v:.5g}' for v in row)}]" for row in prior["covariance"]),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of motion capture clips (*.npz)")
    parser.add_argument("--output", type=Path, required=True, help="YAML file to write")
    arguments = parser.parse_args()
    clips = load_clips(arguments.data, TRAINING)
    write(arguments.output, clips, mapping(*learn(clips)))
    print(f"{len(clips)} clips, {sum(len(c.standard) for c in clips)} frames -> {arguments.output}")


if __name__ == "__main__":
    sys.exit(exit_code(main))
