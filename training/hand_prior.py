"""Write the prior of hand postures: a Gaussian of the fingers' angles from a few independent causes.

    python -m training.hand_prior --output lassokin_ros/core/evidence/priors/hands.yaml

The means are those of a relaxed hand. The spreads cover the ranges of motion of the American Academy of Orthopaedic
Surgeons (Joint motion, 1965: knuckles 0 to 90 degrees, middle joints 0 to 100, last joints 0 to 80) within about two
standard deviations. All fingers bend together by a common part, which is half of the variance of hand postures
(Santello, Flanders and Soechting, Postural hand synergies for tool use, J. Neuroscience 18, 1998), and the last joint
of a finger with its middle one. No recording is used.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

FINGERS = ("index", "middle", "pinky", "ring")
MEAN = {"1_z": 0.45, "2_z": 0.70, "3_z": 0.42}
"""rad of flexion: of the knuckle, the middle and the last joint."""
TOGETHER = {"1_z": 0.30, "2_z": 0.42, "3_z": 0.25}
"""rad, standard deviations: of the part that all fingers share."""
OWN = ({"1_z": 0.40}, {"2_z": 0.42, "3_z": 0.25}, {"3_z": 0.15}, {"1_y": 0.16})
"""rad: of the parts of each finger."""
MOTION = {"1_y": 0.008, "1_z": 0.03, "2_z": 0.03, "3_z": 0.02}
"""rad per frame at 60 Hz: mean change."""
THUMB = {
    "thumb1_x": (0.0, 0.30, 0.02), "thumb1_y": (0.10, 0.30, 0.02), "thumb1_z": (0.0, 0.30, 0.02),
    "thumb2_y": (0.25, 0.30, 0.02), "thumb3_y": (0.35, 0.40, 0.02),
}  # fmt: skip
"""Mean, standard deviation and motion of the thumb's angles, which are independent."""


def prior() -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """(names of k angles of a left hand, mean (k,), covariance (k, k), motion (k,)), rad."""
    names = [f"{finger}{angle}" for finger in FINGERS for angle in MOTION] + list(THUMB)
    causes = [{f"{finger}{angle}": size for finger in FINGERS for angle, size in TOGETHER.items()}]
    causes += [{f"{finger}{angle}": size for angle, size in cause.items()} for finger in FINGERS for cause in OWN]
    causes += [{angle: values[1]} for angle, values in THUMB.items()]
    factors = np.array([[cause.get(name, 0.0) for cause in causes] for name in names])
    bends = np.array([-1.0 if name.endswith("_z") and "thumb" not in name else 1.0 for name in names])
    mean = [THUMB[name][0] if name in THUMB else MEAN.get(name[-3:], 0.0) for name in names]
    motion = [THUMB[name][2] if name in THUMB else MOTION[name[-3:]] for name in names]
    return names, bends * mean + 0.0, (factors @ factors.T) * np.outer(bends, bends) + 0.0, np.array(motion)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, required=True, help="YAML file to write")
    names, mean, covariance, motion = prior()
    lines = [
        "# A Gaussian on the rotation vectors of a left hand's joints about their free axes, rad (of a right hand, y",
        "# and z have the other sign), and the mean size of their change per frame at 60 Hz. Written by",
        "# training/hand_prior.py, which has the sources; do not edit. covariance: lower triangle by rows.",
        f"angles: [{', '.join(names)}]",
        f"mean: [{', '.join(f'{value:.3f}' for value in mean)}]",
        f"motion: [{', '.join(f'{value:.3f}' for value in motion)}]",
        "covariance:",
        *(f"  - [{', '.join(f'{v:.5g}' for v in row[: i + 1])}]" for i, row in enumerate(covariance)),
    ]
    parser.parse_args().output.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
