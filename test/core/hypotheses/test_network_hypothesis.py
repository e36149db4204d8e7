"""The network's pose as a hypothesis: fitted if it differs from the tracked pose, a few iterations per frame."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lassokin_ros.core.hypotheses.network_hypothesis import FACTORS, distance

from benchmarks.data.motion import FPS, load_motion
from benchmarks.latency import Run
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import WEBCAM, detections, exact_pixels, motion


@pytest.fixture(scope="module")
def seen():
    """(hypothesis, arguments of its calls) while a person is tracked at 60 Hz."""
    run = Run(load_motion(Path("no such folder"), 30))
    hypothesis, calls = run.tracker._network_hypothesis, []
    original = hypothesis.better_state

    def better_state(stamp, frame, find_places, *others):
        places = find_places()
        calls.append((stamp, frame, lambda: places, *others))
        return original(*calls[-1])

    hypothesis.better_state = better_state
    for frame in range(30):
        run.step(frame)
    hypothesis.better_state = original
    assert len(calls) > 20
    return hypothesis, calls[-10:]


def elsewhere(pose):
    """A pose whose limbs are mirrored in depth."""
    positions = pose.positions.copy()
    positions[:, 2] = 2 * positions[0, 2] - positions[:, 2] + 0.3 * np.arange(len(positions)) / len(positions)
    return replace(pose, positions=positions)


def counted(hypothesis, monkeypatch):
    """The number of iterations of each call."""
    counts, original = [], hypothesis._initialiser.iterate

    def iterate(states, frame, factors):
        counts.append(len(factors))
        return original(states, frame, factors)

    monkeypatch.setattr(hypothesis._initialiser, "iterate", iterate)
    hypothesis.reset()
    return counts


def test_no_fit_begins_where_the_network_agrees(seen, monkeypatch):
    hypothesis, calls = seen
    counts = counted(hypothesis, monkeypatch)
    monkeypatch.setattr("lassokin_ros.core.hypotheses.network_hypothesis.SAME_POSE", 0.5)
    assert all(hypothesis.better_state(*arguments) is None for arguments in calls)
    assert counts == []


def test_the_iterations_are_spread_over_frames_and_the_fit_replaces_a_wrong_state(seen, monkeypatch):
    hypothesis, calls = seen
    counts = counted(hypothesis, monkeypatch)
    hypothesis._newest = calls[0][0] - 1 / FPS  # a person is already tracked
    found = []
    for stamp, frame, places, skeleton, tracked, _ in calls:
        found.append(hypothesis.better_state(stamp, frame, places, skeleton, elsewhere(tracked), 1e6))
        if found[-1] is not None:
            break
    assert counts == [1] * len(FACTORS) and len(found) == len(counts)
    fitted = hypothesis._initialiser.pose(found[-1])
    near, far = distance(places(), skeleton, fitted), distance(places(), skeleton, elsewhere(tracked))
    assert near < 0.12 < far, (near, far)


def test_a_fit_that_is_not_better_replaces_nothing(seen, monkeypatch):
    hypothesis, calls = seen
    counts = counted(hypothesis, monkeypatch)
    for stamp, frame, places, skeleton, tracked, _ in calls:
        assert hypothesis.better_state(stamp, frame, places, skeleton, elsewhere(tracked), -1e6) is None
    assert sum(counts) >= len(FACTORS)


def test_a_fit_from_before_a_gap_is_dropped(seen, monkeypatch):
    hypothesis, calls = seen
    counts = counted(hypothesis, monkeypatch)
    hypothesis._newest = calls[0][0] - 1 / FPS
    stamp, frame, places, skeleton, tracked, _ = calls[0]
    assert hypothesis.better_state(stamp, frame, places, skeleton, elsewhere(tracked), 1e6) is None
    assert hypothesis.better_state(stamp + 1.0, frame, places, skeleton, elsewhere(tracked), 1e6) is not None
    assert counts == [1, len(FACTORS)]  # the second fit starts again, and ends in the same frame


@pytest.mark.parametrize("seed", [0, 1])
def test_a_squat_is_not_replaced_by_the_lean_that_the_network_sees(seed):
    """The network's training data hardly has squats. The lean has its centre of mass 0.5 m from the feet."""
    tracker = Tracker()
    times = np.arange(0.0, 9.5, 1 / 30)
    states = motion(tracker.skeleton, times)
    points, confidence = detections(exact_pixels(tracker.kinematics, states), 30.0, seed=seed)
    errors = []
    for stamp, pixels, seen, truth in zip(times, points, confidence, tracker.kinematics.pose(states).positions):
        frame = Observation(stamp, WEBCAM.lens.normalise(pixels), seen, WEBCAM.lens.focal)
        positions = tracker.track(frame).pose.positions
        errors.append(np.linalg.norm((positions - positions[0]) - (truth - truth[0]), axis=1).mean())
    assert np.mean(errors[times.searchsorted(6.5) :]) < 0.08
