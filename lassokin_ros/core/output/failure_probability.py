"""Failure probability: how likely a pose is wrong.

Three figures tell. The mean deviation of the joints holds what posterior, bone lengths and depth network know. The
cost, the negative log-likelihood by all evidence, is high for keypoints that fit no pose. While they do not fit,
keypoints are trusted less (see `model_error`), which lowers the cost; therefore their learned error counts too. A
logistic curve in the three logarithms was fitted on the people of validation (training/motion.py; bones known and
height alone, white and lasting noise, 60 and 10 Hz, hidden limbs, gaps and wrong points, measured depth, without the
network, and keypoints in a wrong order) to whether the mean joint error is above `WRONG`. benchmarks/accuracy.py
--failure-probability checks the curve on other people.
"""

from __future__ import annotations

import math

WRONG = 0.1
"""m: mean joint error, relative to the pelvis, from which a pose is called wrong."""
OFFSET, BY_DEVIATION, BY_EXCESS, BY_COST = -4.5, 4.4, 2.0, 1.7
"""Of the curve: where the logarithms are 0, and by each of them."""


def failure_probability(deviation: float, excess: float, cost: float) -> float:
    """Probability from 0 to 1 that a pose is wrong; NaN for NaN.

    deviation: m, mean over the joints. excess: the keypoints' lasting error as a multiple of the smallest one.
    cost: per measurement.
    """
    figures = (BY_DEVIATION, deviation / WRONG), (BY_EXCESS, excess), (BY_COST, cost)
    return 1 / (1 + math.exp(-OFFSET - sum(slope * math.log(max(value, 1e-6)) for slope, value in figures)))
