"""Fixed-lag smoothing: compared with the textbook's matrices, and the order of publication."""

from dataclasses import replace

import numpy as np
import pytest
from cases import FACING, body
from sequences import CONFIG, RATE, observations, published_by, same

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.projection import carried
from lassokin_ros.core.observation import CameraPose, Status
from lassokin_ros.core.output.fixed_lag import FixedLag, Waiting
from lassokin_ros.core.output.output_filter import (
    DEPTH_RATIO,
    LARGEST_DEPTH_OFFSET,
    TYPICAL_SPEED,
    OutputFilter,
    time_constant,
)
from lassokin_ros.core.tracker import Tracker

TIME = 0.03
LAGGED = replace(CONFIG, smoothing_lag=0.1)  # three frames


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


def lagging(values, steps, vectors=None, speeds=None):
    """A FixedLag with waiting frames: the body is moved by values (f, 3), m; the angles are constant.

    speeds: (f,) m/s.
    """
    kinematics = body()
    output_filter, lag = OutputFilter(kinematics.joint_count), FixedLag(kinematics)
    rotations = np.tile(np.eye(3), (kinematics.joint_count, 1, 1))
    rotations[0], none = FACING, np.zeros(3 * kinematics.joint_count)
    last, stamp = values[0], 0.0
    speeds = np.full(len(steps), TYPICAL_SPEED) if speeds is None else speeds
    for place, step, speed in zip(values, steps, speeds):
        stamp += step
        state = BodyState(rotations, np.array(place))
        steady = published_by(output_filter, state, kinematics.pose(state), none, place - last, step, speed, TIME)
        estimate = Estimate(stamp, Status.TRACKING, None, steady, solved=state)
        own = kinematics.vectors if vectors is None else vectors
        lag.add(Waiting(estimate, output_filter.forward, own, lambda pose: float(pose.positions[0, 0])))
        last = place
    return lag


def test_the_backward_pass_equals_the_textbook_smoother():
    random = np.random.default_rng(0)
    steps = random.uniform(0.01, 0.05, 40)
    nearer = np.cumsum(0.01 * random.normal(size=(40, 1)), axis=0) * [0.0, 0.0, 1.0] + [0.0, 0.0, 3.0]
    speeds = random.uniform(0.0, 3.0, 40)
    times = np.array([time_constant(speed, TIME) for speed in speeds])
    smooth = np.array([e.state.translation for e in lagging(nearer, steps, speeds=speeds).flush()])
    assert np.abs(smooth - textbook(nearer, steps, DEPTH_RATIO * times)).max() < 1e-9
    values = np.cumsum(1e-4 * random.normal(size=(40, 3)), axis=0) * [1.0, 1.0, 0.0] + [0.0, 0.0, 3.0]
    smooth = np.array([e.state.translation for e in lagging(values, steps, speeds=speeds).flush()])
    assert np.abs(smooth - textbook(values, steps, times)).max() < 1e-6  # the viewing ray rotates a little
    stamps = np.cumsum(steps)
    lag = lagging(values, steps)
    due = lag.due(stamps[-1], 0.2)
    assert [e.stamp for e in due] == [t for t in stamps if t <= stamps[-1] - 0.197]
    assert [e.stamp for e in due + lag.flush()] == list(stamps) and lag.flush() == []


def test_a_frame_without_new_keypoints_does_not_change_earlier_frames():
    """In a steady rotation all frames equal their prediction, except for the viewing ray, which rotates relative to the
    joints.
    """
    kinematics = body()
    output_filter, lag = OutputFilter(kinematics.joint_count), FixedLag(kinematics)
    omega = np.zeros((kinematics.joint_count, 3))
    omega[0], omega[16] = [0.0, 5.0 / RATE, 0.0], [4.0 / RATE, 3.0 / RATE, 0.0]
    state = BodyState(np.tile(np.eye(3), (kinematics.joint_count, 1, 1)), np.array([0.0, 0.0, 3.0]))
    for frame in range(40):
        step = omega.reshape(-1) if frame else np.zeros(omega.size)
        state = state.retract(step, np.zeros(3))
        steady = published_by(
            output_filter, state, kinematics.pose(state), step, np.zeros(3), 1 / RATE, TYPICAL_SPEED, TIME
        )
        estimate = Estimate(frame / RATE, Status.TRACKING, None, steady, solved=state)
        lag.add(Waiting(estimate, output_filter.forward, kinematics.vectors, lambda pose: 0.0))
    settled = [waiting.estimate for waiting in lag._waiting][30:]
    assert len(settled) == 10
    for smooth, before in zip(lag.flush()[30:], settled, strict=True):
        assert np.abs(smooth.state.rotations - before.state.rotations).max() < 1e-6


def test_a_body_that_jumps_in_depth_is_not_smoothed_through_the_camera():
    random, none = np.random.default_rng(0), np.zeros(24)
    for _ in range(20):
        depth = np.repeat(3.0 * np.exp(random.normal(size=6)), 4)
        lag = lagging(np.stack([none, none, depth], axis=-1), np.full(24, 1 / 15))
        for estimate in lag.flush():
            solved = estimate.solved.translation[2]
            assert abs(estimate.state.translation[2] - solved) <= (LARGEST_DEPTH_OFFSET + 1e-9) * solved


