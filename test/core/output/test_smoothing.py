"""The smoothing of published poses: the filter, compared with what it is for; the lag, with the textbook's matrices."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import FACING, body, one_view
from scipy.spatial.transform import Rotation
from sequences import CONFIG, RATE, observations, same

from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.image.projection import carried
from lassokin_ros.core.observation import CameraPose, Status
from lassokin_ros.core.output.smoothing import (
    DEPTH_RATIO,
    LARGEST_DEPTH_OFFSET,
    LONGEST_STEP,
    TYPICAL_SPEED,
    HeldFrame,
    OutputFilter,
    Smoothing,
    time_constant,
)
from lassokin_ros.core.tracker import Tracker

STEP, TIME, JOINTS = 1 / 60, 0.02, 3
AHEAD, UP = np.array([0.0, 0.0, 3.0]), np.array([0.0, -1.0, 0.0])
LAGGED = replace(CONFIG, smoothing_lag=0.1)  # three frames


def published_by(output_filter, state, pose, omega, x, *step_speed_time, several=False):
    """The state that an OutputFilter publishes for a solved state, after the increment (omega, x)."""
    solved, increment = EvaluatedState(state, pose, None), SimpleNamespace(omega=omega, x=x)
    return output_filter.filtered(solved, increment, *step_speed_time, several_cameras=several)


def turned(vectors, place=AHEAD):
    """Joints without a parent: their rotations are their orientations."""
    return BodyState(Rotation.from_rotvec(vectors).as_matrix(), place + 0.1 * vectors[0])


def filtered(output_filter, last, state, step=STEP, time=TIME, speed=TYPICAL_SPEED, several=False):
    """The state to publish after the increment from the last state."""
    omega = Rotation.from_matrix(np.swapaxes(last.rotations, -1, -2) @ state.rotations).as_rotvec()
    moved = state.translation - last.translation
    pose = BodyPose(state.rotations, np.zeros((JOINTS, 3)), np.zeros((0, 3)))
    return published_by(output_filter, state, pose, omega.ravel(), moved, step, speed, time, several=several)


def followed(states, **settings):
    """Filter a list of states; the increments are those between them."""
    output_filter, last, published = OutputFilter(JOINTS), states[0], []
    for state in states:
        published.append(filtered(output_filter, last, state, **settings))
        last = state
    return published


def angle(a, b):
    return Rotation.from_matrix(np.swapaxes(a.rotations, -1, -2) @ b.rotations).magnitude().max()


def vectors_of(states):
    return np.array([Rotation.from_matrix(state.rotations).as_rotvec() for state in states])


@pytest.mark.parametrize("step", [1 / 30, 1 / 60, 1 / 240])
def test_steady_turns_are_published_without_lag(step):
    """The axis of each joint is constant, so that a constant rate is a constant increment."""
    speed = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 0.0], [2.0, 0.0, 0.0]])
    states = [turned(speed * step * i) for i in range(int(1 / step))]
    published = followed(states, step=step)
    assert angle(states[-1], published[-1]) < 1e-3
    assert np.abs(states[-1].translation - published[-1].translation).max() < 1e-4


def test_jitter_is_removed_and_more_so_with_a_longer_time_and_at_rest():
    noise = 0.02 * np.random.default_rng(0).normal(size=(300, JOINTS, 3))
    states = [turned(vectors) for vectors in noise]
    left = vectors_of(followed(states))[50:]
    jerk = [np.linalg.norm(np.diff(x, 2, axis=0), axis=-1).mean() for x in (noise[50:], left)]
    assert jerk[1] < 0.55 * jerk[0] and left.std() < 0.9 * noise[50:].std()
    spreads = [vectors_of(followed(states, time=time))[50:].std() for time in (0.0, 0.01, 0.05, 0.2)]
    assert spreads == sorted(spreads, reverse=True)
    assert all(a is b for a, b in zip(states, followed(states, time=0.0)))
    starting = [turned(np.full((JOINTS, 3), 0.05 * max(i - 20, 0))) for i in range(24)]
    speeds = 0.0, 0.1, TYPICAL_SPEED, 2.0, 20.0
    spreads = [vectors_of(followed(states, speed=speed))[50:].std() for speed in speeds]
    lags = [angle(starting[-1], followed(starting, speed=speed)[-1]) for speed in speeds]
    assert spreads == sorted(spreads) and spreads[0] < 0.8 * spreads[2]
    assert lags == sorted(lags, reverse=True) and lags[3] < 0.8 * lags[2]
    assert time_constant(TYPICAL_SPEED, TIME) == TIME


def test_one_camera_smooths_motion_in_depth_more_and_several_do_not():
    random = np.random.default_rng(2)
    states = [turned(0.02 * random.normal(size=(JOINTS, 3)), AHEAD + 0.02 * random.normal(size=3)) for _ in range(1000)]
    alone, several, slower = (
        followed(states, **settings)[50:] for settings in ({}, {"several": True}, {"time": DEPTH_RATIO * TIME})
    )
    turns = vectors_of(alone)
    assert turns[..., :2].std() < 0.85 * turns[..., 2].std()  # across the ray; about it
    places, both, longer = (np.array([state.translation for state in one]) for one in (alone, several, slower))
    assert places[:, 2].std() < 0.85 * places[:, :2].std()
    assert np.isclose(longer[:, 2].std(), places[:, 2].std(), rtol=0.35)
    assert np.isclose(both[:, 2].std(), both[:, :2].std(), rtol=0.1) and both[:, 2].std() > 1.1 * places[:, 2].std()
    assert np.allclose(both[:, :2], places[:, :2], atol=5e-4)


def test_depth_is_defined_by_the_camera_not_by_the_joint():
    """The same motion gives the same output if the body and its camera are rotated together."""
    random = np.random.default_rng(3)
    vectors, steps = 0.05 * random.normal(size=(40, JOINTS, 3)), 0.05 * random.normal(size=(40, 3))
    other = Rotation.random(random_state=3).as_matrix()
    plain = [BodyState(Rotation.from_rotvec(v).as_matrix(), AHEAD + p) for v, p in zip(vectors, steps)]
    published = followed(plain)
    assert max(map(angle, published, plain)) > 0.01  # the filter has an effect
    assert max(np.abs(a.translation - s.translation).max() for a, s in zip(published, plain)) > 0.01
    turned_round = followed([BodyState(other @ s.rotations, other @ s.translation) for s in plain])
    for a, b in zip(published, turned_round, strict=True):
        assert np.allclose(other @ a.rotations, b.rotations) and np.allclose(other @ a.translation, b.translation)


def test_the_first_state_and_the_one_after_a_gap_are_published_as_solved():
    output_filter = OutputFilter(JOINTS)
    a, b, c = turned(np.zeros((3, 3))), turned(np.full((3, 3), 0.3)), turned(np.full((3, 3), -0.3))
    assert filtered(output_filter, a, a, np.inf) is a
    assert angle(filtered(output_filter, a, b), b) > 0.01
    assert filtered(output_filter, b, c, 1.01 * LONGEST_STEP) is c
    output_filter.reset()
    assert filtered(output_filter, c, b) is b


def test_a_body_that_jumps_in_depth_is_not_published_through_the_camera():
    """The solved body moves towards the camera ever faster and then away; the output restarts there."""
    depths = [3.0, 3.0, 2.6, 2.0, 1.2, 0.3, 2.0, 5.0, 5.0]
    still = np.zeros((JOINTS, 3))
    states = [turned(still, np.array([0.0, 0.0, depth])) for depth in depths]
    ratios = [p.translation[2] / s.translation[2] for p, s in zip(followed(states, time=0.06), states)]
    assert max(abs(ratio - 1) for ratio in ratios) <= LARGEST_DEPTH_OFFSET and ratios[5] == 1.0
    gentle = [turned(still, np.array([0.0, 0.0, 3.0 - 0.02 * i])) for i in range(20)]
    assert followed(gentle, time=0.06)[-1].translation[2] != gentle[-1].translation[2]  # the motion that continues


def test_the_tracked_states_do_not_depend_on_the_output():
    tracks = []
    for smoothing in (0.0, 0.02, 0.5):
        tracker = Tracker(replace(CONFIG, smoothing=smoothing))
        tracks.append([tracker.track(observation) for _, observation in observations(tracker, 1.0)])
    assert all(estimate.state is estimate.solved for estimate in tracks[0])
    assert all(same(a.solved, b.solved) and same(a.solved, c.solved) for a, b, c in zip(*tracks))
    moves = [np.mean([np.abs(e.state.rotations - e.solved.rotations).max() for e in track]) for track in tracks]
    assert moves[0] == 0 and 0 < moves[1] < moves[2]


def test_the_smoothing_time_depends_on_the_speed_of_the_keypoints():
    tracker = Tracker(CONFIG)
    sequence, steadied_by, told = observations(tracker, 2.0), tracker._smoothing.filter.filtered, []
    tracker._smoothing.filter.filtered = lambda *a: told.append(a[3]) or steadied_by(*a)  # the speed
    depths = [tracker.track(observation).state.translation[2] for _, observation in sequence]
    steps = np.diff([observation.points for _, observation in observations(tracker, 2.0, noise_px=0.0)], axis=0)
    moved = np.linalg.norm(steps, axis=-1).mean(axis=1) * RATE * depths[1:]
    settled = slice(15, None)  # the velocity of a new track is noise
    assert 0.8 < np.mean(told[1:][settled]) / np.mean(moved[settled]) < 1.25
    assert np.corrcoef(told[1:][settled], moved[settled])[0, 1] > 0.5


def test_a_replaced_state_is_published_at_once():
    tracker = Tracker(replace(CONFIG, smoothing=0.1))
    for _, observation in observations(tracker, 0.5):
        estimate = tracker.track(observation)
    assert angle(estimate.state, estimate.solved) > 0
    tracker._starts.replaced = True
    estimate = tracker.track(replace(observation, stamp=0.5, points=observation.points + 1e-3))
    assert estimate.state is estimate.solved and not estimate.initialised


class Lagging:
    """A smoothing with waiting frames of a body."""

    def __init__(self, vectors=None):
        self.kinematics, self.vectors = body(), vectors
        self.smoothing, self.stamp = Smoothing(self.kinematics), 0.0
        self.none = np.zeros(3 * self.kinematics.joint_count)

    def state(self, place=AHEAD):
        rotations = np.tile(np.eye(3), (self.kinematics.joint_count, 1, 1))
        rotations[0] = FACING
        return BodyState(rotations, np.array(place))

    def add(self, state, omega, x, step=1 / RATE, speed=TYPICAL_SPEED):
        """A frame after the increment omega, x."""
        self.stamp += step
        pose, own = self.kinematics.pose(state), self.smoothing.filter
        steady = published_by(own, state, pose, omega, x, step, speed, 0.03)
        frame = one_view(np.zeros((17, 2)), np.ones(17))
        estimate = Estimate(self.stamp, Status.TRACKING, None, steady, solved=state, frame=frame)
        vectors = self.kinematics.vectors if self.vectors is None else self.vectors
        self.smoothing.add(HeldFrame(estimate, own.forward, vectors, lambda pose: float(pose.positions[0, 0])))
        return estimate

    def moved(self, values, steps, speeds=None):
        """Move the body by values (f, 3), m; the angles are constant."""
        last = values[0]
        for place, step, speed in zip(values, steps, np.full(len(steps), TYPICAL_SPEED) if speeds is None else speeds):
            self.add(self.state(place), self.none, place - last, step, speed)
            last = place
        return self.smoothing


def textbook(values, steps, times):
    """Rauch-Tung-Striebel smoothing (f, k) of values (f, k), for unit noise and accelerations 1 / times^2."""
    f = len(values)
    means, covariances, ahead = np.zeros((f, 2, values.shape[1])), np.zeros((f, 2, 2)), np.zeros((f, 2, 2))
    means[0, 0], covariances[0] = values[0], np.diag([1.0, times[0] ** -2])
    for i in range(1, f):
        F = np.array([[1.0, steps[i]], [0.0, 1.0]])
        G = np.array([[steps[i] ** 2 / 2], [steps[i]]]) / times[i] ** 2
        ahead[i] = F @ covariances[i - 1] @ F.T + G @ G.T
        gain = ahead[i][:, :1] / (ahead[i][0, 0] + 1)
        means[i] = F @ means[i - 1] + gain * (values[i] - (F @ means[i - 1])[0])
        covariances[i] = ahead[i] - gain @ ahead[i][:1]
    for i in range(f - 2, -1, -1):
        F = np.array([[1.0, steps[i + 1]], [0.0, 1.0]])
        gain = covariances[i] @ F.T @ np.linalg.inv(ahead[i + 1])
        means[i] = means[i] + gain @ (means[i + 1] - F @ means[i])
    return means[:, 0]


def test_the_backward_pass_equals_the_textbook_smoother():
    random = np.random.default_rng(0)
    steps, speeds = random.uniform(0.01, 0.05, 40), random.uniform(0.0, 3.0, 40)
    times = np.array([time_constant(speed, 0.03) for speed in speeds])
    nearer = np.cumsum(0.01 * random.normal(size=(40, 1)), axis=0) * [0.0, 0.0, 1.0] + AHEAD
    aside = np.cumsum(1e-4 * random.normal(size=(40, 3)), axis=0) * [1.0, 1.0, 0.0] + AHEAD
    for values, expected, error in ((nearer, DEPTH_RATIO * times, 1e-9), (aside, times, 1e-6)):  # the ray rotates a bit
        smooth = np.array([e.state.translation for e in Lagging().moved(values, steps, speeds).flush()])
        assert np.abs(smooth - textbook(values, steps, expected)).max() < error
    stamps, lag = np.cumsum(steps), Lagging().moved(aside, steps)
    due = lag.due(stamps[-1], 0.2)
    assert [e.stamp for e in due] == [t for t in stamps if t <= stamps[-1] - 0.197]
    assert [e.stamp for e in due + lag.flush()] == list(stamps) and lag.flush() == []


def test_steady_turns_are_left_as_they_are_by_the_backward_pass():
    """All frames equal their prediction, except for the viewing ray, which rotates relative to the joints."""
    lagging = Lagging()
    omega = np.zeros((lagging.kinematics.joint_count, 3))
    omega[0], omega[16] = [0.0, 5.0 / RATE, 0.0], [4.0 / RATE, 3.0 / RATE, 0.0]
    state, before = lagging.state(), []
    for frame in range(40):
        step = omega.reshape(-1) if frame else lagging.none
        state = state.retract(step, np.zeros(3))
        before.append(lagging.add(state, step, np.zeros(3)))
    for smooth, settled in zip(lagging.smoothing.flush()[30:], before[30:], strict=True):
        assert np.abs(smooth.state.rotations - settled.state.rotations).max() < 1e-6


def test_frames_before_and_after_a_restart_do_not_change_each_other():
    lagging = Lagging()
    state = lagging.state()
    other = state.retract(0.3 * np.random.default_rng(2).normal(size=lagging.none.shape), np.array([0.0, 0.0, 0.2]))
    for frame, solved in enumerate([state] * 6 + [other] * 12):
        if frame == 6:
            lagging.smoothing.filter.reset()
        lagging.add(solved, lagging.none, np.zeros(3))
    assert max(np.abs(e.state.rotations - e.solved.rotations).max() for e in lagging.smoothing.flush()) < 1e-9


def test_a_body_that_jumps_in_depth_is_not_smoothed_through_the_camera():
    random, none = np.random.default_rng(0), np.zeros(24)
    for _ in range(10):
        depth = np.repeat(3.0 * np.exp(random.normal(size=6)), 4)
        for estimate in Lagging().moved(np.stack([none, none, depth], axis=-1), np.full(24, 1 / 15)).flush():
            solved = estimate.solved.translation[2]
            assert abs(estimate.state.translation[2] - solved) <= (LARGEST_DEPTH_OFFSET + 1e-9) * solved


def test_pose_and_reprojection_are_of_the_smoothed_state_and_the_frames_own_body():
    values = 0.01 * np.random.default_rng(1).normal(size=(5, 3)) + AHEAD
    taller = body(height=1.9)
    due = Lagging(taller.vectors).moved(values, np.full(5, 0.02)).due(0.1, 0.02)
    assert len(due) > 0
    for estimate in due:
        expected = taller.pose(estimate.state)
        assert estimate.reprojection_px == estimate.pose.positions[0, 0]
        assert np.allclose(estimate.pose.positions, expected.positions, rtol=0, atol=1e-12)
        assert np.allclose(estimate.pose.landmarks, expected.landmarks, rtol=0, atol=1e-12)


def test_each_frame_is_published_once_in_order_after_the_lag():
    plain, lagged = Tracker(CONFIG), Tracker(LAGGED)
    sequence = [observation for _, observation in observations(plain, 1.0)]
    published = []
    for i, observation in enumerate(sequence):
        now, later = plain.track(observation), lagged.track(observation)
        assert plain.published == [now] and same(now.solved, later.solved) and same(now.state, later.state)
        assert [e.stamp for e in lagged.published] == [sequence[i - 3].stamp][: i >= 3]
        published += lagged.published
    published += lagged.flush()
    assert [e.stamp for e in published] == [o.stamp for o in sequence]
    assert [e.initialised for e in published] == [i == 0 for i in range(len(sequence))]
    assert not plain.track(observation).accepted and plain.published == [] == plain.flush()
    lagged.track(replace(observation, stamp=1.0))
    lagged.reset()
    assert lagged.published == [] == lagged.flush()


def test_a_lag_reduces_noise_and_error():
    figures = []
    for lag in (0.0, 0.034, 0.1):
        tracker = Tracker(replace(CONFIG, smoothing_lag=lag))
        sequence, published = observations(tracker, 6.0), []
        for _, observation in sequence:
            tracker.track(observation)
            published += tracker.published
        published += tracker.flush()
        error = [e.pose.positions - e.pose.positions[0] - (t - t[0]) for e, (t, _) in zip(published, sequence)]
        jerk = np.linalg.norm(np.diff(error, 2, axis=0), axis=-1).mean() * RATE**2
        figures.append((np.linalg.norm(error, axis=-1).mean(), jerk))
    errors, jerks = zip(*figures)
    assert jerks[1] < 0.75 * jerks[0] and jerks[2] <= 1.02 * jerks[1] and max(errors[1:]) < errors[0]


def test_rejected_frames_advance_the_time():
    tracker = Tracker(LAGGED)
    sequence = [observation for _, observation in observations(tracker, 0.5)]
    for observation in sequence:
        tracker.track(observation)
    nothing, last = np.zeros(17), sequence[-1].stamp
    stamps = []
    for i in range(4):
        assert not tracker.track(replace(sequence[-1], stamp=last + (i + 1) / RATE, confidence=nothing)).accepted
        stamps.append([e.stamp for e in tracker.published])
    assert stamps == [[sequence[-3].stamp], [sequence[-2].stamp], [last], []]
    tracker.track(replace(sequence[-1], stamp=last + 0.2))
    for stamp in (np.nan, np.inf, last):
        tracker.track(replace(sequence[-1], stamp=stamp))
        assert tracker.published == []


def test_what_is_published_does_not_depend_on_the_origin_of_the_skeletons_frame():
    """Here it is at the person, so that the distance from the origin is small and that from the camera is not."""
    own, other = (Tracker(replace(LAGGED, smoothing=0.1), up=UP) for _ in range(2))
    place = observations(own, 0.1)[0][0][0]
    moved = CameraPose("moved", np.eye(3), place)
    for _, observation in observations(own, 1.5):
        own.track(replace(observation, camera=CameraPose("own")))
        other.track(replace(observation, camera=moved))
        for a, b in zip(own.published, other.published, strict=True):
            assert np.abs(a.pose.positions - b.pose.positions - place).max() < 1e-4


def test_the_reprojection_error_is_that_in_the_cameras_own_image_if_it_has_turned_since():
    still, turning = (Tracker(LAGGED, up=UP) for _ in range(2))
    for _, observation in observations(still, 0.5):
        turn = exponential(np.array([0.0, np.sin(observation.stamp), 0.0]))
        points = carried(observation.points, turn, np.zeros((len(observation.points), 3)))
        still.track(replace(observation, camera=CameraPose("still")))
        turning.track(replace(observation, points=points, camera=CameraPose("turning", turn)))
        for a, b in zip(still.published, turning.published, strict=True):
            assert b.reprojection_px == pytest.approx(a.reprojection_px, abs=3.0)


def test_the_lag_can_change_while_tracking():
    tracker = Tracker(CONFIG)
    sequence = [observation for _, observation in observations(tracker, 2.7)]
    counts, published = [], []
    for i, observation in enumerate(sequence):
        if i % 20 == 0:
            tracker.tune(replace(CONFIG, smoothing_lag=(0.0, 0.1, 0.034, 0.0)[i // 20 % 4]))
        tracker.track(observation)
        counts.append(len(tracker.published))
        published += tracker.published
    assert [e.stamp for e in published] == [o.stamp for o in sequence] and not tracker.flush()
    assert counts[:20] == [1] * 20 and counts[20:24] == [0, 0, 0, 1]
    assert counts[40:42] == [3, 1] and counts[-1] == 1
