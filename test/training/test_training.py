"""Training of the depth network: gradients, reproducible batches, and a tiny network that learns."""

import numpy as np
import pytest

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.network.depth_network import (
    DEPTHS,
    INPUTS,
    NAMES,
    OUTPUTS,
    TARGETS,
    TIMES,
    TYPICAL_LENGTHS,
    Network,
    Scene,
    features,
    lengths_of,
    load_weights,
    shipped_network,
)
from lassokin_ros.demo.synthetic import motion as synthetic_motion
from training.depth import LATER, batches, train, twice, write
from training.motion import HEIGHT_PARTS, TEST, VALIDATION, Motion, canonical_layout
from training.network import backpropagated, initial_weights, loss, orthogonalised
from training.symmetry import INPUT, OTHER, PLACE, symmetrise_first, symmetrise_last
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
    """Along directions with the symmetry of the weights."""
    random = np.random.default_rng(1)
    network = Network(initial_weights(8, 1, random))
    network.weights = [w.astype(float) for w in network.weights]
    inputs, places = random.normal(size=(6, INPUTS)), 0.3 * random.normal(size=(6, DEPTHS, 3))
    _, gradients = backpropagated(network, inputs, places)
    directions = [random.normal(size=w.shape) for w in network.weights]
    symmetrise_first(directions[0])
    symmetrise_last(directions[-2], directions[-1])
    for weights, gradient, direction in zip(network.weights, gradients, directions):
        values, before = [], weights.copy()
        for step in (1e-6, -1e-6):
            weights[...] = before + step * direction
            values.append(backpropagated(network, inputs, places)[0])
        weights[...] = before
        assert np.isclose(np.vdot(gradient, direction), (values[0] - values[1]) / 2e-6, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("kind", ["trained", "shipped"])
def test_networks_have_the_mirror_symmetry(motion, kind):
    network = train(motion, 5, 32, 16, 1, seed=0, processes=0) if kind == "trained" else shipped_network()
    inputs = Views(motion).batch(20, np.random.default_rng(4)).inputs
    (seen, x), (place, sign) = INPUT, PLACE
    outputs, mirrored = network(inputs), network(inputs[:, seen] * x)
    assert np.ptp(outputs[:, : len(place)]) > 0.01 and np.abs(mirrored - outputs).max() > 1e-3
    assert np.allclose(mirrored[:, : len(place)], outputs[:, place] * sign, atol=1e-4)


def test_a_mirrored_scene_has_mirrored_inputs(motion):
    """`INPUT` describes the order of `features`."""
    random = np.random.default_rng(5)
    seen = random.random((7, len(TIMES), len(NAMES))) < 0.8
    points = 0.2 * random.normal(size=(*seen.shape, 2))
    up = random.normal(size=(7, 3))
    known = np.ones(7, dtype=bool)
    lengths = np.tile(TYPICAL_LENGTHS, (7, 1))
    inputs, _ = features(Scene(points, seen, up, known, lengths, known))
    flip = np.array([-1.0, 1.0, 1.0])
    mirrored = Scene(points[:, :, OTHER] * flip[:2], seen[:, :, OTHER], up * flip, known, lengths, known)
    index, sign = INPUT
    assert np.abs(features(mirrored)[0] - inputs).max() > 0.1
    assert np.allclose(features(mirrored)[0], inputs[:, index] * sign, atol=1e-5)


def test_the_places_of_a_mirrored_body_are_mirrored(motion):
    """`PLACE` describes the order of the outputs."""
    body = dict(zip(NAMES, np.random.default_rng(6).normal(size=(len(NAMES), 3))))
    middle = 0.5 * (body["left_hip"] + body["right_hip"])
    other = {name: body[NAMES[OTHER[NAMES.index(name)]]] * [-1.0, 1.0, 1.0] for name in NAMES}
    places = np.array([body[name] - middle for name in TARGETS]).T.ravel()
    mirrored = np.array([other[name] - middle * [-1.0, 1.0, 1.0] for name in TARGETS]).T.ravel()
    index, sign = PLACE
    assert np.allclose(mirrored, places[index] * sign)


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


@pytest.mark.parametrize("processes", [0, 2])
def test_batches_have_the_same_order_for_any_number_of_processes(motion, processes):
    """More batches than the processes draw in advance at once."""
    found = [batch.inputs for batch in batches(motion, 7, 2, 70, processes)]
    assert len(found) == 70
    for number in (0, 63, 64, 69):
        assert np.array_equal(found[number], Views(motion).batch(2, np.random.default_rng([7, number])).inputs)


def test_each_batch_is_used_twice():
    order = list(twice(iter(range(LATER + 10))))
    assert sorted(order) == sorted([*range(LATER + 10)] * 2)
    assert order[: LATER + 3] == [*range(LATER + 1), 0, LATER + 1]


def test_a_tiny_network_learns(motion):
    batch = Views(motion).batch(200, np.random.default_rng(9), plain=True)
    untrained = Network(initial_weights(32, 1, np.random.default_rng([0, 1])))
    network = train(motion, 60, 64, 32, 1, seed=0, processes=0)
    before, after = (loss(n(batch.inputs), batch.places)[0] for n in (untrained, network))
    assert after < before - 10.0


def test_a_written_network_is_read_again(tmp_path, motion):
    network = Network(initial_weights(8, 1, np.random.default_rng(0)))
    write(tmp_path / "network.npz", network, ["demo"], list(TEST), 1, 0)
    read, provenance = load_weights(tmp_path / "network.npz")
    assert all(np.allclose(a, b, atol=1e-3) for a, b in zip(network.weights, read.weights))
    assert provenance["people"] == ["demo"] and provenance["held_out"] == list(TEST)


def test_the_shipped_network_was_trained_without_the_people_of_test_and_validation():
    _, provenance = load_weights()
    assert not set(provenance["people"]) & {*TEST, *VALIDATION}


def test_test_and_validation_people_are_disjoint():
    assert not set(TEST) & set(VALIDATION)
