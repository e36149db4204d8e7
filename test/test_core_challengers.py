"""Other explanations of the same images: a body turned round is found back, and what holds their motion."""

import numpy as np
import pytest
from sequences import aligned_error, detected

from lassokin_ros.core.initialisation import DAMPING, LARGEST_TURN
from lassokin_ros.core.kinematics import BodyState
from lassokin_ros.core.robust import huber_weights
from lassokin_ros.synthetic import motion

BACK = np.diag([-1.0, 1.0, -1.0])


def errors(seconds, seed, begin=None):
    """(frames,) m, the joints' mean errors over the demo's motion; `begin` replaces the initialiser's state."""
    tracker, observations = detected(seconds, seed)
    if begin is not None:
        begin(tracker._initialiser)
    times = np.array([observation.stamp for observation in observations])
    truth = tracker.kinematics.pose(motion(tracker.skeleton, times)).positions
    return np.array([aligned_error(tracker.track(o), joints) for o, joints in zip(observations, truth)])


def turned_round(initialiser):
    """Let it find the body as it is seen from behind."""
    fit = initialiser.fit

    def wrong(points, weights):
        state = fit(points, weights).best
        rotations = state.rotations.copy()
        rotations[0] = rotations[0] @ BACK
        return initialiser.refine(BodyState(rotations[None], state.translation[None]), points, weights, ((2.0, 2),))

    initialiser.fit = wrong


@pytest.mark.parametrize("seed", range(1, 5))
def test_a_body_turned_round_is_found_back_within_a_second(seed):
    error = errors(2.0, seed, turned_round)
    assert error[0] > 0.12
    assert error[30:].max() < 0.1


def test_a_steps_ridge_is_on_the_angles_diagonal():
    tracker, observations = detected(0.5)
    for observation in observations:
        estimate = tracker.track(observation)
    rows, state = tracker._rows, estimate.solved
    points, weights = np.nan_to_num(observation.points), 300.0 * observation.confidence
    about = rows.hypotheses(BodyState(state.rotations[None], state.translation[None]))
    linearised = rows.linearise(about, points, weights, huber_weights)
    ridge = np.random.default_rng(0).uniform(1.0, 1e3, size=(1, len(rows.live)))
    omega, x = tracker._initialiser.step(linearised, ridge)
    J, step = linearised.columns[0], np.append(omega[0, rows.live], x[0])
    held = np.append(ridge[0] + DAMPING, np.full(3, 1e-6)) * step
    assert np.abs(omega).max() < LARGEST_TURN
    assert np.allclose(J @ (J.T @ step) + held, J @ linearised.z[0], rtol=1e-9, atol=1e-6)
