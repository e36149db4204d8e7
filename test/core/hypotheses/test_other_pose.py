"""Another pose beside the tracked one: fitted a few iterations per frame, and used if it explains the frame better."""

import numpy as np
import pytest
from sequences import CONFIG, observations

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.hypotheses.initialisation import NEAR
from lassokin_ros.core.hypotheses.other_pose import (
    BALANCE_MARGIN,
    COST_MARGIN,
    DIFFERENT_POSE,
    PERIOD_S,
    OtherPose,
)
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import WEBCAM, detections, exact_pixels, motion


class Scene:
    """A frame of a tracked person, the tracked state with other limbs, and counts of iterations."""

    def __init__(self, monkeypatch):
        self.tracker = Tracker(CONFIG)
        frames = []
        start = self.tracker._starts.start
        monkeypatch.setattr(self.tracker._starts, "start", lambda *given: frames.append(given[-1]) or start(*given))
        for _, observation in observations(self.tracker, 1.0):
            self.tracker.track(observation)
        self.frame, self.model, self.right = frames[-1], self.tracker.frame_model, self.tracker._solved
        omega = np.zeros((24, 3))
        for name in ("left_hip", "right_shoulder", "left_shoulder"):
            omega[self.tracker.skeleton.index(name), 0] = 0.8
        self.wrong = self.model.evaluate(self.right.state.retract(omega.reshape(-1), np.zeros(3)))
        self.counts, self.proposals = [], 0
        iterate = self.tracker._starts.initialiser.iterate
        monkeypatch.setattr(
            self.tracker._starts.initialiser,
            "iterate",
            lambda states, frame, factors: self.counts.append(len(factors)) or iterate(states, frame, factors),
        )

    def other_pose(self, nothing=False):
        def propose(tracked, frame, turn):
            self.proposals += 1
            return None if nothing else BodyState(self.right.state.rotations[None], np.zeros((1, 3)))

        return OtherPose(self.tracker._starts.initialiser, self.model, propose)

    def found(self, other, tracked, cost, step=1 / 60, frames=12):
        """The answers for the same frame at a rate, up to the first state."""
        answers = []
        for number in range(frames):
            answers.append(other.better_state(number * step, self.frame, tracked, cost))
            if answers[-1] is not None:
                break
        return answers


@pytest.fixture
def scene(monkeypatch):
    return Scene(monkeypatch)


def tracked_since(other, step=1 / 60):
    """As if a person was tracked before."""
    other._newest = -step
    return other


@pytest.mark.parametrize("rate, expected", [(60, [1] * 8), (30, [2] * 4), (15, [5, 3]), (5, [8])])
def test_the_iterations_are_spread_over_frames_and_the_fit_replaces_a_wrong_state(scene, rate, expected):
    other, step = scene.other_pose(), 1 / rate
    answers = scene.found(tracked_since(other, step), scene.wrong, 1e6, step)
    sizes = [min(count, len(NEAR) - sum(expected[:i])) for i, count in enumerate(expected)]
    assert scene.counts == sizes and len(answers) == len(sizes) and sum(scene.counts) == len(NEAR)
    fitted = scene.model.evaluate(answers[-1]).pose.positions
    right, wrong = scene.right.pose.positions, scene.wrong.pose.positions
    apart = [np.linalg.norm((p - p[0]) - (right - right[0]), axis=1).mean() for p in (fitted, wrong)]
    assert apart[0] < 0.03 < DIFFERENT_POSE < apart[1]


def test_no_fit_begins_without_another_pose(scene):
    answers = scene.found(scene.other_pose(nothing=True), scene.wrong, 1e6, frames=30)
    assert not any(answers) and scene.counts == [] and 4 <= scene.proposals <= 1 + 0.5 / PERIOD_S


