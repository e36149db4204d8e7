"""The first state, for bodies in any orientation: upright, lying, upside down, seen from above."""

import numpy as np
import pytest
from cases import FACING, one_view
from sequences import FOCAL, NOISE_PX, WITHOUT_NETWORK

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.initialisation import LEAST_DEPTH, START_ROTATIONS, START_TURNS, Initialiser
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.vertical import vertical_of
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

TURNS = START_ROTATIONS @ FACING
"""Rotations from upright before a level camera to each orientation."""
PLACE = np.array([0.1, 0.0, 3.5])
WEIGHTS = np.full(17, FOCAL / NOISE_PX)


def turned(state, turn):
    """The state with the body rotated about its pelvis by turn (3, 3) in the camera frame, in front of the camera."""
    rotations = state.rotations.copy()
    rotations[0] = turn @ rotations[0]
    return BodyState(rotations, PLACE)


def error(kinematics, found, truth):
    """Mean distance of the joints, pelvis on pelvis, m."""
    places, right = (kinematics.pose(state).positions for state in (found, truth))
    return np.linalg.norm((places - places[0]) - (right - right[0]), axis=-1).mean()


def seen(kinematics, state, seed=0):
    noise = np.random.default_rng(seed).normal(size=(kinematics.landmark_count, 2)) * NOISE_PX / FOCAL
    return project(kinematics.pose(state).landmarks) + noise


def standing(tracker):
    return BodyState(motion(tracker.skeleton, np.array([0.3])).rotations[0], PLACE)


def test_start_rotations_have_the_six_up_directions():
    ups = START_ROTATIONS[:, :, 1]
    assert np.array_equal(np.linalg.det(TURNS), np.ones(6)) and np.array_equal(TURNS[0], np.eye(3))
    assert np.array_equal(TURNS @ TURNS.swapaxes(1, 2), np.broadcast_to(np.eye(3), (6, 3, 3)))
    assert sorted(map(tuple, ups)) == sorted(map(tuple, [*np.eye(3), *-np.eye(3)]))
    corner = np.array([1.0, -1.0, 1.0]) / np.sqrt(3)  # no direction is near
    assert np.degrees(np.arccos((ups @ corner).max())) < 55


@pytest.mark.parametrize("side", [0, 120, 240])
@pytest.mark.parametrize("orientation", range(6))
def test_initialisation_finds_a_body_of_any_orientation_from_one_frame(orientation, side):
    """The prior's mean pose, within 40 degrees of the orientation, noise of 2 px, a level camera."""
    tracker = Tracker(WITHOUT_NETWORK)
    kinematics, prior = tracker.kinematics, PoseDistribution.load(tracker.skeleton)
    random = np.random.default_rng([orientation, side])
    axis = random.normal(size=3)
    lean = exponential(np.radians(random.uniform(0, 40)) * axis / np.linalg.norm(axis))
    rotations = exponential(prior.mean)
    rotations[0] = lean @ START_ROTATIONS[orientation] @ exponential(np.array([0, np.radians(side), 0]))
    truth = BodyState(rotations, PLACE)
    fit = tracker._starts.initialiser.fit(one_view(seen(kinematics, truth, side), WEIGHTS))
    assert error(kinematics, fit.state, truth) < 0.08


def test_an_upright_body_needs_no_other_start_orientations(monkeypatch):
    tracker = Tracker(WITHOUT_NETWORK)
    orientations, starts = [], Initialiser._starts

    def recorded(self, sides, chosen, frame):
        orientations.append((len(sides), chosen))
        return starts(self, sides, chosen, frame)

    monkeypatch.setattr(Initialiser, "_starts", recorded)
    upright = standing(tracker)

    def tried(turn, up):
        orientations.clear()
        points = seen(tracker.kinematics, turned(upright, turn))
        fit = tracker._starts.initialiser.fit(one_view(points, WEIGHTS, up))
        assert error(tracker.kinematics, fit.state, turned(upright, turn)) < 0.15
        return orientations

    level, upside_down = vertical_of(0.0, 0.0), vertical_of(np.pi, 0.0)
    assert tried(TURNS[0], level) == [(START_TURNS, [0])]
    assert tried(TURNS[1], level) == [(START_TURNS, [0]), (START_TURNS // 2, [1, 2, 3, 4, 5])]
    assert tried(TURNS[3], upside_down) == [(START_TURNS, [3])]


def test_the_fit_is_the_start_with_the_lowest_cost():
    tracker = Tracker(WITHOUT_NETWORK)
    frame = one_view(seen(tracker.kinematics, standing(tracker)), WEIGHTS)
    fit, model = tracker._starts.initialiser.fit(frame), tracker.frame_model
    assert fit.cost == pytest.approx(float(model.cost(model.evaluate(fit.state), frame)))
    states = tracker._starts.initialiser._starts(range(START_TURNS), [0], frame)
    costs = model.cost(model.evaluate(states), frame)
    best = tracker._starts.initialiser.best(states, frame)
    assert best.cost == pytest.approx(costs.min()) and fit.cost < 0.2 * best.cost
    assert np.array_equal(best.state.rotations, states.rotations[costs.argmin()])


def test_the_translation_places_a_body_where_its_image_is():
    tracker = Tracker(WITHOUT_NETWORK)
    truth = standing(tracker)
    frame = one_view(project(tracker.kinematics.pose(truth).landmarks), np.where(np.arange(17) == 4, 0.0, 300.0))
    rotations = np.stack([truth.rotations, tracker._starts.initialiser.mean_pose])
    placed = tracker._starts.initialiser.with_translation(rotations, frame)
    assert placed.rotations is rotations and placed.translation.shape == (2, 3)
    assert np.abs(placed.translation[0] - PLACE).max() < 1e-9
    again = tracker.kinematics.pose(BodyState(placed.rotations[0], placed.translation[0])).landmarks
    assert np.allclose(project(again), project(tracker.kinematics.pose(truth).landmarks))


@pytest.mark.parametrize("side", [-0.4, 0.0, 0.4])
def test_a_body_that_fits_behind_the_camera_is_flipped_to_its_front(side):
    """The image of a body upside down and turned: the least squares put it behind the camera, at the opposite point."""
    tracker = Tracker(WITHOUT_NETWORK)
    place = np.array([side, -0.2, 3.5])
    truth = BodyState(standing(tracker).rotations, place)
    frame = one_view(project(tracker.kinematics.pose(truth).landmarks), WEIGHTS)
    half_turn = truth.rotations.copy()
    half_turn[0] = np.diag([-1.0, -1.0, 1.0]) @ half_turn[0]  # both image axes are reversed
    placed = tracker._starts.initialiser.with_translation(half_turn[None], frame).translation[0]
    assert placed[2] > 2.0 and np.abs(placed[:2] / placed[2] - place[:2] / place[2]).max() < 0.1


def test_no_iteration_takes_a_body_behind_the_camera():
    tracker = Tracker(WITHOUT_NETWORK)
    truth = standing(tracker)
    frame = one_view(seen(tracker.kinematics, truth), WEIGHTS)
    random = np.random.default_rng(0)
    states = BodyState(np.tile(truth.rotations, (8, 1, 1, 1)), random.normal(size=(8, 3)) + [0, 0, 0.5])
    for _ in range(5):
        states = tracker._starts.initialiser.iterate(states, frame, [8.0])
        assert states.translation[:, 2].min() >= LEAST_DEPTH and np.isfinite(states.rotations).all()
