"""Bodies that are not upright before a level camera: lying, upside down, seen from above, or by a tilted camera."""

from dataclasses import replace

import numpy as np
import pytest
from cases import FACING
from lassokin_ros.core.hypotheses.start_orientations import START_ROTATIONS, nearest
from scipy.spatial.transform import Rotation
from sequences import CONFIG, FOCAL, NOISE_PX, RATE

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.evidence.upright import TILT, TILT_COST, Upright, vertical_of
from lassokin_ros.core.hypotheses.initialisation import Fit, Initialiser
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

TURNS = START_ROTATIONS @ FACING
"""Rotations from upright before a level camera to each orientation."""
PLACE = np.array([0.1, 0.0, 3.5])
HALF = np.pi / 2


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


def test_start_rotations_have_the_six_up_directions():
    ups = -TURNS[:, :, 1]
    assert np.array_equal(np.linalg.det(TURNS), np.ones(6)) and np.array_equal(TURNS[0], np.eye(3))
    assert np.array_equal(TURNS @ TURNS.swapaxes(1, 2), np.broadcast_to(np.eye(3), (6, 3, 3)))
    assert sorted(map(tuple, ups)) == sorted(map(tuple, [*np.eye(3), *-np.eye(3)]))
    for orientation, up in enumerate(ups):
        assert nearest(up) == nearest(up + [0.4, -0.5, 0.3]) == orientation
    corner = np.array([1.0, -1.0, 1.0]) / np.sqrt(3)  # no direction is near
    assert np.degrees(np.arccos((ups @ corner).max())) < 55


@pytest.mark.parametrize("side", [0, 120, 240])
@pytest.mark.parametrize("orientation", range(6))
def test_initialisation_finds_a_body_of_any_orientation_from_one_frame(orientation, side):
    """The prior's mean pose, within 40 degrees of the orientation, noise of 2 px, a level camera."""
    tracker = Tracker(CONFIG)
    kinematics, prior = tracker.kinematics, PoseDistribution.load(tracker.skeleton)
    random = np.random.default_rng([orientation, side])
    axis = random.normal(size=3)
    lean = exponential(np.radians(random.uniform(0, 40)) * axis / np.linalg.norm(axis))
    rotations = exponential(prior.mean)
    rotations[0] = lean @ START_ROTATIONS[orientation] @ exponential(np.array([0, np.radians(side), 0]))
    truth = BodyState(rotations, PLACE)
    fit = tracker._initialiser.fit(FrameData(seen(kinematics, truth, side), np.full(17, FOCAL / NOISE_PX)))
    assert error(kinematics, fit.best, truth) < 0.08


def test_an_upright_body_needs_no_other_start_orientations(monkeypatch):
    tracker = Tracker(CONFIG)
    orientations = []
    starts = Initialiser._starts

    def recorded_starts(self, sides, chosen, frame):
        orientations.append(chosen)
        return starts(self, sides, chosen, frame)

    monkeypatch.setattr(Initialiser, "_starts", recorded_starts)
    state = motion(tracker.skeleton, np.array([0.3]))
    upright = BodyState(state.rotations[0], PLACE)
    points, weights = seen(tracker.kinematics, upright), np.full(17, FOCAL / NOISE_PX)
    mirroring, mirrored = tracker._initialiser.mirroring, []
    all_limbs = mirroring.all
    monkeypatch.setattr(mirroring, "all", lambda state: mirrored.append(state) or all_limbs(state))
    tracker._initialiser.fit(FrameData(points, weights))
    assert len(mirrored) == 1  # the fits for tilted cameras are worse and not refined
    assert orientations == [[0]] * 3  # for a level camera, one that looks up, and one that looks down
    del orientations[:]
    tracker._initialiser.fit(FrameData(seen(tracker.kinematics, turned(upright, TURNS[1])), weights))
    assert orientations == [[0], [1, 2, 3, 4, 5], [0], [0]]
    del orientations[:]
    tracker._upright.set_mount(np.pi, 0.0)  # the camera is known to be upside down
    tracker._initialiser.fit(FrameData(seen(tracker.kinematics, turned(upright, TURNS[3])), weights))
    assert orientations == [[3]] * 3
    del orientations[:]
    tracker._upright.learn(TURNS[3] @ FACING, 0.1)  # and a person was tracked
    tracker._initialiser.fit(FrameData(seen(tracker.kinematics, turned(upright, TURNS[3])), weights))
    assert orientations == [[3]]


