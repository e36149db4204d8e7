"""Body hypotheses: their start states, the penalty of their motion, and when one replaces the published state."""

import numpy as np
import pytest
from sequences import detected, observations

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.hypotheses import body_hypotheses as body_hypotheses
from lassokin_ros.core.hypotheses.initialisation import DAMPING, LARGEST_TURN
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import huber_weights
from lassokin_ros.core.tracker import Tracker

BACK = np.diag([-1.0, 1.0, -1.0])


class Wrong:
    """A tracker's body hypotheses beside a fixed published state, on one frame that is repeated."""

    def __init__(self, seed, wrong):
        tracker = Tracker(TrackerConfig(depth_prior=False))
        truth, observation = observations(tracker, seed=seed)[10 * seed]
        self.points, self.weights = observation.points, np.full(len(observation.points), 500.0)
        self.right = tracker._initialiser.fit(FrameData(self.points, self.weights)).best
        self.kinematics, self.pool, self.live = tracker.kinematics, tracker._body_hypotheses, tracker._rows.live
        self.pool.start(wrong(self.right), FrameData(self.points, self.weights))

    def distance(self, state):
        """Mean distance of the joints from the true ones, pelvis on pelvis, m."""
        places, right = (self.kinematics.pose(s).positions for s in (state, self.right))
        return np.linalg.norm((places - places[0]) - (right - right[0]), axis=-1).mean()

    def winner(self, frames, alpha=1e-3):
        """(number of frames until one was selected, the selected state); None if none was."""
        for frame in range(frames):
            self.pool.linearise(FrameData(self.points, self.weights))
            self.pool.advance(np.zeros(72), np.zeros(3), np.full(len(self.live), alpha))
            self.pool.compute_costs(FrameData(self.points, self.weights))
            state = self.pool.select(FrameData(self.points, self.weights), np.full(len(self.live), alpha))
            if state is not None:
                return frame, state
        return frames, None


def turned_round(state):
    rotations = state.rotations.copy()
    rotations[0] = rotations[0] @ BACK
    return BodyState(rotations, state.translation)


@pytest.mark.parametrize("seed", range(1, 5))
def test_the_first_hypothesis_corrects_a_body_that_faces_the_wrong_way(seed):
    scene = Wrong(seed, turned_round)
    assert scene.distance(scene.pool.published.state) > 0.15
    frame, winner = scene.winner(body_hypotheses.LARGEST_AGE)
    assert frame < body_hypotheses.MATURE_FROM + 5 and scene.distance(winner) < 0.06


def test_every_second_start_mirrors_both_legs_in_each_variant(monkeypatch):
    scene = Wrong(1, lambda state: state)
    begun = []
    mirroring = scene.pool._initialiser.mirroring
    both = mirroring.both
    monkeypatch.setattr(mirroring, "both", lambda state, pair, pose: begun.append(pair) or both(state, pair, pose))
    assert scene.winner(400)[1] is None
    assert set(begun) == set(mirroring.pairs)
    assert len(begun) >= scene.pool._renewals // 2


def test_a_converged_hypothesis_is_damped_like_the_published_state(monkeypatch):
    scene = Wrong(1, lambda state: state)
    initialiser, ridges = scene.pool._initialiser, []
    step = initialiser.step
    monkeypatch.setattr(initialiser, "step", lambda rows, ridge: ridges.append(ridge.copy()) or step(rows, ridge))
    scene.winner(body_hypotheses.MATURE_FROM, alpha=4.0)
    assert not any(ridge.any() for ridge in ridges[: body_hypotheses.STEADY_FROM])
    assert all((ridge == 8.0).all() for ridge in ridges[body_hypotheses.STEADY_FROM :])  # 1 / variance = alpha^2 / 2
    assert len(ridges) > body_hypotheses.STEADY_FROM


def test_the_ridge_of_a_step_is_added_to_the_angles_diagonal():
    tracker, frames = detected(0.5)
    for observation in frames:
        estimate = tracker.track(observation)
    rows, state = tracker._rows, estimate.solved
    points, weights = np.nan_to_num(observation.points), 300.0 * observation.confidence
    about = rows.evaluate(BodyState(state.rotations[None], state.translation[None]))
    linearised = rows.linearise(about, FrameData(points, weights), huber_weights)
    ridge = np.random.default_rng(0).uniform(1.0, 1e3, size=(1, len(rows.live)))
    omega, x = tracker._initialiser.step(linearised, ridge)
    J, step = linearised.columns[0], np.append(omega[0, rows.live], x[0])
    held = np.append(ridge[0] + DAMPING, np.full(3, 1e-6)) * step
    assert np.abs(omega).max() < LARGEST_TURN
    assert np.allclose(J @ (J.T @ step) + held, J @ linearised.z[0], rtol=1e-9, atol=1e-6)
