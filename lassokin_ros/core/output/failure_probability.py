"""Failure probability: how likely a pose is wrong, from its cost.

The cost is the negative log-likelihood of the pose by image, prior, limits, uprightness and balance. It separates wrong
poses from right ones better than the reprojection error, which stays small for wrong poses. While a wrong pose lasts,
the keypoints are trusted less (see `model_error`), which lowers the cost; therefore the learned error counts too. A
logistic curve in both logarithms was fitted on the prior's training clips (first view of each; 60 Hz with 2 px, with
gaps and wrong points, with lasting errors, 30 Hz with 4 px; COCO-17 and BODY_25) to whether the mean joint error is
above `WRONG`. benchmarks/accuracy.py --failure-probability checks the curve on other clips.
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
    """Probability from 0 to 1 that a pose of this cost is wrong; NaN for NaN.

    excess: the keypoints' lasting error as a multiple of the smallest one, when the pose had this cost.
    """
    costly = math.log(max(cost, 1e-9)) + SUSPICION * math.log(excess)
    return 1 / (1 + math.exp(SLOPE * (math.log(HALF) - costly)))
