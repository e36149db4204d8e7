"""Measured depth: rows compared with finite differences, a heavy tail, gating, and its effect on tracking."""

from dataclasses import replace

import numpy as np
import pytest
from cases import after_step, body, one_view, random_state, with_view
from sequences import CONFIG, FOCAL, RATE, aligned_error, observations

from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.image_points import LARGEST_COST
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.gating import gate_depth
from lassokin_ros.core.image.projection import huber_weights, project
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

DEVIATION = 0.03


@pytest.fixture
def scene():
    kinematics = body()
    model = FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton))
    random = np.random.default_rng(1)
    state = random_state(random, kinematics, 0.4)
    landmarks = kinematics.pose(state).landmarks
    weights = np.full(17, 1 / DEVIATION)
    weights[3] = 0.0
    depth = landmarks[:, 2] + 0.02 * random.normal(size=17)
    return model, state, one_view(project(landmarks), np.full(17, 300.0), depth=depth, depth_weights=weights)


def test_rows_are_the_derivative_of_the_depth(scene):
    model, state, frame = scene
    rows = model.linearise(model.evaluate(state), frame, huber_weights)
    which = rows.rows["measured depth"]
    J, z = rows.columns[:, which].T, rows.z[which]

    def depths(step):
        return model.kinematics.pose(after_step(model, state, step)).landmarks[:, 2]

    steps = 1e-6 * np.eye(J.shape[1])
    slopes = np.stack([(depths(step) - depths(-step)) / 2e-6 for step in steps], axis=1)
    factor = np.divide(
        z, frame.views[0].depth - depths(0 * steps[0]), out=np.zeros(17), where=frame.views[0].depth_weights > 0
    )
    assert np.abs(J - factor[:, None] * slopes).max() < 1e-5
    assert not J[3].any() and z[3] == 0


def test_cost_and_rows_agree(scene):
    """J^T z of the rows equals the gradient of the cost up to the loss' curvature; both vanish for large errors."""
    model, state, frame = scene
    near = float(model.measured_depth.cost(model.evaluate(state), frame))
    far, behind = (with_view(frame, depth=frame.views[0].depth + shift) for shift in (-5.0, 5.0))
    bounded, limit = (float(model.measured_depth.cost(model.evaluate(state), there)) for there in (far, behind))
    assert near < bounded < limit == pytest.approx(16 * LARGEST_COST)
    rows = model.linearise(model.evaluate(state), far, huber_weights)
    assert np.abs(rows.z[rows.rows["measured depth"]]).max() < 0.3


def test_a_body_that_comes_nearer_is_no_occluder(scene):
    """If all depths change by 4 standard deviations, the rows keep their weights; a single one by 8 loses its."""
    model, state, frame = scene

    def weights(depth):
        rows = model.linearise(model.evaluate(state), with_view(frame, depth=depth), huber_weights)
        return rows.columns[-1, rows.rows["measured depth"]] * DEVIATION

    all_of_them = weights(frame.views[0].depth - 0.12)
    one = weights(frame.views[0].depth - 0.24 * (np.arange(17) == 5))
    seen = np.delete(np.arange(17), 3)
    assert all_of_them[seen].min() > 0.7 and one[5] < 0.6 and np.delete(one, [3, 5]).min() > 0.7
    assert weights(frame.views[0].depth + 2.5).max() == 0.0  # the wall behind


def test_without_depth_there_are_no_rows(scene):
    model, state, frame = scene
    without = one_view(frame.views[0].points, frame.views[0].weights)
    rows = model.linearise(model.evaluate(state), without, huber_weights)
    with_depth = model.linearise(model.evaluate(state), frame, huber_weights)
    assert with_depth.z.shape[-1] == rows.z.shape[-1] + 17
    assert set(with_depth.rows) - set(rows.rows) == {"measured depth"}
    for name in {*rows.rows} - {"pose prior"}:  # the prior has less weight
        assert np.array_equal(with_depth.z[with_depth.rows[name]], rows.z[rows.rows[name]])