def test_a_fit_that_is_not_better_by_the_margin_replaces_nothing(scene):
    fitted = scene.found(scene.other_pose(), scene.wrong, 1e6)[-1]
    cost = float(scene.model.cost(scene.model.evaluate(fitted), scene.frame))
    for margin, used in ((0.99, False), (1.01, True), (np.nan, False)):
        answers = scene.found(scene.other_pose(), scene.wrong, cost + margin * COST_MARGIN)
        assert any(answer is not None for answer in answers) == used


def test_a_fit_that_is_the_tracked_pose_replaces_nothing(scene):
    fitted = scene.found(scene.other_pose(), scene.wrong, 1e6)[-1]
    answers = scene.found(scene.other_pose(), scene.model.evaluate(fitted), 1e6)
    assert not any(answers) and sum(scene.counts) > 2 * len(NEAR)


def test_a_fit_that_is_far_less_balanced_replaces_nothing(scene, monkeypatch):
    fitted = BodyState(scene.right.state.rotations[None], scene.right.state.translation[None])
    tracked = scene.wrong.pose.positions
    for margin, used in ((1.01, False), (0.99, True)):

        def offset(positions, up, fits=0.25 + margin * BALANCE_MARGIN):
            size = 0.25 if positions is tracked else fits
            return np.broadcast_to([size, 0.0, 0.0], (*positions.shape[:-2], 3))

        monkeypatch.setattr(scene.model.balance, "offset", offset)
        found = scene.other_pose()._accepted(fitted, scene.frame, scene.wrong, 1e6)
        assert (found is not None) == used


def test_a_fit_from_before_a_gap_is_dropped(scene):
    other = tracked_since(scene.other_pose())
    assert other.better_state(0.0, scene.frame, scene.wrong, 1e6) is None
    assert other.better_state(1.0, scene.frame, scene.wrong, 1e6) is not None
    assert scene.counts == [1, len(NEAR)] and scene.proposals == 2  # begun again, and ended in the same frame
    other.reset()
    assert other._fitted is None and other._begun_at == -np.inf


def test_the_tracked_state_returns_to_the_networks_pose():
    """The tracked state is replaced by one that is turned round; within 0.5 s the right one is back."""
    tracker = Tracker(CONFIG)
    frames = observations(tracker, 2.0)
    for _, observation in frames[:30]:
        tracker.track(observation)
    state = tracker._solved.state
    rotations = state.rotations.copy()
    for name in ("left_hip", "left_shoulder", "right_shoulder"):
        rotations[tracker.skeleton.index(name)] = np.diag([1.0, -1.0, -1.0]) @ rotations[tracker.skeleton.index(name)]
    tracker._solved = tracker.frame_model.evaluate(BodyState(rotations, state.translation))
    spoiled = tracker._starts.network_pose.distance(tracker._solved.pose)
    for truth, observation in frames[30:45]:
        tracker.track(observation)
    own = tracker._solved.pose.positions
    assert np.linalg.norm((own - own[0]) - (truth - truth[0]), axis=1).mean() < 0.1 < spoiled


def test_a_squat_is_not_replaced_by_the_lean_that_the_network_sees(seed=0):
    """The network's training data hardly has squats. The lean has its centre of mass 0.5 m from the feet."""
    tracker = Tracker(TrackerConfig(height=1.75))
    times = np.arange(0.0, 9.5, 1 / 30)
    states = motion(tracker.skeleton, times)
    points, confidence = detections(exact_pixels(tracker.kinematics, states), 30.0, seed=seed)
    errors = []
    for stamp, pixels, seen, truth in zip(times, points, confidence, tracker.kinematics.pose(states).positions):
        frame = Observation(stamp, WEBCAM.lens.normalise(pixels), seen, WEBCAM.lens.focal)
        positions = tracker.track(frame).pose.positions
        errors.append(np.linalg.norm((positions - positions[0]) - (truth - truth[0]), axis=1).mean())
    assert np.mean(errors[times.searchsorted(6.5) :]) < 0.08
