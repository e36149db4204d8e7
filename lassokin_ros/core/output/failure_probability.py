"""Failure probability: how likely a pose is wrong.

It depends on three figures. The mean deviation of the joints includes posterior, bone lengths and depth network. The
cost, the negative log-likelihood of all evidence, is high for keypoints that fit no pose. The learned model error of
such keypoints grows (see `model_error`), which lowers the cost; therefore it is the third figure. A logistic curve in
the three logarithms was fitted on the people of validation (training/motion.py; bones known and height alone, white
and lasting noise, 60 and 10 Hz, hidden limbs, gaps and wrong points, measured depth, without the network, and
keypoints in a wrong order) to whether the mean joint error is above `WRONG`. benchmarks/accuracy.py
--failure-probability checks the curve on other people.
"""

from __future__ import annotations

import math

WRONG = 0.1
"""m: mean joint error, relative to the pelvis, from which a pose is called wrong."""
OFFSET, BY_DEVIATION, BY_EXCESS, BY_COST = -4.5, 4.4, 2.0, 1.7
"""Coefficients of the curve: offset, and slopes for the three logarithms."""


def failure_probability(deviation: float, excess: float, cost: float) -> float:
    """Probability from 0 to 1 that a pose is wrong; NaN for NaN.

    deviation: m, mean over the joints. excess: the keypoints' lasting error as a multiple of the smallest one.
    cost: per measurement.
    """
    figures = (BY_DEVIATION, deviation / WRONG), (BY_EXCESS, excess), (BY_COST, cost)
    return 1 / (1 + math.exp(-OFFSET - sum(slope * math.log(max(value, 1e-6)) for slope, value in figures)))
