"""Deviation of the state's rotations from rotation matrices after many retractions, as in a long run of the tracker.

    python benchmarks/numerics/drift.py                     # one body, 10 million steps one after another: some minutes
    python benchmarks/numerics/drift.py --bodies 500 --steps 20000

A step is the update of an accepted frame: R <- R exp(Omega), then one Newton step towards SO(3), for all joints of all
bodies at once. The same is also computed without the Newton step. The table gives the length of the longest chain,
`steps`, and the number of all rotations, bodies x 24 x steps.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np  # noqa: E402

from lassokin_ros.core.body.kinematics import BodyState  # noqa: E402
from lassokin_ros.core.body.rotations import exponential, orthonormalised  # noqa: E402

JOINTS, BLOCK = 24, 1000
STEP_RAD = 0.05
"""Standard deviation of a degree of freedom's increment: everyday motion at 60 Hz has 0.01."""


def deviation(rotations: np.ndarray) -> tuple[float, float]:
    """(largest |R^T R - I|, largest |det R - 1|) of rotations (..., 3, 3)."""
    gram = np.swapaxes(rotations, -1, -2) @ rotations
    return float(np.abs(gram - np.eye(3)).max()), float(np.abs(np.linalg.det(rotations) - 1).max())


def retracted(bodies: int, steps: int, seed: int = 0, mended: bool = True) -> tuple[float, float]:
    """The largest deviations (see above) of bodies x 24 rotations, sampled at every thousandth step."""
    random = np.random.default_rng(seed)
    state = BodyState(exponential(random.normal(size=(bodies, JOINTS, 3))), np.zeros((bodies, 3)))
    worst = 0.0, 0.0
    still = np.zeros((bodies, 3))
    increments = STEP_RAD * random.normal(size=(BLOCK, bodies, 3 * JOINTS))
    for step in range(steps):
        if step % BLOCK == 0:
            random.shuffle(increments)
        state = state.retract(increments[step % BLOCK], still)
        if mended:
            state = BodyState(orthonormalised(state.rotations), state.translation)
        if (step + 1) % BLOCK == 0 or step == steps - 1:
            here = deviation(state.rotations)
            worst = max(worst[0], here[0]), max(worst[1], here[1])
    return worst


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--bodies", type=int, default=1)
    parser.add_argument("--steps", type=int, default=10_000_000)
    options = parser.parse_args()
    count = options.bodies * JOINTS * options.steps
    print(f"{options.steps:,} steps one after another, of {options.bodies * JOINTS:,} rotations: {count:,} in all")
    for name, mended in (("as the tracker does it", True), ("without the Newton step", False)):
        started = time.monotonic()
        gram, det = retracted(options.bodies, options.steps, mended=mended)
        print(f"  {name:<25} |R^T R - I| {gram:.1e}   |det R - 1| {det:.1e}   ({time.monotonic() - started:.0f} s)")


if __name__ == "__main__":
    main()
