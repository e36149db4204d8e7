"""The vertical in the camera frame: that of the mount, and what is learned from a person."""

from dataclasses import replace

import numpy as np
import pytest
from cases import FACING
from scipy.spatial.transform import Rotation
from sequences import CONFIG, FOCAL, NOISE_PX, RATE, WITHOUT_NETWORK, observations

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.vertical import KNOWN_AFTER, Vertical, level_from_camera, vertical_of
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

HALF = np.pi / 2


def leaning(degrees, axis=(1.0, 0.0, 0.0)):
    """The root's orientation of a person who leans, before a level camera."""
    return FACING @ exponential(np.radians(degrees) * np.array(axis))


def apart(a, b):
    """Angle between two unit vectors, degrees."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def learned(root=None, seconds=20.0, vertical=None):
    """The vertical after a person was tracked at 30 Hz."""
    vertical = vertical or Vertical()
    for _ in range(round(30 * seconds)):
        vertical.update(leaning(20) if root is None else root, 1 / 30)
    return vertical


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
    assert np.allclose(level_from_camera(roll, pitch) @ vertical_of(roll, pitch), [0, -1, 0], atol=1e-12)


def test_roll_and_pitch_are_the_rpy_of_a_urdf():
    """The up direction, transformed by scipy from a level frame to the camera's body frame and to its optical frame."""
    optical = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])  # REP 103: x forward, y left, z up
    for roll, pitch, yaw in np.random.default_rng(0).uniform(-1.5, 1.5, size=(20, 3)):
        body = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
        assert np.allclose(vertical_of(roll, pitch), optical @ body.T @ [0, 0, 1], atol=1e-12)


def test_the_vertical_follows_the_person_and_becomes_steadier():
    vertical, person = Vertical(), leaning(20)
    assert not vertical.known and vertical.learned_for == 0
    steps = []
    for number in range(90):
        before = vertical.direction
        vertical.update(person, 1 / 30)
        steps.append(apart(vertical.direction, person[:, 1]) / apart(before, person[:, 1]))
        assert vertical.known == (vertical.learned_for > KNOWN_AFTER)
        assert np.linalg.norm(vertical.direction) == pytest.approx(1)
    assert steps == sorted(steps) and steps[0] < 0.95 and steps[-1] > 0.99
    assert vertical.learned_for == pytest.approx(3.0) and apart(vertical.direction, person[:, 1]) < 5


@pytest.mark.parametrize("degrees, used", [(55, True), (65, False), (90, False), (115, False), (175, False)])
def test_people_who_lean_by_more_than_60_degrees_are_ignored(degrees, used):
    for axis in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        vertical = learned(leaning(degrees, axis), 1.0)
        assert (vertical.learned_for > 0) == used
        assert used or np.array_equal(vertical.direction, vertical.mount)


def test_a_frame_after_a_gap_has_a_limited_weight():
    short, long = Vertical(), Vertical()
    short.update(leaning(20), 0.2)
    long.update(leaning(20), 30.0)
    assert np.array_equal(short.direction, long.direction) and short.learned_for == long.learned_for == 0.2


def test_the_vertical_that_was_learned_for_the_longest_time_is_adopted():
    short, long, new = learned(leaning(10), 1.0), learned(leaning(20), 3.0), Vertical()
    new.adopt(iter([short, long, Vertical()]))
    assert new.direction is long.direction and new.learned_for == long.learned_for
    fresh = Vertical()
    for others in ((), (Vertical(),)):
        fresh.adopt(others)
        assert np.array_equal(fresh.direction, fresh.mount) and fresh.learned_for == 0


