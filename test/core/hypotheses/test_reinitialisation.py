"""Re-initialisation of a state with a high cost: when it is due, and what it corrects."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, FOCAL, RATE, TRACKED_WITHIN, observations
from test_start_orientations import TURNS, error, seen, turned

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.hypotheses.reinitialisation import (
    HIGH_COST,
    HIGH_COST_DURATION,
    LONGEST_INTERVAL,
    SHORTEST_INTERVAL,
    Reinitialisation,
)
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

LANDMARKS = 17
DEAR, CHEAP = 1.01 * HIGH_COST * LANDMARKS, 0.99 * HIGH_COST * LANDMARKS


def looks(costs, step=0.01, depths=0):
    """Stamps, s, of the frames in which a re-initialisation was due."""
    reinitialisation = Reinitialisation(LANDMARKS)
    return np.array([step * i for i, cost in enumerate(costs) if reinitialisation.due(step * i, cost, depths)])


def test_reinitialisation_is_due_after_a_delay_that_grows():
    due = looks([DEAR] * 2000)
    assert due[0] == pytest.approx(HIGH_COST_DURATION, abs=0.011)
    between = np.diff(due)
    doubled = SHORTEST_INTERVAL * 2.0 ** np.arange(len(between))
    assert between == pytest.approx(np.minimum(doubled, LONGEST_INTERVAL), abs=0.011)
    assert between[-1] == pytest.approx(LONGEST_INTERVAL, abs=0.011)


def test_measured_depths_are_counted():
    """Their rows are part of the cost. With the limit of the keypoints alone, 1 frame in 75 initialised again."""
    assert len(looks([DEAR] * 100, depths=1)) == 0
    assert len(looks([2 * DEAR] * 100, depths=LANDMARKS)) == len(looks([DEAR] * 100)) > 0


def test_one_frame_of_low_cost_does_not_reset_the_delay():
    assert len(looks([DEAR] * 5 + [CHEAP] + [DEAR] * 5 + [float("nan")] + [DEAR] * 5)) == 0


def test_a_cost_near_the_limit_causes_no_more_attempts_than_one_above_it():
    always, hovering = looks([DEAR] * 2000), looks(([DEAR] * 9 + [CHEAP]) * 200)
    assert 5 < len(hovering) <= len(always)


def test_the_delay_is_short_again_after_a_long_time_of_low_cost():
    good = round(1.1 * LONGEST_INTERVAL / 0.01)
    due = looks([DEAR] * 500 + [CHEAP] * good + [DEAR] * 30)
    begins = 0.01 * (500 + good)
    assert due[-2:] == pytest.approx(
        [begins + HIGH_COST_DURATION, begins + HIGH_COST_DURATION + SHORTEST_INTERVAL], abs=0.011
    )


@pytest.mark.parametrize("orientation", [3, 4, 5])
def test_a_body_that_turned_over_in_a_gap_is_found_within_100_ms(orientation):
    tracker = Tracker(CONFIG)
    whole = motion(tracker.skeleton, np.arange(60) / RATE)
    errors, found_anew = [], []
    for i in range(60):
        over = i >= 20  # 0.6 s later
        state = turned(BodyState(whole.rotations[i], whole.translation[i]), TURNS[orientation if over else 0])
        points = seen(tracker.kinematics, state, i)
        estimate = tracker.track(Observation(i / RATE + 0.6 * over, points, np.ones(len(points)), FOCAL))
        errors.append(error(tracker.kinematics, estimate.state, state) if estimate.accepted else np.inf)
        found_anew.append(estimate.initialised)
    assert max(errors[:20]) < TRACKED_WITHIN < max(errors[20:23])
    assert max(errors[23:]) < TRACKED_WITHIN
    assert sum(found_anew) == 2  # at the start, and once again


def test_no_reinitialisation_while_tracking_is_good(monkeypatch):
    tracker, looked = Tracker(CONFIG), []
    fit = tracker._initialiser.fit
    monkeypatch.setattr(tracker._initialiser, "fit", lambda *of: looked.append(of) or fit(*of))
    for _, observation in observations(tracker, 4.0):
        tracker.track(observation)
    assert len(looked) == 1
    # A pose that cannot be explained causes attempts, at growing intervals.
    shuffled = np.random.default_rng(0).permutation(LANDMARKS)
    frames = observations(tracker, 3.0, start=4.0)
    for _, observation in frames:
        tracker.track(replace(observation, points=observation.points[shuffled]))
    assert 2 <= len(looked) <= 7


def test_repeated_keypoints_do_not_cause_reinitialisation(monkeypatch):
    tracker, looked = Tracker(CONFIG), []
    for _, observation in observations(tracker, 0.5):
        tracker.track(observation)
    fit = tracker._initialiser.fit
    monkeypatch.setattr(tracker._initialiser, "fit", lambda *of: looked.append(of) or fit(*of))
    monkeypatch.setattr(tracker._reinitialisation, "due", lambda stamp, cost, depths: True)
    repeated = tracker.track(replace(observation, stamp=observation.stamp + 1 / RATE))
    assert repeated.repeated > 0 and not looked
    tracker.track(replace(observation, stamp=observation.stamp + 2 / RATE, points=observation.points + 1e-3))
    assert len(looked) == 1


def test_a_rejected_reinitialisation_changes_nothing(monkeypatch):
    """Not even which way is up, which each look tries anew."""
    plain, looking = Tracker(CONFIG), Tracker(CONFIG)
    fit = looking._initialiser.fit

    def look(frame):
        found = fit(frame)
        looking._upright.vertical = np.array([1.0, 0.0, 0.0])  # as of somebody who lies
        return found

    for i, (_, observation) in enumerate(observations(plain, 1.0)):
        if i == 15:
            monkeypatch.setattr(looking._initialiser, "fit", look)
            monkeypatch.setattr(looking._reinitialisation, "due", lambda stamp, cost, depths: True)
            monkeypatch.setattr("lassokin_ros.core.tracker.reinitialisation_replaces", lambda tracked, found: False)
        a, b = plain.track(observation), looking.track(observation)
        assert np.array_equal(a.state.rotations, b.state.rotations)
