"""Training of the depth network: gradients, reproducible batches, and a tiny network that learns."""

import numpy as np
import pytest

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.depth_network import (
    DEPTHS,
    INPUTS,
    OUTPUTS,
    Network,
    canonical_layout,
    lengths_of,
    load_weights,
)
from lassokin_ros.demo.synthetic import motion as synthetic_motion
from training.depth import train, write
from training.motion import HEIGHT_PARTS, TEST, VALIDATION, Motion
from training.network import backpropagated, initial_weights, loss, orthogonalised
from training.views import Views

HEIGHT = 1.75


@pytest.fixture(scope="module")
def motion():
    """Twenty seconds of the synthetic motion in the format of the motion capture."""
    skeleton = Skeleton.load("anthropometric", HEIGHT)
    kinematics = Kinematics(skeleton, canonical_layout(skeleton))
    points = kinematics.pose(synthetic_motion(skeleton, np.arange(600) / 30)).landmarks * [1.0, -1.0, -1.0]
    parts = np.full((1, len(HEIGHT_PARTS)), HEIGHT / len(HEIGHT_PARTS))
    lengths = HEIGHT * lengths_of(skeleton)[None]
    one = np.ones(1)
    return Motion(points.astype(np.float32), np.array([0]), np.array([600]), 30 * one, one, parts, lengths, ("demo",))


def test_the_loss_gradient_is_its_derivative():
    random = np.random.default_rng(0)
    outputs = 0.3 * random.normal(size=(4, OUTPUTS))
    places = 0.3 * random.normal(size=(4, DEPTHS, 3))
    _, gradient = loss(outputs, places)
    for column in random.choice(OUTPUTS, 25, replace=False):
        step = np.zeros_like(outputs)
        step[1, column] = 1e-6
        slope = (loss(outputs + step, places)[0] - loss(outputs - step, places)[0]) / 2e-6
        assert np.isclose(gradient[1, column], slope, rtol=1e-4, atol=1e-6)


def test_backpropagation_is_the_derivative_by_the_weights():
    random = np.random.default_rng(1)
    network = Network(initial_weights(8, 1, random))
    network.weights = [w.astype(float) + 0.05 * random.normal(size=w.shape) for w in network.weights]
    inputs, places = random.normal(size=(6, INPUTS)), 0.3 * random.normal(size=(6, DEPTHS, 3))
    _, gradients = backpropagated(network, inputs, places)
    for weights, gradient in zip(network.weights, gradients):
        place = tuple(random.integers(size) for size in weights.shape)
        before = weights[place]
        values = []
        for step in (1e-6, -1e-6):
            weights[place] = before + step
            values.append(backpropagated(network, inputs, places)[0])
        weights[place] = before
        assert np.isclose(gradient[place], (values[0] - values[1]) / 2e-6, rtol=1e-3, atol=1e-6)


def test_an_orthogonalised_matrix_keeps_its_singular_vectors_and_has_singular_values_near_one():
    matrix = np.random.default_rng(2).normal(size=(6, 6))
    U, _, V = np.linalg.svd(matrix)
    inner = U.T @ orthogonalised(matrix) @ V.T
    assert np.allclose(inner, np.diag(np.diagonal(inner)), atol=1e-6)
    assert (np.abs(np.diagonal(inner) - 0.95) < 0.3).all()


def test_the_same_seed_draws_the_same_batch(motion):
    one, again = (Views(motion).batch(8, np.random.default_rng([0, 3])) for _ in range(2))
    assert np.array_equal(one.inputs, again.inputs) and np.array_equal(one.places, again.places)
    assert np.isfinite(one.inputs).all() and np.isfinite(one.places).all()


def test_a_tiny_network_learns(motion):
    batch = Views(motion).batch(400, np.random.default_rng(9), plain=True)
    untrained = Network(initial_weights(32, 1, np.random.default_rng([0, 1])))
    network = train(motion, 150, 128, 32, 1, seed=0, processes=0)
    before, after = (loss(n(batch.inputs), batch.places)[0] for n in (untrained, network))
    assert after < before - 10.0


def test_a_written_network_is_read_again(tmp_path, motion):
    network = Network(initial_weights(8, 1, np.random.default_rng(0)))
    write(tmp_path / "network.npz", network, ["demo"], list(TEST), 1, 0)
    read, provenance = load_weights(tmp_path / "network.npz")
    assert all(np.allclose(a, b, atol=1e-3) for a, b in zip(network.weights, read.weights))
    assert provenance["people"] == ["demo"] and provenance["held_out"] == list(TEST)


def test_test_and_validation_people_are_disjoint():
    assert not set(TEST) & set(VALIDATION)