@pytest.mark.parametrize("orientation", [1, 2, 4])
def test_hypotheses_of_a_lying_body_also_lie(orientation):
    """The hypotheses are turned about the body's long axis; one that faces the wrong way is found."""
    tracker = Tracker(CONFIG)
    state = motion(tracker.skeleton, np.array([0.3]))
    lying = turned(BodyState(state.rotations[0], PLACE), TURNS[orientation])
    points, weights = seen(tracker.kinematics, lying), np.full(17, FOCAL / NOISE_PX)
    back = lying.rotations.copy()
    back[0] = back[0] @ np.diag([-1.0, 1.0, -1.0])
    pool, live = tracker._body_hypotheses, tracker._rows.live
    pool.start(BodyState(back, PLACE), FrameData(points, weights))
    hypothesis, published = pool._states.state.rotations[:, 0]
    assert nearest(hypothesis[:, 1]) == orientation
    assert hypothesis[:, 2] @ published[:, 2] < -0.8  # the opposite side first
    for _ in range(30):
        pool.linearise(FrameData(points, weights))
        pool.advance(np.zeros(72), np.zeros(3), np.full(len(live), 1e-3))
        pool.compute_costs(FrameData(points, weights))
        winner = pool.select(FrameData(points, weights), np.full(len(live), 1e-3))
        if winner is not None:
            break
    assert winner is not None and error(tracker.kinematics, winner, lying) < 0.1


@pytest.mark.parametrize(
    ("roll", "pitch", "up"),
    [
        (0.0, 0.0, (0, -1, 0)),
        (HALF, 0.0, (-1, 0, 0)),  # its right side is down: up is to its left
        (-HALF, 0.0, (1, 0, 0)),
        (np.pi, 0.0, (0, 1, 0)),
        (0.0, HALF, (0, 0, -1)),  # it looks down: up is behind it
        (0.0, -HALF, (0, 0, 1)),
        (0.0, np.pi / 6, (0, -np.cos(np.pi / 6), -0.5)),
    ],
)
def test_the_vertical_follows_from_the_mount(roll, pitch, up):
    assert np.allclose(vertical_of(roll, pitch), up, atol=1e-12)


