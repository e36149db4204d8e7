"""Learn how people's lengths go together, and write it with its provenance.

    python -m training.lengths --data DIR --output lassokin_ros/core/evidence/priors/lengths.yaml

DIR holds `mocap`, `corpus` and `detections`. The people are those of training/people.py; the mean is the built-in
body's, and the covariance is that of people about the mean of their source.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.data.body_lengths import LENGTHS
from training.people import (
    PERMITTED,
    Person,
    captured_people,
    for_the_model,
    model_names,
    people_covariance,
    provenance,
    recorded_people,
    row,
)

HEADER = """\
# Log-lengths of people (0 = the built-in proportions of the same height): mean, and covariance, lower triangle by rows.
# The names are those of lassokin_ros/core/body/proportions.py. Written by training/lengths.py; do not edit.
"""


def write_prior(file: Path, recorded: Sequence[Person], captured: Sequence[Person]) -> None:
    """Write the prior of the lengths about a built-in skeleton that has the proposed mean."""
    _, covariance = for_the_model(np.zeros(len(LENGTHS)), people_covariance([*recorded, *captured]))
    names = model_names()
    text = HEADER + provenance(recorded, captured)
    text += f"names: [{', '.join(names)}]\nmean: {row(np.zeros(len(names)))}\ncovariance:\n"
    text += "".join(f"  - {row(line[: i + 1], '.5f')}\n" for i, line in enumerate(covariance))
    file.write_text(text, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds mocap, corpus and detections")
    parser.add_argument("--output", type=Path, required=True, help="YAML file to write")
    options = parser.parse_args(arguments)
    recorded = [person for person in recorded_people(options.data / "detections") if person.name in PERMITTED]
    captured = captured_people(options.data)
    write_prior(options.output, recorded, captured)
    print(f"{len(recorded)} recorded and {len(captured)} captured people -> {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
