"""Other poses beside the tracked one: by the network, and limbs mirrored in depth."""

import numpy as np
import pytest
from cases import body, one_view, random_body, random_state
from sequences import CONFIG, WITHOUT_NETWORK, observations

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.roles import LIMBS
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.initialisation import NEAR
from lassokin_ros.core.hypotheses.start import (
    BALANCE_MARGIN,
    BONES,
    COST_MARGIN,
    DIFFERENT_POSE,
    FIT_EVERY_S,
    MirroredLimbs,
    OtherPose,
)
from lassokin_ros.core.observation import HERE, CameraPose, Observation
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
    assert not any(answers) and scene.counts == [] and 4 <= scene.proposals <= 1 + 0.5 / FIT_EVERY_S


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


CASES = [(limb, turn) for limb in range(len(LIMBS)) for turn in range(len(BONES))]


def evaluated(kinematics, state):
    return FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton)).evaluate(state)


def seen_from(camera):
    return one_view(np.zeros((17, 2)), np.zeros(17), camera=camera)


def mirrored(kinematics, tracked, turn, camera=HERE):
    """The states of the turn-th proposal, one per limb."""
    return MirroredLimbs(kinematics).propose(tracked, seen_from(camera), turn)


@pytest.mark.parametrize("limb, turn", CASES)
def test_each_mirrored_bone_changes_its_sign_along_the_line_of_sight(limb, turn):
    kinematics = body()
    before = random_state(np.random.default_rng([limb, turn]), kinematics)
    tracked = evaluated(kinematics, before)
    states = mirrored(kinematics, tracked, turn)
    assert states.rotations.shape == (len(LIMBS), 24, 3, 3)
    assert np.array_equal(states.translation, np.tile(before.translation, (len(LIMBS), 1)))
    after = BodyState(states.rotations[limb], states.translation[limb])
    chain = [kinematics.skeleton.index(joint) for joint in LIMBS[limb]]
    old, new = tracked.pose.positions, kinematics.pose(after).positions
    sight = old[chain[0]] / np.linalg.norm(old[chain[0]])
    across = np.eye(3) - np.outer(sight, sight)  # what the image shows, in weak perspective
    for joint, child, is_mirrored in zip(chain, chain[1:], BONES[turn]):
        was, is_now = old[child] - old[joint], new[child] - new[joint]
        assert abs(was @ sight) > 1e-3  # else a bone that stays would pass
        assert np.linalg.norm(is_now) == pytest.approx(np.linalg.norm(was))
        assert is_now @ sight == pytest.approx(-was @ sight if is_mirrored else was @ sight, abs=1e-9)
        assert np.allclose(across @ is_now, across @ was, atol=1e-12)
    carried = kinematics.skeleton.ancestors[:, chain[0]].astype(bool)
    assert np.allclose(new[~carried], old[~carried], atol=1e-12)
    changed = np.abs(after.rotations - before.rotations).max(axis=(1, 2)) > 1e-9
    assert 1 <= changed.sum() <= 2 and set(np.flatnonzero(changed)) <= set(chain[:2])
    products = np.swapaxes(after.rotations, -1, -2) @ after.rotations
    assert np.abs(products - np.eye(3)).max() < 1e-12 and np.linalg.det(after.rotations).min() > 0


def test_in_a_fixed_frame_the_line_of_sight_begins_at_the_camera():
    """The mirrored limbs of a body and a camera that are moved together are those of the body before, moved."""
    kinematics = body()
    before = random_state(np.random.default_rng(5), kinematics)
    turn, place = exponential(np.array([0.3, -1.0, 0.2])), np.array([2.0, -1.0, 4.0])
    rotations = before.rotations.copy()
    rotations[0] = turn @ rotations[0]
    moved = BodyState(rotations, turn @ before.translation + place)
    camera = CameraPose("side", turn.T, -turn.T @ place)
    for number in range(len(BONES)):
        here = mirrored(kinematics, evaluated(kinematics, before), number)
        there = mirrored(kinematics, evaluated(kinematics, moved), number, camera)
        assert np.allclose(there.rotations[:, 1:], here.rotations[:, 1:], atol=1e-9)


def test_a_skeleton_without_limbs_has_no_proposals():
    kinematics = random_body(np.random.default_rng(0))
    state = BodyState(np.tile(np.eye(3), (kinematics.joint_count, 1, 1)), np.array([0.0, 0.0, 3.0]))
    assert MirroredLimbs(kinematics).propose(evaluated(kinematics, state), seen_from(HERE), 0) is None


def test_a_limb_that_moves_no_landmark_is_not_mirrored():
    skeleton = body().skeleton
    points = [
        {"name": joint, "joint": joint, "offset": [0.0, 0.0, 0.0]}
        for joint in ("left_hip", "right_hip", "left_knee", "left_ankle", "left_shoulder", "right_shoulder", "head")
    ]
    kinematics = Kinematics(skeleton, Layout.from_mapping({"landmarks": points}, skeleton))
    tracked = evaluated(kinematics, random_state(np.random.default_rng(0), kinematics))
    states = mirrored(kinematics, tracked, 0)
    assert len(states.rotations) == 1
    changed = np.abs(states.rotations[0] - tracked.state.rotations).max(axis=(1, 2)) > 1e-9
    names = {skeleton.joint_names[joint] for joint in np.flatnonzero(changed)}
    assert names <= {"left_hip", "left_knee"} and names


def test_a_tracker_without_the_network_leaves_a_limb_that_is_mirrored_in_depth():
    """The tracked state is replaced by one with a limb mirrored; some frames later the right one is back."""
    tracker = Tracker(WITHOUT_NETWORK)
    frames = observations(tracker, 3.0, noise_px=1.0)
    kinematics, model = tracker.kinematics, tracker.frame_model
    for _, observation in frames[:30]:
        tracker.track(observation)
    solved = tracker._solved
    states = mirrored(kinematics, solved, 0)
    moved = [np.abs(kinematics.pose(BodyState(r, solved.state.translation)).positions - solved.pose.positions).max()
             for r in states.rotations]  # fmt: skip
    limb = int(np.argmax(moved))
    chain = [kinematics.skeleton.index(joint) for joint in LIMBS[limb]]

    def wrong(truth):
        joints = tracker._solved.pose.positions[chain]
        return np.linalg.norm((joints - joints[0]) - (truth[chain] - truth[chain[0]]), axis=-1).max()

    before = wrong(frames[29][0])
    tracker._solved = model.evaluate(BodyState(states.rotations[limb], states.translation[limb]))
    spoiled = wrong(frames[29][0])
    for _, observation in frames[30:]:
        tracker.track(observation)
    assert max(before, wrong(frames[-1][0])) + 0.1 < spoiled
