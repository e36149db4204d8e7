"""The size from feet on the floor: its ratio and deviation, and a tracker that measures or refuses it."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body
from sequences import CONFIG, FOCAL, RATE

from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.core.evidence.floor import ANKLE_HEIGHT, DEVIATION
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.height import LARGEST_FLOOR_DEVIATION, floor_size
from lassokin_ros.core.learned.vertical import level_from_camera
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

HEIGHT, PITCH = 1.6, 0.3
UP = np.array([0.0, -1.0, 0.0])


def ankles_of(ratio, distance=4.0, camera_height=1.5, raised=0.0):
    """(2, 3) m: a body of HEIGHT on the floor, as a body of another size shows it; the second ankle is raised."""
    down = camera_height - ANKLE_HEIGHT * HEIGHT
    return np.array([[0.1, down, distance], [-0.1, down - raised, distance]]) / ratio


@pytest.mark.parametrize("ratio", [0.8, 1.0, 1.3])
def test_the_ratio_is_that_of_the_sizes(ratio):
    floor = np.append(UP, 1.5)
    found = floor_size(ankles_of(ratio, raised=0.1), floor, np.zeros(3), HEIGHT / ratio, 0.0)
    assert found.ratio == pytest.approx(ratio)
    assert found.deviation == pytest.approx(DEVIATION / 1.5)


def test_the_camera_may_be_anywhere_in_the_skeletons_frame():
    turn, centre = level_from_camera(0.4, 0.3), np.array([1.0, 2.0, 3.0])
    up = turn @ UP
    floor = np.append(up, 1.5 - up @ centre)
    found = floor_size(ankles_of(1.2) @ turn.T + centre, floor, centre, HEIGHT / 1.2, 0.01)
    assert found.ratio == pytest.approx(1.2)


def test_the_deviation_is_that_of_tilt_and_distance():
    for distance in (2.0, 6.0):
        ankles = ankles_of(1.0, distance)
        for tilt in (-1e-4, 1e-4):
            leaned = np.append(np.array([0.0, -np.cos(tilt), np.sin(tilt)]), 1.5)
            change = np.log(floor_size(ankles, leaned, np.zeros(3), HEIGHT, 0.01).ratio)
            assert abs(change) == pytest.approx(1e-4 * distance / 1.5, rel=0.01)
        stated = floor_size(ankles, np.append(UP, 1.5), np.zeros(3), HEIGHT, 0.02).deviation
        assert stated == pytest.approx(np.hypot(0.02 * np.hypot(distance, 0.1), DEVIATION) / 1.5)


def test_no_feet_or_feet_above_the_camera_have_no_size():
    floor = np.append(UP, 1.5)
    assert floor_size(np.zeros((0, 3)), floor, np.zeros(3), HEIGHT, 0.01) is None
    assert floor_size(np.array([[0.0, -0.5, 3.0]]), floor, np.zeros(3), HEIGHT, 0.01) is None
    assert floor_size(ankles_of(1.0), np.append(UP, -0.1), np.zeros(3), HEIGHT, 0.01) is None


def tracked(tilt_deviation, seconds=2.5, **settings):
    """The tracker after a person of HEIGHT who stands 1.8 m below a camera that looks down by PITCH."""
    kinematics = body(height=HEIGHT)
    pose = kinematics.pose(motion(kinematics.skeleton, np.array([5.0])))
    ankles = [kinematics.skeleton.index(ankle) for ankle in ANKLES]
    shift = np.array([0.0, 1.8 - ANKLE_HEIGHT * HEIGHT - pose.positions[0, ankles, 1].max(), 0.5])
    points = (pose.landmarks[0] + shift) @ level_from_camera(0.0, PITCH)
    config = replace(CONFIG, height=0.0, camera_pitch=PITCH, camera_height=1.8, tilt_deviation=tilt_deviation)
    tracker, random = Tracker(replace(config, **settings)), np.random.default_rng(0)
    for index in range(round(seconds * RATE)):
        seen = project(points) + 2.0 / FOCAL * random.normal(size=(len(points), 2))
        tracker.track(Observation(index / RATE, seen, np.ones(len(points)), FOCAL))
    return tracker


def test_the_height_is_measured_on_request():
    estimator = tracked(0.003).learned.height
    assert estimator.measured and estimator.height == pytest.approx(HEIGHT, rel=0.03)
    assert 0 < estimator.floor_deviation < LARGEST_FLOOR_DEVIATION
    assert 0.035 < estimator.deviation / estimator.height < 0.06
    assert not tracked(0.0, seconds=1.0).learned.height.measured
    assert tracked(0.003, seconds=1.5, hold_feet=False).learned.height.measured  # as on a camera_mount_frame


@pytest.mark.parametrize(("height", "doubted"), [(HEIGHT, False), (1.95, True)])
def test_a_given_height_is_compared_with_the_floor(height, doubted):
    learned = tracked(0.003, height=height).learned
    assert (len(learned.doubts) == 1 and f"the height of {height:.2f} m" in learned.doubts[0]) == doubted
    if doubted:
        assert learned.size_check.ratio == pytest.approx(HEIGHT / height, rel=0.05)
        assert learned.size_deviation == pytest.approx(abs(np.log(HEIGHT / height)), abs=0.05)


def test_a_tilt_that_is_not_exact_enough_is_refused():
    estimator = tracked(0.05, seconds=1.0).learned.height
    assert not estimator.measured and estimator.floor_deviation > LARGEST_FLOOR_DEVIATION
