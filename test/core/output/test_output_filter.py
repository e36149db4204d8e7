"""The output filter: steady motion is unchanged, jitter is removed, and the tracking is not affected."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sequences import CONFIG, RATE, observations, published_by

from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.output.output_filter import (
    DEPTH_RATIO,
    LARGEST_DEPTH_OFFSET,
    LONGEST_STEP,
    TYPICAL_SPEED,
    OutputFilter,
    time_constant,
)
from lassokin_ros.core.tracker import Tracker

STEP, TIME, JOINTS = 1 / 60, 0.02, 3


AHEAD = np.array([0.0, 0.0, 3.0])


def turned(vectors, place=AHEAD):
    """Joints without a parent: their rotations are their orientations."""
    return BodyState(Rotation.from_rotvec(vectors).as_matrix(), place + 0.1 * vectors[0])


def posed(state):
    return BodyPose(state.rotations, np.zeros((JOINTS, 3)), np.zeros((0, 3)))


def filtered(output_filter, last, state, step=STEP, time=TIME, speed=TYPICAL_SPEED, several=False):
    """The state to publish after the increment from the last state."""
    omega = Rotation.from_matrix(np.swapaxes(last.rotations, -1, -2) @ state.rotations).as_rotvec()
    moved = state.translation - last.translation
    return published_by(output_filter, state, posed(state), omega.ravel(), moved, step, speed, time, several)


def followed(states, step=STEP, time=TIME, speed=TYPICAL_SPEED, several=False):
    """Filter a list of states; the increments are those between them."""
    output_filter, last, published = OutputFilter(JOINTS), states[0], []
    for state in states:
        published.append(filtered(output_filter, last, state, step, time, speed, several))
        last = state
    return published


def angle(a, b):
    return Rotation.from_matrix(np.swapaxes(a.rotations, -1, -2) @ b.rotations).magnitude().max()


@pytest.mark.parametrize("step", [1 / 30, 1 / 60, 1 / 240])
def test_steady_turns_are_published_without_lag(step):
    speed = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 0.0], [2.0, 0.0, 0.0]])
    states = [turned(speed * step * i) for i in range(int(1 / step))]
    published = followed(states, step)
    # The axis of the joint is constant, so a constant rate is a constant increment: no lag once the filter has settled.
    assert angle(states[-1], published[-1]) < 1e-3
    assert np.abs(states[-1].translation - published[-1].translation).max() < 1e-4


def test_jitter_is_removed():
    random = np.random.default_rng(0)
    noise = 0.02 * random.normal(size=(400, JOINTS, 3))
    published = followed([turned(vectors) for vectors in noise])
    left = np.array([Rotation.from_matrix(state.rotations).as_rotvec() for state in published])
    jerk = [np.linalg.norm(np.diff(x, 2, axis=0), axis=-1).mean() for x in (noise[50:], left[50:])]
    assert jerk[1] < 0.55 * jerk[0] and left[50:].std() < 0.9 * noise[50:].std()


def test_a_longer_time_is_steadier():
    random = np.random.default_rng(1)
    states = [turned(0.02 * random.normal(size=(JOINTS, 3))) for _ in range(200)]
    spreads = []
    for time in (0.0, 0.01, 0.02, 0.05, 0.2):
        published = followed(states, time=time)[50:]
        spreads.append(np.std([Rotation.from_matrix(state.rotations).as_rotvec() for state in published]))
    assert spreads == sorted(spreads, reverse=True)
    assert all(a is b for a, b in zip(states, followed(states, time=0.0)))


def test_smoothing_is_longer_at_rest_and_lag_smaller_in_motion():
    random = np.random.default_rng(4)
    jitter = [turned(0.02 * random.normal(size=(JOINTS, 3))) for _ in range(400)]
    starting = [turned(np.full((JOINTS, 3), 0.05 * max(i - 20, 0))) for i in range(24)]
    spreads, lags = [], []
    for speed in (0.0, 0.1, TYPICAL_SPEED, 2.0, 20.0):
        left = [Rotation.from_matrix(state.rotations).as_rotvec() for state in followed(jitter, speed=speed)[50:]]
        spreads.append(np.std(left))
        lags.append(angle(starting[-1], followed(starting, speed=speed)[-1]))
    assert spreads == sorted(spreads) and spreads[0] < 0.8 * spreads[2]
    assert lags == sorted(lags, reverse=True) and lags[3] < 0.8 * lags[2]
    assert time_constant(TYPICAL_SPEED, TIME) == TIME


def test_motion_in_depth_is_smoothed_more():
    random = np.random.default_rng(2)
    states = [turned(0.02 * random.normal(size=(JOINTS, 3)), AHEAD + 0.02 * random.normal(size=3)) for _ in range(1500)]
    published = followed(states)[50:]
    turns = np.array([Rotation.from_matrix(state.rotations).as_rotvec() for state in published])
    places = np.array([state.translation for state in published])
    about_the_ray, across_it = turns[..., 2].std(), turns[..., :2].std()
    sideways, towards_us = places[:, :2].std(), places[:, 2].std()
    assert across_it < 0.85 * about_the_ray and towards_us < 0.85 * sideways
    left = np.std([state.translation[2] for state in followed(states, time=DEPTH_RATIO * TIME)[50:]])
    assert sideways > towards_us and np.isclose(left, places[:, 2].std(), rtol=0.35)


def test_several_cameras_smooth_motion_in_depth_like_other_motion():
    random = np.random.default_rng(2)
    states = [turned(0.02 * random.normal(size=(JOINTS, 3)), AHEAD + 0.02 * random.normal(size=3)) for _ in range(1500)]
    places = np.array([state.translation for state in followed(states, several=True)[50:]])
    alone = np.array([state.translation for state in followed(states)[50:]])
    assert np.isclose(places[:, 2].std(), places[:, :2].std(), rtol=0.1)
    assert np.allclose(places[:, :2], alone[:, :2], atol=5e-4) and places[:, 2].std() > 1.1 * alone[:, 2].std()


def test_depth_is_defined_by_the_camera_not_by_the_joint():
    """The same motion gives the same output if the body and its camera are rotated together."""
    random = np.random.default_rng(3)
    vectors, steps = 0.05 * random.normal(size=(40, JOINTS, 3)), 0.05 * random.normal(size=(40, 3))
    other = Rotation.random(random_state=3).as_matrix()
    plain = [BodyState(Rotation.from_rotvec(v).as_matrix(), AHEAD + p) for v, p in zip(vectors, steps)]
    turned_round = [BodyState(other @ s.rotations, other @ s.translation) for s in plain]
    published = followed(plain)
    assert max(map(angle, published, plain)) > 0.01  # the filter has an effect
    assert max(np.abs(a.translation - s.translation).max() for a, s in zip(published, plain)) > 0.01
    for a, b in zip(published, followed(turned_round), strict=True):
        assert np.allclose(other @ a.rotations, b.rotations) and np.allclose(other @ a.translation, b.translation)


def test_the_first_state_and_the_one_after_a_gap_are_published_as_solved():
    output_filter = OutputFilter(JOINTS)
    a, b, c = turned(np.zeros((3, 3))), turned(np.full((3, 3), 0.3)), turned(np.full((3, 3), -0.3))
    assert filtered(output_filter, a, a, np.inf) is a
    assert angle(filtered(output_filter, a, b), b) > 0.01
    assert filtered(output_filter, b, c, 1.01 * LONGEST_STEP) is c
    output_filter.reset()
    assert filtered(output_filter, c, b) is b


def test_the_tracked_states_do_not_depend_on_the_output():
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


def test_the_smoothing_time_depends_on_the_speed_of_the_keypoints():
    tracker = Tracker(CONFIG)
    sequence, steadied_by, told = observations(tracker, 2.0), tracker._output_filter.filtered, []
    tracker._output_filter.filtered = lambda *a: told.append(a[3]) or steadied_by(*a)  # the speed
    depths = [tracker.track(observation).state.translation[2] for _, observation in sequence]
    steps = np.diff([observation.points for _, observation in observations(tracker, 2.0, noise_px=0.0)], axis=0)
    moved = np.linalg.norm(steps, axis=-1).mean(axis=1) * RATE * depths[1:]
    settled = slice(15, None)  # the velocity of a new track is noise
    assert 0.8 < np.mean(told[1:][settled]) / np.mean(moved[settled]) < 1.25
    assert np.corrcoef(told[1:][settled], moved[settled])[0, 1] > 0.5


def test_a_replaced_state_is_published_at_once():
    """The motion of the state before is not continued."""
    tracker = Tracker(replace(CONFIG, smoothing=0.1))
    sequence = [observation for _, observation in observations(tracker, 1.0)]
    for observation in sequence[:-1]:
        estimate = tracker.track(observation)
    assert angle(estimate.state, estimate.solved) > 0
    tracker._replaced = True
    estimate = tracker.track(sequence[-1])
    assert estimate.state is estimate.solved and not estimate.initialised


def test_a_body_that_jumps_in_depth_is_not_published_through_the_camera():
    """The solved body moves towards the camera ever faster and then away. The output restarts there and does not
    continue.
    """
    depths = [3.0, 3.0, 2.6, 2.0, 1.2, 0.3, 2.0, 5.0, 5.0]
    still = np.zeros((JOINTS, 3))
    states = [turned(still, np.array([0.0, 0.0, depth])) for depth in depths]
    ratios = [p.translation[2] / s.translation[2] for p, s in zip(followed(states, time=0.06), states)]
    assert max(abs(ratio - 1) for ratio in ratios) <= LARGEST_DEPTH_OFFSET
    assert ratios[5] == 1.0
    gentle = [turned(still, np.array([0.0, 0.0, 3.0 - 0.02 * i])) for i in range(20)]
    assert followed(gentle, time=0.06)[-1].translation[2] != gentle[-1].translation[2]  # the motion that continues


def test_only_the_distance_from_the_camera_limits_the_offset_in_depth():
    """The published motion does not depend on where the origin of the skeleton's frame is."""
    depths = 3.0 + 0.1 * np.sin(np.arange(40) * 40 / RATE)
    still = np.zeros((JOINTS, 3))

    def published(origin):
        """(f, 3) m from the camera. origin: (3,) m, of the skeleton's frame, from the camera."""
        output_filter, found, last = OutputFilter(JOINTS), [], None
        for depth in depths:
            state = turned(still, np.array([0.0, 0.0, depth]) - origin)
            step = SimpleNamespace(omega=np.zeros(3 * JOINTS), x=state.translation - (last or state).translation)
            solved = EvaluatedState(state, posed(state), None)
            moved = output_filter.filtered(solved, step, STEP, TYPICAL_SPEED, 0.1, -origin)
            found.append(moved.translation + origin)
            last = state
        return np.array(found)

    far, near = published(np.array([0.3, -0.2, -1.0])), published(np.array([0.0, 0.0, 3.0]))
    assert np.abs(far - [0.0, 0.0, 1.0] * depths[:, None]).max() > 0.03  # the filter has an effect
    assert np.allclose(near, far, rtol=0, atol=1e-9)
