"""How likely a pose is wrong: a probability that grows with the cost, and follows keypoints that fit no person."""

from dataclasses import replace

import numpy as np
from sequences import CONFIG, observations

from benchmarks.accuracy_run.failure_probability import area
from lassokin_ros.core.output.failure_probability import HALF, failure_probability
from lassokin_ros.core.tracker import Tracker


def test_a_probability_that_grows_with_the_cost():
    values = [failure_probability(cost) for cost in (0.0, 1.0, 10.0, 30.0, HALF, 1000.0, 1e12)]
    assert values == sorted(values) and values[0] >= 0 and values[-1] <= 1 and failure_probability(HALF) == 0.5
    assert np.isnan(failure_probability(float("nan")))


def test_what_is_cheap_because_keypoints_are_trusted_less_is_no_less_doubtful():
    least, more, most = (failure_probability(20.0, excess=excess) for excess in (1.0, 2.0, 10.0))
    assert least < more < most < 1


def test_a_person_is_less_doubtful_than_shuffled_keypoints():
    tracker, shuffled = Tracker(CONFIG), Tracker(CONFIG)
    order = np.random.default_rng(0).permutation(17)
    good, bad = [], []
    for _, observation in observations(tracker, 1.0):
        good.append(tracker.track(observation).failure_probability)
        bad.append(shuffled.track(replace(observation, points=observation.points[order])).failure_probability)
    assert np.median(good) < 0.1 and np.nanmedian(bad) > 0.5


def test_only_an_initialised_frame_has_a_confidence():
    tracker = Tracker(CONFIG)
    estimates = [tracker.track(observation) for _, observation in observations(tracker, 0.2)]
    assert 0.5 <= estimates[0].confidence <= 1 and all(np.isnan(e.confidence) for e in estimates[1:])


def test_area_under_the_curve():
    score, positive = np.array([1.0, 2.0, 3.0, 4.0]), np.array([False, False, True, True])
    assert area(score, positive) == 1 and area(-score, positive) == 0 and area(0 * score, positive) == 0.5
    assert area(np.array([1.0, 3.0, 2.0, 4.0]), positive) == 0.75
