"""The published pose, steadied over the last few frames without lag in steady motion.

The tracker answers every frame nearly from that frame's image alone, which lets it leave a wrong explanation at once,
but passes on the image's noise, most of all in depth. What is published follows it through one constant-velocity
Kalman filter for each degree of freedom (white acceleration; Bar-Shalom, Li, Kirubarajan, Estimation with Applications
to Tracking and Navigation, 2001, sec. 6.3), all of one gain. The tracker's own state, from which the next frame is
linearised, stays as solved: fed back, a prediction in depth would hold on to what was wrong.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lassokin_ros.core.kinematics import BodyState

LONGEST_STEP = 0.2
"""s between frames beyond which the filter starts anew: nothing is known of the motion between."""


class Forward(NamedTuple):
    """One frame's filtering, for whoever smooths backwards (see `fixed_lag`).

    begins: the filter began with this frame; step: s since the last frame; predicted: (n + 1, 3) departure predicted
    from the last frame, predicted_covariance: with the predicted velocity's; departure, velocity and covariance: after
    this frame. Covariances are (value, both, velocity), in the variance of a value as solved.
    """

    begins: bool
    step: float
    predicted: np.ndarray
    predicted_covariance: tuple[float, float, float]
    departure: np.ndarray
    velocity: np.ndarray
    covariance: tuple[float, float, float]


class Steadying:
    """Filters rotations (n, 3, 3) and translation (3,), as small departures from the state as solved.

    With state R and published R exp(hat(d)), the next state R exp(hat(omega)) has the prediction d + v dt - omega, to
    first order in angles of one frame's size. What is left out does not add up: d is about the solved state each time.
    """

    def __init__(self, joint_count: int) -> None:
        self._shape = joint_count + 1, 3  # the joints' turns in rad and, last, the translation in m
        self.reset()

    def reset(self) -> None:
        """Begin anew from the next state."""
        self._departure = np.zeros(self._shape)
        self._velocity = np.zeros(self._shape)
        #: Variance of the value, covariance, variance of the velocity; of the value as solved it is 1.
        self._covariance: tuple[float, float, float] | None = None
        self.forward: Forward | None = None
        """Of the last frame."""

    def steadied(
        self, state: BodyState, omega: np.ndarray, translation_step: np.ndarray, step: float, time: float
    ) -> BodyState:
        """The state to publish.

        state: as solved; omega (3 n,) rad and translation_step (3,) m: the increment that led to it; step: s since the
        last frame; time: s over which motion is steadied, the root of the noise over the acceleration; 0: not at all.
        """
        if self._covariance is None or time <= 0 or step > LONGEST_STEP:
            self.reset()
            start = self._covariance = 1.0, 0.0, (1 / max(time, 1e-3)) ** 2
            self.forward = Forward(True, step, self._departure, start, self._departure, self._velocity, start)
            return state
        ahead = self._ahead(step, time)
        gain, velocity_gain = self._gains(ahead)
        predicted = self._departure + step * self._velocity
        predicted[:-1] -= omega.reshape(-1, 3)
        predicted[-1] -= translation_step
        self._velocity = self._velocity - velocity_gain * predicted
        self._departure = (1 - gain) * predicted
        self.forward = Forward(False, step, predicted, ahead, self._departure, self._velocity, self._covariance)
        return state.retract(self._departure[:-1].reshape(-1), self._departure[-1])

    def _ahead(self, step: float, time: float) -> tuple[float, float, float]:
        """The covariance predicted for this frame."""
        assert self._covariance is not None
        value, both, velocity = self._covariance
        noise = step * step / time**4  # of the acceleration 1 / time^2 over a step, squared
        value += 2 * step * both + step * step * velocity + noise * step * step / 4
        both += step * velocity + noise * step / 2
        return value, both, velocity + noise

    def _gains(self, ahead: tuple[float, float, float]) -> tuple[float, float]:
        """The Kalman gains of value and velocity; the covariance becomes that after this frame."""
        value, both, velocity = ahead
        gain, velocity_gain = value / (value + 1), both / (value + 1)
        self._covariance = value - gain * value, both - gain * both, velocity - velocity_gain * both
        return gain, velocity_gain
