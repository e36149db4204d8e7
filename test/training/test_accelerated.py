"""Training by JAX: the same loss, gradients and steps as in numpy. Skipped without JAX, which is not a dependency."""

import numpy as np
import pytest

from lassokin_ros.core.network.depth_network import DEPTHS, INPUTS, Network
from training.network import Training, backpropagated, initial_weights
from training.symmetry import symmetrise_first, symmetrise_last

jax = pytest.importorskip("jax", reason="JAX is not installed (pip install jax)")
accelerated = pytest.importorskip("training.accelerated")


@pytest.fixture
def problem():
    """Weights of a small network, and a batch."""
    random = np.random.default_rng(0)
    weights = [w + 0.02 * random.normal(size=w.shape).astype("f4") for w in initial_weights(32, 2, random)]
    symmetrise_first(weights[0])
    symmetrise_last(weights[-2], weights[-1])
    inputs, places = random.normal(size=(16, INPUTS)), 0.3 * random.normal(size=(16, DEPTHS, 3))
    return weights, inputs.astype("f4"), places.astype("f4")


def test_loss_and_gradients_are_those_of_numpy(problem):
    weights, inputs, places = problem
    value, gradients = backpropagated(Network(weights), inputs, places)
    own, found = jax.value_and_grad(accelerated.loss)([jax.numpy.asarray(w) for w in weights], inputs, places)
    assert np.isclose(float(own), value, rtol=1e-5)
    for one, other in zip(gradients, accelerated.symmetric(found), strict=True):
        assert np.allclose(one, np.asarray(other), atol=1e-4 * np.abs(one).max())


def test_the_weights_after_some_steps_are_those_of_numpy(problem):
    weights, inputs, places = problem
    one, other = Training(weights), accelerated.AcceleratedTraining(weights)
    for _ in range(20):
        first, second = one.step(inputs, places, 0.5), other.step(inputs, places, 0.5)
    assert np.isclose(first, float(second), rtol=1e-3)
    changed = max(np.abs(a - w).max() for a, w in zip(one.averaged, weights))
    assert changed > 0.01
    assert max(np.abs(a - b).max() for a, b in zip(one.averaged, other.averaged)) < 0.01 * changed