@pytest.mark.parametrize("roll", [np.pi, HALF, -HALF])
def test_a_camera_with_configured_roll_gives_the_same_motion_as_a_level_one(roll):
    """The image and all poses are the level ones, rotated."""
    level, rolled = Tracker(WITHOUT_NETWORK), Tracker(replace(WITHOUT_NETWORK, camera_roll=roll))
    turn = exponential(np.array([0.0, 0.0, -roll]))
    states = motion(level.skeleton, np.arange(20) / RATE)
    noise = np.random.default_rng(0)
    for frame in range(20):
        state = BodyState(states.rotations[frame], np.array([0.1, 0.0, 3.5]))
        points = project(level.kinematics.pose(state).landmarks)
        points = points + noise.normal(size=points.shape) * NOISE_PX / FOCAL
        one, other = (
            tracker.track(Observation(frame / RATE, image, np.ones(17), FOCAL)).pose.positions
            for tracker, image in ((level, points), (rolled, points @ turn[:2, :2].T))
        )
        assert np.abs(other - one @ turn.T).max() < 1e-6


def test_a_tracker_learns_the_vertical_and_keeps_it_for_the_same_camera():
    tracker = Tracker(CONFIG)
    for _, observation in observations(tracker, 2.0):
        tracker.track(observation)
    direction = tracker.learned.vertical.direction
    assert tracker.learned.vertical.known and not np.array_equal(direction, vertical_of(0.0, 0.0))
    tracker.reset(same_camera=True)
    assert tracker.learned.vertical.direction is direction
    tracker.reset()
    assert np.array_equal(tracker.learned.vertical.direction, vertical_of(0.0, 0.0))


def test_a_mount_set_at_runtime_is_used_at_once_and_after_a_reset():
    tracker = Tracker(CONFIG)
    vertical = tracker.learned.vertical
    vertical.update(leaning(10), 1.0)
    learned_before = vertical.direction
    tracker.tune(replace(tracker.config, noise_px=5.0))
    assert vertical.direction is learned_before  # no mount was set
    tracker.tune(replace(tracker.config, camera_pitch=0.5))
    assert np.array_equal(vertical.direction, vertical_of(0.0, 0.5)) and vertical.configured
    vertical.update(leaning(10), 1.0)
    tracker.reset()
    assert np.array_equal(vertical.direction, vertical_of(0.0, 0.5))


def test_the_verticals_of_a_first_fit_are_those_of_pitched_cameras_until_one_is_known():
    vertical = Vertical()
    (level, free), *tilted = vertical.candidates()
    assert np.array_equal(level, vertical.mount) and free == 0.0
    for (up, cost), degrees in zip(tilted, (26, 26), strict=True):
        assert apart(up, level) == pytest.approx(degrees, abs=1) and abs(up[0]) < 1e-12 and cost > 0
    assert apart(tilted[0][0], tilted[1][0]) == pytest.approx(52, abs=2)  # one looks up, one down
    assert np.linalg.norm([up for up, _ in vertical.candidates()], axis=1) == pytest.approx(1)
    assert len(Vertical(roll=HALF, pitch=0.0).candidates()) == 1  # a known mount
    assert len(Vertical(given=np.array([0.0, 0.0, 1.0])).candidates()) == 1
    vertical.update(leaning(20), 1 / 30)
    ((up, _),) = vertical.candidates()
    assert np.array_equal(up, vertical.direction)


@pytest.mark.parametrize("pitch", [-0.45, 0.0])
def test_without_the_network_a_first_fit_tells_a_level_camera_from_one_that_looks_up(pitch):
    tracker = Tracker(WITHOUT_NETWORK)
    turn, state = exponential(np.array([pitch, 0.0, 0.0])), motion(tracker.skeleton, np.zeros(1))
    rotations = state.rotations[0].copy()
    rotations[0] = turn @ rotations[0]
    seen = tracker.kinematics.pose(BodyState(rotations, np.array([0.0, 0.0, 3.5])))
    tracker.track(Observation(0.0, project(seen.landmarks), np.ones(17), FOCAL))
    assert apart(tracker.learned.vertical.direction, turn @ np.array([0.0, -1.0, 0.0])) < 8
