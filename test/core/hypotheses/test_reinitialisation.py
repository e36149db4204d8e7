"""Re-initialisation of a state with a high cost, without the network: when it is due, and what it corrects."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import FOCAL, RATE, TRACKED_WITHIN, WITHOUT_NETWORK, observations
from test_initialisation import TURNS, error, seen, turned

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.hypotheses.start import (
    HIGH_COST,
    HIGH_COST_S,
    LONGEST_INTERVAL,
    SHORTEST_INTERVAL,
    Reinitialisation,
)
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

LANDMARKS = 17
HIGH, LOW = 1.01 * HIGH_COST * LANDMARKS, 0.99 * HIGH_COST * LANDMARKS


def due_at(costs, step=0.01, measurements=LANDMARKS):
    """Stamps, s, of the frames in which a re-initialisation was due."""
    rule = Reinitialisation()
    return np.array([step * i for i, cost in enumerate(costs) if rule.due(step * i, cost, measurements)])


def test_reinitialisation_is_due_after_a_delay_that_grows():
    due = due_at([HIGH] * 2000)
    assert due[0] == pytest.approx(HIGH_COST_S, abs=0.011)
    doubled = SHORTEST_INTERVAL * 2.0 ** np.arange(len(due) - 1)
    assert np.diff(due) == pytest.approx(np.minimum(doubled, LONGEST_INTERVAL), abs=0.011)
    assert np.diff(due)[-1] == pytest.approx(LONGEST_INTERVAL, abs=0.011)


def test_measured_depths_are_counted():
    assert len(due_at([HIGH] * 100, measurements=LANDMARKS + 1)) == 0
    assert len(due_at([2 * HIGH] * 100, measurements=2 * LANDMARKS)) == len(due_at([HIGH] * 100)) > 0


def test_a_low_or_unknown_cost_begins_the_time_anew():
    assert len(due_at([HIGH] * 5 + [LOW] + [HIGH] * 5 + [float("nan")] + [HIGH] * 5)) == 0


def test_a_cost_near_the_limit_causes_no_more_attempts_than_one_above_it():
    always, hovering = due_at([HIGH] * 2000), due_at(([HIGH] * 9 + [LOW]) * 200)
    assert 5 < len(hovering) <= len(always)


def test_the_delay_is_short_again_after_a_long_time_of_low_cost():
    good = round(1.1 * LONGEST_INTERVAL / 0.01)
    due, begins = due_at([HIGH] * 500 + [LOW] * good + [HIGH] * 30), 0.01 * (500 + good)
    assert due[-2:] == pytest.approx([begins + HIGH_COST_S, begins + HIGH_COST_S + SHORTEST_INTERVAL], abs=0.011)


@pytest.mark.parametrize("orientation, frames", [(3, 3), (4, 8), (5, 3)])
def test_a_body_that_turned_over_in_a_gap_is_found_within_100_or_270_ms(orientation, frames):
    tracker = Tracker(WITHOUT_NETWORK)
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
    assert max(errors[20 + frames :]) < TRACKED_WITHIN
    assert 2 <= sum(found_anew) <= 3  # one of them at the start


def test_a_fit_that_is_not_far_better_changes_nothing(monkeypatch):
    plain, fitted = Tracker(WITHOUT_NETWORK), Tracker(WITHOUT_NETWORK)
    attempts, fit = [], fitted._starts.initialiser.fit
    monkeypatch.setattr(fitted._starts.initialiser, "fit", lambda frame: attempts.append(1) or fit(frame))
    for i, (_, observation) in enumerate(observations(plain, 1.0)):
        if i == 15:
            monkeypatch.setattr(fitted._starts.reinitialisation, "due", lambda *given: True)
            monkeypatch.setattr("lassokin_ros.core.hypotheses.start.COST_SHARE", 0.0)
        a, b = plain.track(observation), fitted.track(observation)
        assert np.allclose(a.state.rotations, b.state.rotations, rtol=0, atol=1e-9)
    assert len(attempts) == 3 + 15  # three verticals at first


def test_repeated_keypoints_do_not_cause_reinitialisation(monkeypatch):
    tracker, attempts = Tracker(WITHOUT_NETWORK), []
    for _, observation in observations(tracker, 0.5):
        tracker.track(observation)
    fit = tracker._starts.initialiser.fit
    monkeypatch.setattr(tracker._starts.initialiser, "fit", lambda *of: attempts.append(of) or fit(*of))
    monkeypatch.setattr(tracker._starts.reinitialisation, "due", lambda *given: True)
    repeated = tracker.track(replace(observation, stamp=observation.stamp + 1 / RATE))
    assert repeated.repeated > 0 and not attempts
    tracker.track(replace(observation, stamp=observation.stamp + 2 / RATE, points=observation.points + 1e-3))
    assert len(attempts) == 1
