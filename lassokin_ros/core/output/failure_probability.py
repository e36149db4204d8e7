"""Failure probability: how likely a pose is wrong.

It depends on three figures. The mean deviation of the joints includes posterior, bone lengths and depth network. The
cost is the negative log-likelihood of all evidence and is high for keypoints that fit no pose. The learned model error
grows for such keypoints (see `model_error`), which lowers the cost. A logistic regression on the three logarithms
predicts whether the mean joint error is above `WRONG`. It was fitted on motion capture (training/motion.py) in many
conditions; benchmarks/accuracy.py --failure-probability checks it on other people.
"""

from __future__ import annotations

import math

WRONG = 0.1
"""m: mean joint error, relative to the pelvis, from which a pose is called wrong."""
OFFSET, SLOPES = -5.6, (4.4, 2.0, 1.7)
"""Coefficients of the curve, in the order of the arguments. If the factors in `uncertainty` change, the offset must
change so that the same pose has the same probability."""


def failure_probability(deviation: float, keypoint_error_ratio: float, cost: float) -> float:
    """Probability from 0 to 1 that a pose is wrong; NaN for NaN.

    deviation: m, mean over the joints. keypoint_error_ratio: the keypoints' model error as a multiple of its lower
    limit. cost: per measurement.
    """
    figures = zip(SLOPES, (deviation / WRONG, keypoint_error_ratio, cost))
    return 1 / (1 + math.exp(-OFFSET - sum(slope * math.log(max(value, 1e-6)) for slope, value in figures)))
