"""Learn how people's lengths go together, and write it with its provenance.

    python -m training.lengths --data DIR --output lassokin_ros/core/evidence/priors/capture_lengths.yaml

DIR holds `mocap` and `corpus`, see training/motion.py. The lengths are those of the people of the CMU database, one
sample per person, as log-lengths about the built-in proportions of the same height.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from benchmarks.data.mocap import Clip, clip_height, clip_skeleton, load_clip
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.skeleton import Skeleton
from training.depth import LICENCES
from training.motion import TEST, VALIDATION, training_sources

COLLECTIONS = ("mocap", "cy", "mu", "mx")
"""Collections in which each person has the own bone lengths."""
LEFT_OUT = ("ad", "exp", "fair1")
"""Persons of these collections that are no single person of CMU's."""
SHRINKAGE, FLOOR = 0.3, 0.02
"""Share of the covariance's diagonal that is mixed in, and smallest standard deviation: the people are few."""
MOST = 0.6
"""Largest log-length. A length of zero (two joints in one place) has none."""

HEADER = """\
# Log-lengths of people (0 = the built-in proportions of the same height): mean, and covariance, lower triangle by rows.
# The names are those of lassokin_ros/core/body/proportions.py. Written by training/lengths.py; do not edit.
# {licence}
# People: {people}. Shrinkage to the diagonal {shrinkage}, floor of the spreads {floor}.
"""


def log_lengths(clip: Clip) -> tuple[tuple[str, ...], np.ndarray]:
    """(names, (p,) log-lengths) of a clip's person about the built-in proportions."""
    skeleton = Skeleton.load("anthropometric", clip_height(clip))
    proportions = Proportions(Kinematics(skeleton, Layout.load("coco17", skeleton)))
    offsets = clip_skeleton(clip, generic=False).offsets
    sizes = [
        [np.linalg.norm(of, axis=1).sum() for of in (np.where(part != 0, offsets, 0.0), part)]
        for part in proportions.parts
    ]
    own, built_in = np.array(sizes).T
    return proportions.names, np.clip(np.log(np.maximum(own, 1e-6) / built_in), -MOST, MOST)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds mocap and corpus")
    parser.add_argument("--output", type=Path, required=True, help="YAML file to write")
    parser.add_argument("--hold-out", default=",".join((*TEST, *VALIDATION)), help="people left out, comma-separated")
    options = parser.parse_args()
    lengths = defaultdict(list)
    names: tuple[str, ...] = ()
    for source in training_sources(options.data, options.hold_out.split(",")):
        if source.collection in COLLECTIONS and source.person not in LEFT_OUT:
            names, found = log_lengths(load_clip(source.file))
            lengths[source.person].append(found)
    samples = np.array([np.mean(own, axis=0) for own in lengths.values()])
    covariance = np.cov(samples.T)
    variances = np.diag(covariance)
    covariance = (1 - SHRINKAGE) * covariance + np.diag(SHRINKAGE * variances + FLOOR**2)
    text = HEADER.format(licence=LICENCES[0], people=", ".join(sorted(lengths)), shrinkage=SHRINKAGE, floor=FLOOR)
    text += f"names: [{', '.join(names)}]\nmean: [{', '.join(f'{value:.3f}' for value in samples.mean(0))}]\n"
    rows = (", ".join(f"{value:.5f}" for value in row[: i + 1]) for i, row in enumerate(covariance))
    options.output.write_text(text + "covariance:\n" + "".join(f"  - [{row}]\n" for row in rows), encoding="utf-8")
    print(f"{len(samples)} people -> {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