def test_roll_and_pitch_are_the_rpy_of_a_urdf():
    """The up direction, transformed by scipy from a level frame to the camera's body frame and to its optical frame."""
    optical = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])  # REP 103: x forward, y left, z up
    for roll, pitch, yaw in np.random.default_rng(0).uniform(-1.5, 1.5, size=(20, 3)):
        body = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
        assert np.allclose(vertical_of(roll, pitch), optical @ body.T @ [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("roll", [np.pi, HALF, -HALF])
def test_a_camera_with_configured_roll_gives_the_same_motion_as_a_level_one(roll):
    """The image and all poses are the level ones, rotated."""
    level, rolled = Tracker(CONFIG), Tracker(replace(CONFIG, camera_roll=roll))
    turn = exponential(np.array([0.0, 0.0, -roll]))
    states = motion(level.skeleton, np.arange(20) / RATE)
    for frame in range(20):
        points = seen(level.kinematics, BodyState(states.rotations[frame], PLACE), frame)
        one, other = (
            tracker.track(Observation(frame / RATE, image, np.ones(17), FOCAL))
            for tracker, image in ((level, points), (rolled, points @ turn[:2, :2].T))
        )
        assert error(level.kinematics, other.state, turned(one.state, turn)) < 1e-6


@pytest.mark.parametrize("pitch", [0.8, -0.7])
def test_a_standing_person_before_a_configured_tilted_camera_does_not_lean(pitch):
    tracker = Tracker(replace(CONFIG, camera_pitch=pitch))
    root = exponential(np.array([pitch, 0.0, 0.0])) @ FACING
    assert np.abs(tracker._upright.rows(root)[1]).max() < 1e-9
    assert np.abs(tracker._upright.rows(FACING)[1]).max() > 1.0


@pytest.mark.parametrize("roll, pitch", [(0.0, 0.0), (0.0, 0.6), (HALF, 0.0), (2.5, -0.4), (0.0, HALF)])
def test_the_first_state_is_fitted_with_the_mount_and_with_tilted_verticals(roll, pitch):
    upright = Upright(roll, pitch)
    (mounted, free), *tilted = upright.candidates()
    assert np.array_equal(mounted, vertical_of(roll, pitch)) and free == 0.0
    assert [cost for _, cost in tilted] == [TILT_COST] * 2
    verticals = np.array([vertical for vertical, _ in tilted])
    assert np.allclose(np.arccos(verticals @ mounted), TILT)
    assert np.arccos(verticals[0] @ verticals[1]) == pytest.approx(2 * TILT)
    across = np.cross(mounted, [0.0, 0.0, 1.0])  # no tilt about the line of sight
    assert np.abs(verticals @ across).max() < 1e-9


def test_initialisation_uses_the_learned_vertical_after_a_person_was_tracked():
    upright = Upright()
    upright.vertical, _ = upright.candidates()[1]  # a first state that was rejected: nothing was learned
    assert len(upright.candidates()) == 3 and np.array_equal(upright.candidates()[0][0], vertical_of(0.0, 0.0))
    upright.learn(FACING, 0.1)
    assert len(upright.candidates()) == 1 and upright.candidates()[0][0] is upright.vertical
    upright.reset()
    assert len(upright.candidates()) == 3


@pytest.mark.parametrize("side", [0, 120, 240])
@pytest.mark.parametrize("pitch", [0.52, 0.0, -0.52])
def test_the_tilt_of_a_camera_is_found_from_one_frame(pitch, side):
    """The prior's mean pose, upright, noise of 2 px.

    The result does not lean, nor does a level camera become tilted.
    """
    tracker = Tracker(CONFIG)
    rotations = exponential(PoseDistribution.load(tracker.skeleton).mean)
    rotations[0] = exponential(np.array([pitch, 0.0, 0.0])) @ FACING @ exponential(np.array([0, np.radians(side), 0]))
    truth = BodyState(rotations, PLACE)
    fit = tracker._initialiser.fit(FrameData(seen(tracker.kinematics, truth, side), np.full(17, FOCAL / NOISE_PX)))
    assert error(tracker.kinematics, fit.best, truth) < 0.04
    believed = tracker._upright.vertical
    assert np.arccos(believed @ vertical_of(0.0, pitch)) < 0.1


@pytest.mark.parametrize(
    ("level", "tilted", "tilt"),
    [(10.0, 5.5, True), (10.0, 6.5, False), (34.0, 25.0, True), (34.0, 27.0, False)],
)
def test_a_tilted_camera_must_explain_a_frame_much_better(monkeypatch, level, tilted, tilt):
    """By a cost of 4, if the cost is up to 1 per landmark; by proportionally more if all fits are worse."""
    tracker = Tracker(CONFIG)
    state = motion(tracker.skeleton, np.array([0.3]))
    costs = iter((level, tilted, tilted + 9))
    monkeypatch.setattr(Initialiser, "_fit", lambda self, *given: Fit(state, np.array([next(costs)])))
    _, (up, cost), _ = tracker._upright.candidates()
    fit = tracker._initialiser.fit(FrameData(np.zeros((17, 2)), np.ones(17)))
    assert (tracker._upright.vertical is not tracker._upright._first) == tilt
    assert np.array_equal(tracker._upright.vertical, up) == tilt
    assert fit.costs[0] == pytest.approx(tilted + cost * max(1.0, level / 17) if tilt else level)


def test_a_mount_set_at_runtime_is_used_at_once_and_after_a_reset():
    tracker = Tracker(CONFIG)
    root = FACING @ exponential(np.array([0.2, 0.0, 0.0]))
    tracker._upright.learn(root, 1.0)
    learned = tracker._upright.vertical
    tracker.tune(replace(tracker.config, noise_px=5.0))
    assert tracker._upright.vertical is learned  # no mount was set
    tracker.tune(replace(tracker.config, camera_pitch=0.5))
    assert np.array_equal(tracker._upright.vertical, vertical_of(0.0, 0.5))
    tracker._upright.learn(root, 1.0)
    tracker.reset()
    assert np.array_equal(tracker._upright.vertical, vertical_of(0.0, 0.5))


def test_half_a_turn_is_a_valid_mount():
    for name, angle in (("camera_roll", np.pi), ("camera_roll", -np.pi), ("camera_pitch", np.pi / 2)):
        assert TrackerConfig(**{name: float(angle)}).checked()