@pytest.mark.parametrize(
    "depth", [np.full(17, np.nan), np.zeros(17), np.full(17, np.inf), -np.ones(17), np.full(17, 65.535e3)]
)
def test_invalid_depth_is_not_used(depth):
    observation = Observation(0.0, np.zeros((17, 2)), np.ones(17), FOCAL, depth=depth)
    assert gate_depth(observation, np.ones(17, bool), 0.0, None, 1.75, DEVIATION) is None


def test_background_is_not_used_and_the_surface_is_in_front_of_the_landmark():
    depth = np.full(17, 2.5)
    depth[5] = 5.0
    observation = Observation(0.0, np.zeros((17, 2)), np.ones(17), FOCAL, depth=depth, depth_of_surface=True)
    used, weights = gate_depth(observation, np.ones(17, bool), np.full(17, 0.05), None, 1.75, DEVIATION)
    assert weights[5] == 0 and np.isclose(weights[4], 1 / DEVIATION) and np.isclose(used[4], 2.55)


def followed(with_depth):
    """(mean joint error, mean root error) over 2 s, m; the landmarks' depths have noise and occluders."""
    tracker, random = Tracker(CONFIG), np.random.default_rng(0)
    times = np.arange(60) / RATE
    landmarks = tracker.kinematics.pose(motion(tracker.skeleton, times)).landmarks
    errors = []
    for number, (truth, observation) in enumerate(observations(tracker)):
        if with_depth:
            depth = landmarks[number, :, 2] + 0.02 * random.normal(size=17)
            depth[random.random(17) < 0.1] -= 0.3
            observation = replace(observation, depth=depth)
        estimate = tracker.track(observation)
        assert estimate.certificate.kkt_residual < 1e-6
        root = np.linalg.norm(estimate.pose.positions[0] - truth[0])
        errors.append((aligned_error(estimate, truth), root))
    return np.mean(errors, axis=0)


def test_a_tracker_with_depth_is_nearer_to_the_truth():
    joints, root = followed(False)
    with_joints, with_root = followed(True)
    assert with_joints < 0.8 * joints and with_root < 0.03


def test_a_wall_behind_the_person_in_all_points_does_no_harm(distance=1.0):
    """As in the image of another camera. The body stays where the keypoints place it, also in the first frame."""
    tracker, alone = Tracker(CONFIG), Tracker(CONFIG)
    for truth, observation in observations(tracker):
        wall = np.full(17, truth[0, 2] + distance)
        places = [
            t.track(o).pose.positions for t, o in ((tracker, replace(observation, depth=wall)), (alone, observation))
        ]
        assert np.linalg.norm(places[0][0] - places[1][0]) < 0.2


def test_depth_may_be_missing_in_some_frames():
    tracker = Tracker(CONFIG)
    for number, (truth, observation) in enumerate(observations(tracker)):
        depth = np.full(17, truth[0, 2]) if number % 3 else None
        estimate = tracker.track(replace(observation, depth=depth))
        assert estimate.accepted and aligned_error(estimate, truth) < 0.3


@pytest.mark.parametrize("jump, with_depth, expected", [(0.0, True, 1), (0.1, True, 2), (0.1, False, 1)])
def test_a_frame_with_depth_is_linearised_again_after_a_large_increment(jump, with_depth, expected, monkeypatch):
    """The body stands still for 10 frames, and then is `jump` m farther away."""
    tracker = Tracker(CONFIG)
    pose = tracker.kinematics.pose(motion(tracker.skeleton, np.zeros(1)))
    solve, solved = tracker._increments.lasso.solve, []
    monkeypatch.setattr(tracker._increments.lasso, "solve", lambda *given: solved.append(1) or solve(*given))
    for number in range(11):
        landmarks = pose.landmarks[0] + [0.0, 0.0, jump * (number == 10)]
        depth = landmarks[:, 2] if with_depth else None
        points = project(landmarks) + 1e-6 * number  # new keypoints in each frame
        solved.clear()
        assert tracker.track(Observation(number / RATE, points, np.ones(17), FOCAL, depth=depth)).accepted
    assert len(solved) == expected
