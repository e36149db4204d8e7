"""The person's height, measured; and the check of a given one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import body, random_state
from sequences import CONFIG, FOCAL, RATE, observations

from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.core.config import TYPICAL_HEIGHT
from lassokin_ros.core.evidence.feet import ANKLE_HEIGHT, FLOOR_DEVIATION
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.height import (
    ASSUMED_DEVIATION,
    CHANGE,
    CORRELATED_S,
    FEWEST_DEPTHS,
    FEWEST_FRAMES,
    FRAME_DEVIATION,
    LARGEST_FLOOR_DEVIATION,
    LEAST_DEVIATION,
    PAUSE_S,
    PEOPLE_DEVIATION,
    RANGE,
    TIME_CONSTANT_S,
    HeightEstimator,
    SizeCheck,
    fit_scale,
    floor_size,
)
from lassokin_ros.core.learned.vertical import level_from_camera
from lassokin_ros.core.observation import HERE, Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

KINEMATICS = body(height=TYPICAL_HEIGHT)
NOISE = 0.03


def person(ratio=1.0, stamp=0.0, seed=0, noise=0.0, measured=17, visible=17, repeated=0.0):
    """(measurement of a person who is taller by a ratio than the tracked body, that body's solved state).

    Both have the same image. measured, visible: number of landmarks with a depth, and in the image.
    """
    random = np.random.default_rng(seed)
    state = random_state(random, KINEMATICS, 0.3)
    pose = KINEMATICS.pose(state)
    points, seen = project(pose.landmarks), np.arange(17) < visible
    depth = ratio * pose.landmarks[:, 2] + noise * random.normal(size=17)
    weights = np.where(np.arange(17) < measured, 1 / NOISE, 0.0)
    image = np.where(seen, 500.0, 0.0)
    measurement = Measurement(stamp, points, seen, 1e3, points, image, 0.0, repeated, 0.03, 0.03, False, depth, weights)
    return measurement, SimpleNamespace(state=state, pose=pose)


def scale_of(measurement, solved):
    root = solved.state.translation
    return fit_scale(measurement, solved.pose.landmarks - root, root)


def information(measurement, solved):
    return 1 / (FRAME_DEVIATION**2 + scale_of(measurement, solved)[1] ** 2)


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.25])
def test_the_scale_of_one_frame_is_that_of_the_depths(ratio):
    assert scale_of(*person(ratio))[0] == pytest.approx(ratio, rel=1e-6)
    hidden, _ = person(ratio, visible=12, measured=9), None
    assert scale_of(*hidden)[0] == pytest.approx(ratio, rel=1e-6)


def test_the_scales_deviation_is_that_of_noisy_keypoints_and_depths():
    errors, random = [], np.random.default_rng(1)
    for seed in range(300):
        measurement, solved = person(1.1, seed=seed, noise=NOISE)
        measurement.points += 0.002 * random.normal(size=(17, 2))
        scale, deviation = scale_of(measurement, solved)
        errors.append((scale - 1.1) / deviation)
    errors = np.array(errors)
    assert abs(errors.mean()) < 0.25 and 0.7 < errors.std() < 1.5


def test_depths_on_an_occluder_or_the_wall_hardly_change_the_scale():
    for shift in (-0.6, 2.0):
        measurement, solved = person(1.1)
        measurement.depth[[3, 9]] += shift
        assert scale_of(measurement, solved)[0] == pytest.approx(1.1, rel=0.01)


def test_before_any_depth_the_height_is_that_of_people():
    estimator = HeightEstimator()
    assert not estimator.measured and estimator.height == TYPICAL_HEIGHT
    assert estimator.deviation == pytest.approx(TYPICAL_HEIGHT * ASSUMED_DEVIATION)
    assert TYPICAL_HEIGHT * np.exp(-2 * ASSUMED_DEVIATION) < 1.06  # children of four years
    assert not estimator.update(*person(1.2, measured=0), HERE, TYPICAL_HEIGHT) and not estimator.measured


def test_one_frame_is_averaged_with_the_prior_of_people():
    estimator, given = HeightEstimator(), person(1.2)
    assert estimator.update(*given, HERE, TYPICAL_HEIGHT) and estimator.measured
    weight, prior = information(*given), PEOPLE_DEVIATION**-2
    expected = TYPICAL_HEIGHT * 1.2 ** (weight / (weight + prior))
    assert estimator.height == pytest.approx(expected, rel=1e-6)
    expected_deviation = np.hypot(LEAST_DEVIATION, (weight + prior) ** -0.5)
    assert estimator.deviation == pytest.approx(estimator.height * expected_deviation)


def test_the_height_is_the_skeletons_times_the_scale():
    """Whatever the height of the skeleton in use."""
    for in_use in (1.5, 1.9):
        estimator = HeightEstimator()
        for number in range(60):
            estimator.update(*person(1.6 / in_use, 0.2 * number, number), HERE, in_use)
        assert estimator.height == pytest.approx(1.6, rel=0.01)


def test_frames_close_in_time_count_in_proportion_to_their_distance():
    step, estimator = 0.25 * CORRELATED_S, HeightEstimator()
    given = person(1.2)
    estimator.update(*given, HERE, TYPICAL_HEIGHT)
    estimator.update(*person(1.2, step), HERE, TYPICAL_HEIGHT)
    once = information(*given)
    assert estimator._information == pytest.approx(once * (np.exp(-step / TIME_CONSTANT_S) + 0.25))
    estimator.update(*person(1.2, step + 4 * CORRELATED_S), HERE, TYPICAL_HEIGHT)
    fade = np.exp(-4 * CORRELATED_S / TIME_CONSTANT_S)
    assert estimator._information == pytest.approx(once * (fade * (np.exp(-step / TIME_CONSTANT_S) + 0.25) + 1))


def test_older_frames_fade_with_the_time_constant():
    """A wrong scale of the first frame has the weight exp(-t / TIME_CONSTANT_S) after t."""
    estimator, first, second = HeightEstimator(), person(1.3), person(1.0, TIME_CONSTANT_S, 1)
    estimator.update(*first, HERE, TYPICAL_HEIGHT)
    estimator.update(*second, HERE, TYPICAL_HEIGHT)
    before, after, prior = information(*first) / np.e, information(*second), PEOPLE_DEVIATION**-2
    expected = before * np.log(1.3) / (before + after + prior)
    assert np.log(estimator.height / TYPICAL_HEIGHT) == pytest.approx(expected, rel=1e-5)


def test_the_height_becomes_more_certain_up_to_the_spread_of_proportions():
    estimator, deviations = HeightEstimator(), []
    for number in range(100):
        estimator.update(*person(1.0, 0.2 * number, number), HERE, TYPICAL_HEIGHT)
        deviations.append(estimator.deviation / estimator.height)
    assert np.all(np.diff(deviations) < 1e-9) and LEAST_DEVIATION < deviations[-1] < 1.1 * LEAST_DEVIATION


@pytest.mark.parametrize("case", [{"measured": FEWEST_DEPTHS - 1}, {"repeated": 0.1}])
def test_frames_without_enough_new_depths_are_not_used(case):
    estimator = HeightEstimator()
    assert not estimator.update(*person(1.2, **case), HERE, TYPICAL_HEIGHT) and not estimator.measured
    estimator.update(*person(1.2, measured=FEWEST_DEPTHS), HERE, TYPICAL_HEIGHT)
    assert estimator.measured


@pytest.mark.parametrize("height", [0.98 * RANGE[0], 1.02 * RANGE[1]])
def test_a_scale_outside_the_range_of_heights_is_ignored(height):
    estimator = HeightEstimator()
    assert not estimator.update(*person(height / TYPICAL_HEIGHT), HERE, TYPICAL_HEIGHT) and not estimator.measured


def test_a_new_height_is_adopted_if_it_differs_and_not_too_often():
    estimator = HeightEstimator()
    assert estimator.update(*person(1.2), HERE, TYPICAL_HEIGHT)
    assert not estimator.update(*person(1.2, 0.9 * PAUSE_S), HERE, TYPICAL_HEIGHT)
    assert estimator.update(*person(1.2, 1.1 * PAUSE_S), HERE, TYPICAL_HEIGHT)
    in_use = estimator.height * np.exp(0.9 * CHANGE)
    ratio = estimator.height / in_use
    assert not estimator.update(*person(ratio, 3 * PAUSE_S), HERE, in_use)


def test_with_several_cameras_the_sum_of_the_lengths_is_the_size():
    """Short forearms and long shanks: the median of these five would be 7 % off."""
    given = np.array([0.25, 0.45, 0.42, 0.42, 0.5])
    measured = 1.15 * given * [0.8, 1.07, 1.08, 1.08, 0.92]
    estimator = HeightEstimator()
    for number in range(50):
        seen, solved = person(1.0, 0.1 * number, measured=0)
        estimator.update(seen, solved, HERE, TYPICAL_HEIGHT, (measured, given))
    assert estimator.height == pytest.approx(1.15 * TYPICAL_HEIGHT, rel=0.02)


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
    assert found.deviation == pytest.approx(FLOOR_DEVIATION / 1.5)


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
        assert stated == pytest.approx(np.hypot(0.02 * np.hypot(distance, 0.1), FLOOR_DEVIATION) / 1.5)


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
    assert not tracked(0.003, seconds=1.0, hold_feet=False).learned.height.measured


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


def with_depth(given, true, seconds=4.0):
    """A tracker with a given height, after seconds of a person of the true height with measured depth."""
    body, tracker = Tracker(replace(CONFIG, height=true)), Tracker(replace(CONFIG, height=given))
    noise = np.random.default_rng(1)
    for _, observation in observations(body, seconds):
        landmarks = body.kinematics.pose(motion(body.skeleton, np.array([observation.stamp]))).landmarks[0]
        depth = landmarks[:, 2] + 0.02 * noise.normal(size=len(landmarks))
        assert tracker.track(replace(observation, depth=depth)).accepted
    return tracker


@pytest.mark.parametrize("given, true, wrong", [(1.75, 1.75, False), (1.9, 1.6, True), (1.6, 1.9, True)])
def test_a_wrong_height_is_found_and_the_right_one_is_not_doubted(given, true, wrong):
    check = with_depth(given, true).learned.size_check
    assert check.wrong is wrong and check.ratio == pytest.approx(true / given, rel=0.04)


def test_there_is_no_result_before_enough_frames_or_after_a_reset():
    tracker = with_depth(1.9, 1.6, 1.0)
    assert len(tracker.learned.size_check._ratios) < FEWEST_FRAMES
    assert tracker.learned.size_check.ratio == 1.0 and not tracker.learned.size_check.wrong
    tracker = with_depth(1.9, 1.6)
    tracker.reset()
    assert not tracker.learned.size_check.wrong


@pytest.mark.parametrize("visible", [slice(None), slice(0, 11)], ids=["body", "upper body"])
def test_depths_on_occluders_cause_no_doubt(visible):
    """Of each frame's depths, 15 % are 0.2 to 1 m too near."""
    tracker, random = Tracker(CONFIG), np.random.default_rng(2)
    for _, observation in observations(tracker, 5.0):
        landmarks = tracker.kinematics.pose(motion(tracker.skeleton, np.array([observation.stamp]))).landmarks[0]
        depth = landmarks[:, 2] + 0.03 * random.normal(size=17)
        depth -= (random.random(17) < 0.15) * random.uniform(0.2, 1.0, 17)
        confidence = np.zeros(17)
        confidence[visible] = 1.0
        tracker.track(replace(observation, depth=depth, confidence=confidence))
    assert len(tracker.learned.size_check._ratios) >= FEWEST_FRAMES and not tracker.learned.size_check.wrong


def test_lengths_are_those_of_limbs_and_trunk_without_implausible_ones():
    tracker = Tracker(CONFIG)
    check, names = tracker.learned.size_check, tracker.layout.names
    places = tracker.kinematics.pose(motion(tracker.skeleton, np.zeros(1))).landmarks[0]
    usable = np.ones(len(names), dtype=bool)
    measured, given = check.lengths(1.1 * places, usable)
    assert len(measured) == check.limb_count(usable) + 2  # both sides of the trunk
    assert measured.sum() == pytest.approx(1.1 * given.sum(), rel=0.01)
    places[names.index("left_wrist")] += 1.0
    usable[names.index("right_shoulder")] = False
    assert len(check.lengths(places, usable)[0]) == len(measured) - 3  # a forearm, an upper arm and a side
    check.use(tracker.skeleton.scaled(0.8))
    assert check.lengths(places, np.ones(len(names), dtype=bool))[1].max() == pytest.approx(0.8 * given.max())


def test_ratios_of_other_sources_count_once_in_a_tenth_of_a_second():
    check = SizeCheck(body())
    for number in range(40):
        check.add(0.05 * number, np.array([0.7]))
    assert len(check._ratios) == 20 and check.wrong and check.ratio == pytest.approx(0.7)
