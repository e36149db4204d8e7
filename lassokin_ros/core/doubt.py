"""How likely a pose is wrong, from what it costs: better than the reprojection error, which wrong poses keep small.

The cost is the pose's own part of the problem, image (robust), prior, limits, uprightness and balance: a
negative log-likelihood. A logistic curve in its logarithm was fitted to the frames of the prior's training clips (first
view each; 60 Hz with 2 px, with gaps and wrong points, 30 Hz with 4 px, COCO-17 and BODY_25), to whether the mean joint
error was above `WRONG`; benchmarks/accuracy.py --doubt checks it on others.
"""

from __future__ import annotations

import math

WRONG = 0.1
"""m: mean joint error, relative to the pelvis, from which a pose is called wrong."""
SLOPE, HALF = 1.7, 122.0
"""Of the curve: by the cost's logarithm, and the cost at which it is one half."""


def doubt(cost: float) -> float:
    """0 to 1: how likely a pose of this cost is wrong; NaN for NaN."""
    return 1 / (1 + math.exp(SLOPE * (math.log(HALF) - math.log(max(cost, 1e-9)))))
