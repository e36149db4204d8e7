"""How likely a pose is wrong, from what it costs: better than the reprojection error, which wrong poses keep small.

The cost is the pose's own part of the problem, image (robust), prior, limits, uprightness and balance: a
negative log-likelihood. A wrong pose that lasts is taken for a bad detector, whose keypoints are trusted less (see
`model_error`), and costs less from then on; so the error that was learned counts too. A logistic curve in both logarithms
was fitted to the frames of the prior's training clips (first view each; 60 Hz with 2 px, with gaps and wrong points,
with keypoint errors that last, 30 Hz with 4 px, COCO-17 and BODY_25; each as much), to whether the mean joint error was
above `WRONG`; benchmarks/accuracy.py --failure-probability checks it on others.
"""

from __future__ import annotations

import math

WRONG = 0.1
"""m: mean joint error, relative to the pelvis, from which a pose is called wrong."""
SLOPE, HALF = 1.37, 328.0
"""Of the curve: by the cost's logarithm, and the cost at which it is one half where keypoints are as good as can be."""
SUSPICION = 1.23
"""Power of the learned error, in the least there is, by which a cost is multiplied."""


def failure_probability(cost: float, excess: float = 1.0) -> float:
    """0 to 1: how likely a pose of this cost is wrong; NaN for NaN.

    excess: how many times larger than the least the keypoints' lasting error was when it cost that.
    """
    costly = math.log(max(cost, 1e-9)) + SUSPICION * math.log(excess)
    return 1 / (1 + math.exp(SLOPE * (math.log(HALF) - costly)))
