"""The published pose, steadied: what passes through unchanged, what is taken away, what is never touched."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sequences import CONFIG, observations

from lassokin_ros.core.kinematics import BodyState
from lassokin_ros.core.steadying import LONGEST_STEP, Steadying
from lassokin_ros.core.tracker import Tracker

STEP, TIME, JOINTS = 1 / 60, 0.02, 3


def turned(vectors):
    return BodyState(Rotation.from_rotvec(vectors).as_matrix(), 0.1 * vectors[0])


def followed(states, step=STEP, time=TIME):
    """Steady a list of states; the increments are those between them."""
    steadying, last, published = Steadying(JOINTS), states[0], []
    for state in states:
        omega = Rotation.from_matrix(np.swapaxes(last.rotations, -1, -2) @ state.rotations).as_rotvec()
        published.append(steadying.steadied(state, omega.ravel(), state.translation - last.translation, step, time))
        last = state
    return published


def angle(a, b):
    return Rotation.from_matrix(np.swapaxes(a.rotations, -1, -2) @ b.rotations).magnitude().max()


@pytest.mark.parametrize("step", [1 / 30, 1 / 60, 1 / 240])
def test_steady_turns_are_published_without_lag(step):
    speed = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 0.0], [2.0, 0.0, 0.0]])
    states = [turned(speed * step * i) for i in range(int(1 / step))]
    published = followed(states, step)
    # One joint's axis stays as it turns, so a constant rate is a constant increment: no lag at all once it has settled.
    assert angle(states[-1], published[-1]) < 1e-3
    assert np.abs(states[-1].translation - published[-1].translation).max() < 1e-4


def test_jitter_is_taken_away():
    random = np.random.default_rng(0)
    noise = 0.02 * random.normal(size=(400, JOINTS, 3))
    published = followed([turned(vectors) for vectors in noise])
    left = np.array([Rotation.from_matrix(state.rotations).as_rotvec() for state in published])
    jerk = [np.linalg.norm(np.diff(x, 2, axis=0), axis=-1).mean() for x in (noise[50:], left[50:])]
    assert jerk[1] < 0.55 * jerk[0] and left[50:].std() < 0.9 * noise[50:].std()


def test_longer_time_is_steadier():
    random = np.random.default_rng(1)
    states = [turned(0.02 * random.normal(size=(JOINTS, 3))) for _ in range(200)]
    spreads = []
    for time in (0.0, 0.01, 0.02, 0.05, 0.2):
        published = followed(states, time=time)[50:]
        spreads.append(np.std([Rotation.from_matrix(state.rotations).as_rotvec() for state in published]))
    assert spreads == sorted(spreads, reverse=True)
    assert all(a is b for a, b in zip(states, followed(states, time=0.0)))


def test_the_first_state_and_the_one_after_a_gap_are_published_as_solved():
    steadying = Steadying(JOINTS)
    a, b, c = turned(np.zeros((3, 3))), turned(np.full((3, 3), 0.3)), turned(np.full((3, 3), -0.3))
    none = np.zeros(9), np.zeros(3)
    assert steadying.steadied(a, *none, np.inf, TIME) is a
    assert angle(steadying.steadied(b, np.full(9, 0.3), np.zeros(3), STEP, TIME), b) > 0.01
    assert steadying.steadied(c, *none, 1.01 * LONGEST_STEP, TIME) is c
    steadying.reset()
    assert steadying.steadied(b, *none, STEP, TIME) is b


def test_the_tracker_follows_the_same_states_whatever_is_published():
    tracks = []
    for smoothing in (0.0, 0.02, 0.5):
        tracker = Tracker(replace(CONFIG, smoothing=smoothing))
        tracks.append([tracker.track(observation) for _, observation in observations(tracker, 1.5)])
    plain, default, strong = tracks
    for a, b, c in zip(plain, default, strong):
        assert a.state is a.solved
        assert np.array_equal(a.solved.rotations, b.solved.rotations)
        assert np.array_equal(a.solved.rotations, c.solved.rotations)
    moves = [np.mean([np.abs(e.state.rotations - e.solved.rotations).max() for e in track]) for track in tracks]
    assert moves[0] == 0 and 0 < moves[1] < moves[2]