def test_pose_and_reprojection_are_of_the_smoothed_state_and_the_frames_own_body():
    random = np.random.default_rng(1)
    values = 0.01 * random.normal(size=(5, 3)) + [0.0, 0.0, 3.0]
    taller = body(height=1.9)
    due = lagging(values, np.full(5, 0.02), taller.vectors).due(0.1, 0.02)
    assert len(due) > 0
    for estimate in due:
        assert np.allclose(estimate.pose.positions[0], estimate.state.translation)
        assert estimate.reprojection_px == estimate.pose.positions[0, 0]
        expected = taller.pose(estimate.state)
        assert np.allclose(estimate.pose.positions, expected.positions, rtol=0, atol=1e-12)
        assert np.allclose(estimate.pose.landmarks, expected.landmarks, rtol=0, atol=1e-12)


def test_without_a_lag_the_answer_is_published_unchanged():
    tracker = Tracker(CONFIG)
    for _, observation in observations(tracker, 1.0):
        estimate = tracker.track(observation)
        assert len(tracker.published) == 1 and tracker.published[0] is estimate
    assert not tracker.track(observation).accepted and tracker.published == [] == tracker.flush()


def test_each_frame_is_published_once_in_order_after_the_lag():
    plain, lagged = Tracker(CONFIG), Tracker(LAGGED)
    sequence = [observation for _, observation in observations(plain, 2.0)]
    published = []
    for i, observation in enumerate(sequence):
        now, later = plain.track(observation), lagged.track(observation)
        assert same(now.solved, later.solved) and same(now.state, later.state)
        assert [e.stamp for e in lagged.published] == [sequence[i - 3].stamp][: i >= 3]
        published += lagged.published
    published += lagged.flush()
    assert [e.stamp for e in published] == [o.stamp for o in sequence]
    assert [e.initialised for e in published] == [i == 0 for i in range(len(sequence))]


def test_smoothing_reduces_noise_and_error():
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


def test_smoothing_stops_at_an_initialisation():
    """Frames that wait when the person is lost are published without later frames."""
    ended, went_on = Tracker(LAGGED), Tracker(LAGGED)
    sequence = [observation for _, observation in observations(ended, 1.0)]
    for observation in sequence:
        ended.track(observation)
        went_on.track(observation)
    assert went_on.track(replace(sequence[0], stamp=sequence[-1].stamp + 2.0)).initialised
    rest = ended.flush()
    assert len(rest) == len(went_on.published) == 3
    for a, b in zip(rest, went_on.published):
        assert a.stamp == b.stamp and same(a.state, b.state)


def test_what_is_published_does_not_depend_on_the_origin_of_the_skeletons_frame():
    """Here it is at the person, so that the distance from the origin is small and that from the camera is not."""
    up = np.array([0.0, -1.0, 0.0])
    own, other = (Tracker(replace(LAGGED, smoothing=0.1), up=up) for _ in range(2))
    place = observations(own, 0.1)[0][0][0]
    moved = CameraPose("moved", np.eye(3), place)
    for _, observation in observations(own, 2.0):
        own.track(replace(observation, camera=CameraPose("own")))
        other.track(replace(observation, camera=moved))
        for a, b in zip(own.published, other.published, strict=True):
            assert np.abs(a.pose.positions - b.pose.positions - place).max() < 1e-4


def test_the_reprojection_error_is_that_in_the_cameras_own_image_if_it_has_turned_since():
    still, turning = (Tracker(LAGGED, up=np.array([0.0, -1.0, 0.0])) for _ in range(2))
    for _, observation in observations(still, 1.0):
        turn = exponential(np.array([0.0, np.sin(observation.stamp), 0.0]))
        points = carried(observation.points, turn, np.zeros((len(observation.points), 3)))
        still.track(replace(observation, camera=CameraPose("still")))
        turning.track(replace(observation, points=points, camera=CameraPose("turning", turn)))
        for a, b in zip(still.published, turning.published, strict=True):
            assert b.reprojection_px == pytest.approx(a.reprojection_px, abs=3.0)


def test_reset_drops_waiting_frames():
    tracker = Tracker(LAGGED)
    for _, observation in observations(tracker, 0.5):
        tracker.track(observation)
    tracker.reset()
    assert tracker.published == [] == tracker.flush()


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


@pytest.mark.parametrize("smoothing", [0.0, 0.02])
def test_without_smoothing_frames_only_wait(smoothing):
    tracker = Tracker(replace(LAGGED, smoothing=smoothing))
    answers, published = [], []
    for _, observation in observations(tracker, 1.0):
        answers.append(tracker.track(observation))
        published += tracker.published
    assert all(same(a.state, b.state) for a, b in zip(answers, published)) == (smoothing == 0.0)


def test_waiting_frames_are_not_changed_by_a_replaced_state():
    """The frames before a restart of the filter and those after it are published as without the others."""
    kinematics = body()
    rotations = np.tile(np.eye(3), (kinematics.joint_count, 1, 1))
    rotations[0], none = FACING, np.zeros(3 * kinematics.joint_count)
    state = BodyState(rotations, np.array([0.0, 0.0, 3.0]))
    other = state.retract(0.3 * np.random.default_rng(2).normal(size=none.shape), np.array([0.0, 0.0, 0.2]))
    output_filter, lag = OutputFilter(kinematics.joint_count), FixedLag(kinematics)
    for frame, solved in enumerate([state] * 6 + [other] * 12):
        if frame == 6:
            output_filter.reset()
        pose = kinematics.pose(solved)
        steady = published_by(output_filter, solved, pose, none, np.zeros(3), 1 / RATE, TYPICAL_SPEED, TIME)
        estimate = Estimate(frame / RATE, Status.TRACKING, None, steady, solved=solved)
        lag.add(Waiting(estimate, output_filter.forward, kinematics.vectors, lambda pose: 0.0))
    published = lag.flush()
    away = [np.abs(e.state.rotations - e.solved.rotations).max() for e in published]
    assert max(away) < 1e-9
