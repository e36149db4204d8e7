"""The velocity of a person: no lag in steady motion, a covariance that is true, people who walk where they face."""

import numpy as np
import pytest

from lassokin_ros.core.output.walking_velocity import WalkingVelocity

UP = np.array([0.0, 0.0, 1.0])
AHEAD = np.array([1.0, 0.0, 0.0])
RATE = 30


def walk(velocity, facing=AHEAD, sight=None, seconds=3.0, noise=(0.0, 0.0), seed=0):
    """The filter after a steady walk. noise: m, standard deviations across and along the line of sight."""
    random, result = np.random.default_rng(seed), WalkingVelocity()
    result.start(np.zeros(3))
    for i in range(1, round(seconds * RATE)):
        errors = random.normal(0, noise[0], 3)
        errors += 0.0 if sight is None else random.normal(0, noise[1]) * sight
        result.update(1 / RATE, np.array(velocity) * i / RATE + errors, sight, facing, UP)
    return result


@pytest.mark.parametrize("sight", [None, AHEAD, np.array([0.0, 1.0, 0.0])])
def test_a_steady_walk_is_found_without_a_lag(sight):
    assert walk((1.2, 0.0, 0.0), sight=sight).velocity == pytest.approx([1.2, 0, 0], abs=0.03)


def test_the_error_is_within_twice_the_deviation():
    sight, inside = np.array([0.6, 0.8, 0.0]), []
    for seed in range(40):
        found = walk((0.3, 0.0, 0.0), sight=sight, noise=(0.03, 0.2), seed=seed)
        error = found.velocity - [0.3, 0, 0]
        inside.append(np.abs(error) <= 2 * np.sqrt(np.diag(found.velocity_covariance)))
    assert np.mean(inside) > 0.88
    assert np.trace(found.velocity_covariance) < 0.3


def test_who_walks_hardly_moves_to_the_side():
    sight, noise = np.array([0.0, 1.0, 0.0]), (0.03, 0.2)
    sideways = [
        [walk((1.2, 0, 0), f, sight, noise=noise, seed=s).velocity[1] for s in range(20)] for f in (AHEAD, -AHEAD)
    ]
    assert np.std(sideways[0]) < 0.6 * np.std(sideways[1])  # who walks backward is followed as without the rule


@pytest.mark.parametrize("velocity", [(0.0, 0.8, 0.0), (-0.8, 0.0, 0.0), (0.2, 0.5, 0.0)])
def test_who_walks_sideways_or_backward_is_followed(velocity):
    assert walk(velocity).velocity == pytest.approx(velocity, abs=0.03)


def test_who_lies_faces_nowhere():
    assert walk((0.8, 0.3, 0.0), facing=UP).velocity == pytest.approx([0.8, 0.3, 0], abs=0.03)


def test_a_jump_of_the_frame_turns_the_velocity():
    found, quarter = walk((1.2, 0.0, 0.0), sight=AHEAD), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    before = found.velocity_covariance
    place = np.array([5.0, 5.0, 0.0])
    found.turn(quarter, place)
    assert found.velocity == pytest.approx([0, 1.2, 0], abs=0.03)
    assert found.velocity_covariance == pytest.approx(quarter @ before @ quarter.T)
    found.update(1 / RATE, place + [0, 1.2 / RATE, 0], quarter @ AHEAD, quarter @ AHEAD, UP)
    assert found.velocity == pytest.approx([0, 1.2, 0], abs=0.03)


def test_the_pelvis_may_turn_with_each_step():
    found, sideways = WalkingVelocity(), []
    found.start(np.zeros(3))
    for i in range(1, 4 * RATE):
        facing = [np.cos(0.4), np.sin(0.4) * (-1) ** (i // 3), 0.0]
        found.update(1 / RATE, np.array([1.2 * i / RATE, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array(facing), UP)
        sideways.append(found.velocity[1])
    assert np.abs(sideways[RATE:]).max() < 0.2
