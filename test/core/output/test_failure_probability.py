"""Failure probability: it grows with the deviation, and for keypoints that fit no person."""

from dataclasses import replace

import numpy as np
from sequences import CONFIG, observations

from benchmarks.accuracy_run.failure_probability import area
from lassokin_ros.core.output.failure_probability import failure_probability
from lassokin_ros.core.tracker import Tracker


def test_the_probability_grows_with_deviation_and_learned_error():
    values = [failure_probability(deviation, 3.0, 1.5) for deviation in (0.0, 0.03, 0.06, 0.12, 0.35, 1.0, 1e6)]
    assert values == sorted(values) and values[0] >= 0 and values[1] < 0.02 and 0.9 < values[4] < values[-1] <= 1
    assert np.isnan(failure_probability(float("nan"), 1.0, 1.0))
    for figures in ([(0.08, ratio, 1.5) for ratio in (1, 2, 8)], [(0.08, 3.0, cost) for cost in (0, 1.0, 30.0)]):
        least, more, most = (failure_probability(*f) for f in figures)
        assert 0 < least < more < most < 1


def test_a_person_has_a_lower_probability_than_shuffled_keypoints():
    tracker, shuffled = Tracker(CONFIG), Tracker(CONFIG)
    order = np.random.default_rng(0).permutation(17)
    good, bad = [], []

    def stated(tracker, observation):
        return tracker.uncertainty(tracker.track(observation)).failure_probability

    for _, observation in observations(tracker, 1.0):
        good.append(stated(tracker, observation))
        bad.append(stated(shuffled, replace(observation, points=observation.points[order])))
    assert np.median(good) < 0.1 and np.nanmedian(bad) > 0.5


def test_the_area_under_the_curve_ranks_wrong_poses():
    score, positive = np.array([1.0, 2.0, 3.0, 4.0]), np.array([False, False, True, True])
    assert area(score, positive) == 1 and area(-score, positive) == 0 and area(0 * score, positive) == 0.5
    assert area(np.array([1.0, 3.0, 2.0, 4.0]), positive) == 0.75
