"""How likely the mean error of a pose's joints exceeds 100 mm, from two figures of the last second.

A logistic model, learned on simulation. On real video of the full body its area under the ROC curve is 0.78 (0.89 for
150 mm; the odds of `output.failure_probability`: 0.73 and 0.82), and the stated probability is half of the true share.
Further figures helped in simulation and hurt on real video. benchmarks/accuracy.py --failure-probability prints it.
"""

from __future__ import annotations

import math

from lassokin_ros.doubt.recent import Recent

OFFSET = -2.83
BY_PRIOR, PRIOR_MEAN, PRIOR_SPREAD, PRIOR_S = 0.40, 1.895, 0.61, 0.5
"""Slope, mean and spread of the mean of ln(prior cost) over the last 0.5 s."""
BY_NETWORK, NETWORK_MEAN, NETWORK_SPREAD, NETWORK_S = 1.22, -2.806, 0.636, 1.0
"""Slope, mean and spread of ln(largest distance in m of the network's pose from the tracked one in the last 1 s)."""
MARKED = 0.17
"""Probability from which a pose is marked: 94 % or more of the frames under 60 mm stay unmarked."""
SMALLEST = 1e-6


class FailureModel:
    """Computes the probability frame by frame."""

    def __init__(self) -> None:
        self._prior: Recent[float] = Recent(PRIOR_S)
        self._network: Recent[float] = Recent(NETWORK_S)

    def reset(self) -> None:
        """Forget the earlier frames."""
        self._prior.clear()
        self._network.clear()

    def update(self, stamp: float, prior_cost: float, network_distance: float) -> float:
        """Return the probability, NaN without a network.

        stamp: s. prior_cost: of the pose prior for the solved state. network_distance: m, mean distance of the joints,
        relative to the hips; NaN for a frame without the network's pose.
        """
        self._prior.add(stamp, math.log(max(prior_cost, SMALLEST)))
        self._network.forget_before(stamp)
        if math.isfinite(network_distance):
            self._network.add(stamp, network_distance)
        distances, costs = self._network.values, self._prior.values
        if not distances:
            return math.nan
        prior = (sum(costs) / len(costs) - PRIOR_MEAN) / PRIOR_SPREAD
        network = (math.log(max(max(distances), SMALLEST)) - NETWORK_MEAN) / NETWORK_SPREAD
        return 1 / (1 + math.exp(-OFFSET - BY_PRIOR * prior - BY_NETWORK * network))
