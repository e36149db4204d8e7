"""The tracker's behaviour: certified frames, refusals that leave the state alone, loss, determinism, live settings.

How accurate it is on real motion is measured by benchmarks/accuracy.py; here only that it follows at all.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import copied_body, relative_error
from sequences import CONFIG, FOCAL, NOISE_PX, RATE, aligned_error, frame, observations, same

from lassokin_ros.core.body.landmarks import built_in_layouts
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.hypotheses.start import FIT_AFTER
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.lasso.certificate import certify
from lassokin_ros.core.observation import Rejection, Status
from lassokin_ros.core.tracker import Tracker


def test_every_frame_is_tracked_certified_and_consistent():
    tracker = Tracker(replace(CONFIG, calibrate=False))
    errors = []
    last, replaced = None, False
    for i, (truth, observation) in enumerate(observations(tracker, 4.0)):
        estimate = tracker.track(observation)
        assert estimate.accepted and estimate.status is Status.TRACKING and estimate.stamp == observation.stamp
        assert estimate.initialised == (i == 0)
        assert estimate.certificate.kkt_residual <= 1e-6 and abs(estimate.certificate.relative_gap) < 1e-6
        rotations = estimate.state.rotations
        assert np.abs(np.swapaxes(rotations, -1, -2) @ rotations - np.eye(3)).max() < 1e-12
        assert np.abs(np.linalg.det(rotations) - 1).max() < 1e-12
        pose = tracker.kinematics.pose(estimate.state)
        assert np.array_equal(pose.positions, estimate.pose.positions)
        shown = (observation.points - project(pose.landmarks)) * FOCAL
        assert estimate.reprojection_px == pytest.approx(np.sqrt(np.mean(np.sum(shown**2, axis=-1))), rel=0.5)
        if last is not None and not replaced:  # the step that is reported leads from the last state to this one
            stepped = last.retract(estimate.increment.omega, estimate.increment.x)
            assert np.abs(stepped.rotations - estimate.solved.rotations).max() < 1e-9
            assert np.abs(stepped.translation - estimate.solved.translation).max() < 1e-9
        last, replaced = estimate.solved, tracker._starts.replaced
        errors.append(aligned_error(estimate, truth))
    assert np.median(errors) < 0.08 and estimate.reprojection_px < 4 * NOISE_PX


def test_larger_penalties_move_fewer_joints():
    sizes = []
    for sparsity in (0.05, 0.5, 5.0, 100.0):  # with the last one only the translation moves
        tracker = Tracker(replace(CONFIG, sparsity=sparsity))
        moved = [np.count_nonzero(tracker.track(o).increment.omega) for _, o in observations(tracker, 1.0)][1:]
        sizes.append(np.mean(moved))
    assert sizes[0] > sizes[1] > sizes[2] >= sizes[3]
    assert sizes[0] < 72 and sizes[3] < 1


def test_after_long_steps_frames_start_from_a_fit(monkeypatch):
    """At 2 Hz the last state is a poor start: half a second later people have another pose."""
    errors = []
    for fit_after in (FIT_AFTER, np.inf):
        monkeypatch.setattr("lassokin_ros.core.hypotheses.start.FIT_AFTER", fit_after)
        tracker = Tracker(replace(CONFIG, calibrate=False))
        estimates = [(x, tracker.track(o)) for x, o in list(observations(tracker, 20.0))[:: round(RATE / 2)]]
        assert all(estimate.accepted and estimate.certificate.kkt_residual <= 1e-6 for _, estimate in estimates)
        errors.append(np.mean([aligned_error(estimate, truth) for truth, estimate in estimates[1:]]))
    assert errors[0] < errors[1]


@pytest.mark.parametrize("layout", built_in_layouts("anthropometric"))
def test_every_layout_tracks(layout):
    tracker = Tracker(replace(CONFIG, landmarks=layout))
    for truth, observation in observations(tracker, 0.5):
        estimate = tracker.track(observation)
        assert estimate.accepted
    assert aligned_error(estimate, truth) < 0.12


BAD = {
    "shape": ({"points": np.zeros((17, 3))}, Rejection.WRONG_SHAPE),
    "ragged": ({"points": [[1.0, 2.0], [3.0]]}, Rejection.WRONG_SHAPE),
    "complex": ({"points": np.zeros((17, 2), complex)}, Rejection.WRONG_SHAPE),
    "objects": ({"points": np.full((17, 2), None)}, Rejection.WRONG_SHAPE),
    "text": ({"points": np.zeros((17, 2)).astype(str)}, Rejection.WRONG_SHAPE),
    "tuple": ({"confidence": tuple(np.ones(17))}, Rejection.WRONG_SHAPE),
    "depth": ({"depth": np.full(16, 3.0), "depth_of_surface": True}, Rejection.WRONG_SHAPE),
    "depth in words": ({"depth": np.full(17, "far")}, Rejection.WRONG_SHAPE),
    "nobody": ({"points": np.zeros((0, 2)), "confidence": np.zeros(0)}, Rejection.TOO_FEW_LANDMARKS),
    "no stamp": ({"stamp": None}, Rejection.NOT_FINITE),
    "endless": ({"stamp": np.inf}, Rejection.NOT_FINITE),
    "two focals": ({"focal": np.full(2, FOCAL)}, Rejection.NOT_FINITE),
    "negative focal": ({"focal": -100.0}, Rejection.NOT_FINITE),
    "old": ({"stamp": -1.0}, Rejection.OLD_STAMP),
    "few": ({"confidence": np.where(np.arange(17) < 3, 1.0, 0.0)}, Rejection.TOO_FEW_LANDMARKS),
    "NaN": ({"confidence": np.full(17, np.nan)}, Rejection.TOO_FEW_LANDMARKS),
    "far": ({"points": np.where(np.arange(34).reshape(17, 2) < 6, 0.1, 1e30)}, Rejection.TOO_FEW_LANDMARKS),
}
"""What a detector may send and the tracker rejects."""


@pytest.mark.parametrize("case", BAD)
def test_a_rejected_frame_has_a_reason_and_does_not_change_the_state(case):
    """The frames after it are bitwise the same as without it."""
    disturbed, undisturbed, (changes, reason) = Tracker(CONFIG), Tracker(CONFIG), BAD[case]
    for i, (_, observation) in enumerate(observations(disturbed, 0.3)):
        if i in (0, 1, 5) and not (i == 0 and reason is Rejection.OLD_STAMP):  # before the first frame, and later
            before = disturbed.state
            answer = disturbed.track(replace(observation, **{"stamp": observation.stamp - 0.01, **changes}))
            assert answer.rejection is reason and not answer.accepted and answer.state is None is answer.pose
            assert disturbed.state is before
        mine, theirs = disturbed.track(observation), undisturbed.track(observation)
        assert mine.accepted and same(mine.state, theirs.state)


def test_frames_with_missing_landmarks_are_tracked():
    """Four landmarks are enough for a frame; NaN, confidence 0 and absurd coordinates all mean missing."""
    tracker = Tracker(CONFIG)
    random = np.random.default_rng(5)
    for i, (_, observation) in enumerate(observations(tracker, 1.0)):
        points, confidence = observation.points.copy(), observation.confidence.copy()
        hidden = random.permutation(17)[: 0 if i == 0 else 13]
        points[hidden[:5]], confidence[hidden[5:9]], points[hidden[9:]] = np.nan, 0.0, 1e9
        estimate = tracker.track(replace(observation, points=points, confidence=confidence))
        assert estimate.accepted and np.isfinite(estimate.reprojection_px)


def test_missing_landmarks_have_no_influence():
    """Coordinates of a landmark with confidence 0 do not change a single bit."""
    a, b = Tracker(CONFIG), Tracker(CONFIG)
    for i, (_, observation) in enumerate(observations(a, 0.5)):
        confidence = observation.confidence.copy()
        confidence[i % 17] = 0
        elsewhere = observation.points.copy()
        elsewhere[i % 17] = 0.3
        first = a.track(replace(observation, confidence=confidence))
        second = b.track(replace(observation, points=elsewhere, confidence=confidence))
        assert same(first.state, second.state)


def test_the_tracker_searches_and_is_lost_after_a_gap_and_initialises_again():
    tracker = Tracker(replace(CONFIG, lost_after=0.5))
    nothing = replace(frame(tracker), confidence=np.zeros(17))
    assert tracker.track(replace(nothing, stamp=-10.0)).status is Status.SEARCHING and tracker.state is None
    assert tracker.track(replace(nothing, stamp=-1.0)).status is Status.SEARCHING
    assert tracker.track(frame(tracker)).status is Status.TRACKING
    assert tracker.track(frame(tracker)).rejection is Rejection.OLD_STAMP  # the same stamp again
    assert tracker.track(replace(nothing, stamp=0.4)).status is Status.TRACKING
    assert tracker.track(replace(nothing, stamp=0.6)).status is Status.LOST
    found = tracker.track(frame(tracker, 0.7))
    assert found.accepted and found.status is Status.TRACKING and found.initialised
    again = tracker.track(frame(tracker, 0.8))
    assert again.accepted and not again.initialised


def test_an_estimate_is_not_changed_by_later_frames():
    tracker = Tracker(CONFIG)
    estimates = [tracker.track(o) for _, o in observations(tracker, 0.3)]
    copies = [e.state.rotations.copy() for e in estimates]
    for _, observation in observations(tracker, 0.3, start=1.0):
        tracker.track(observation)
    assert all(np.array_equal(e.state.rotations, c) for e, c in zip(estimates, copies))


def test_tune_takes_effect_on_the_next_frame():
    tracker = Tracker(CONFIG)
    good = frame(tracker)
    weak = replace(good, confidence=np.full(17, 0.5))
    assert tracker.track(weak).accepted
    tracker.tune(replace(CONFIG, min_confidence=0.6))
    assert tracker.track(replace(weak, stamp=0.1)).rejection is Rejection.TOO_FEW_LANDMARKS
    tracker.tune(replace(CONFIG, min_landmarks=18))
    assert tracker.track(replace(good, stamp=0.2)).rejection is Rejection.TOO_FEW_LANDMARKS
    tracker.tune(replace(CONFIG, sparsity=100.0))
    assert not tracker.track(replace(good, stamp=0.3, points=good.points + 0.01)).increment.omega.any()
    tracker.tune(CONFIG)
    assert tracker.track(replace(good, stamp=0.4, points=good.points + 0.02)).accepted


def test_tuning_changes_live_settings_only():
    tracker = Tracker(CONFIG)
    tracker.tune(replace(CONFIG, height=1.6, landmarks="body25", solver="daqp", depth_prior=False))
    assert tracker.config == replace(CONFIG, height=1.6) and tracker.skeleton.height == 1.6
    assert tracker.track(frame(tracker)).accepted


@pytest.mark.parametrize("changes", [{"height": 3.0}, {"height": 1.6, "noise_px": -1.0}, {"height": 0.2}])
def test_tuning_to_a_bad_value_keeps_the_person(changes):
    """A good setting beside a bad one is not applied either, and tracking goes on."""
    tuned, left_alone = Tracker(CONFIG), Tracker(CONFIG)
    sequence = [observation for _, observation in observations(tuned, 0.4)]
    for i, observation in enumerate(sequence):
        if i == 6:
            with pytest.raises(ConfigurationError, match=r"is .*; expected"):
                tuned.tune(replace(CONFIG, **changes))
            assert tuned.config == CONFIG and tuned.skeleton.height == left_alone.skeleton.height
        assert same(tuned.track(observation).state, left_alone.track(observation).state)


def test_a_new_height_needs_no_file(tmp_path):
    """Skeleton and layout were read at the start; their files may have gone since then."""
    files = copied_body(tmp_path)
    config = replace(CONFIG, **files)
    tracker, fresh = Tracker(config), Tracker(replace(config, height=1.6))
    for path in files.values():
        Path(path).unlink()
    tracker.tune(replace(config, height=1.6))
    assert np.allclose(tracker.skeleton.offsets, fresh.skeleton.offsets, rtol=1e-12)
    assert np.allclose(tracker.layout.offsets, fresh.layout.offsets, rtol=1e-12)
    for _, observation in observations(fresh, 0.2):
        assert np.allclose(tracker.track(observation).pose.positions, fresh.track(observation).pose.positions)


def test_a_new_height_reaches_the_network_of_a_skeleton_in_metres():
    """Its lengths stay, so that the same ones are other fractions of the height."""
    given = replace(Skeleton.load("anthropometric", 1.75), metric=True)
    tracker, fresh = Tracker(replace(CONFIG, height=1.75), given), Tracker(CONFIG, given.at_height(1.6))
    tracker.tune(replace(CONFIG, height=1.6))
    assert np.array_equal(tracker._cameras[0].network._lengths, fresh._cameras[0].network._lengths)
    assert tracker._cameras[0].network._lengths_known and fresh._cameras[0].network._lengths_known
    for _, observation in observations(fresh, 0.2):
        assert np.allclose(tracker.track(observation).pose.positions, fresh.track(observation).pose.positions)


@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), -1e300])
def test_a_floor_that_is_no_place_is_refused_and_changes_nothing(wrong):
    tracker, left_alone = Tracker(CONFIG), Tracker(CONFIG)
    for _, observation in observations(tracker, 0.2):
        with pytest.raises(ConfigurationError, match=r"floor_below is .*; expected metres"):
            tracker.floor_below = wrong
        assert tracker.floor is None
        assert same(tracker.track(observation).state, left_alone.track(observation).state)


def test_the_difference_of_the_sides_is_told_as_long_as_their_mean_is_used():
    scales = np.ones(24)
    scales[[4, 7, 18]] = 1.25  # the left knee, ankle and elbow
    given = Skeleton.load("anthropometric", 1.75).with_bone_scales(scales)
    tracker = Tracker(CONFIG, given)
    difference = tracker.averaged
    assert difference > 0.045
    assert tracker.skeleton.offsets[4, 1] == tracker.skeleton.offsets[5, 1]
    same_body = Tracker(CONFIG)
    assert same_body.track(frame(same_body)).initialised
    same_body.tune(replace(CONFIG, calibrate=False))
    assert same_body.averaged == 0 and same_body.state is not None  # the person is kept
    tracker.tune(replace(CONFIG, calibrate=False))
    assert tracker.averaged == 0 and np.array_equal(tracker.skeleton.offsets, given.offsets)
    tracker.tune(replace(CONFIG, calibrate=False, height=1.5))
    assert tracker.averaged == 0 and tracker.skeleton.offsets[4, 1] != tracker.skeleton.offsets[5, 1]
    tracker.tune(replace(CONFIG, height=1.5))
    assert tracker.averaged == pytest.approx(difference)
    assert tracker.skeleton.offsets[4, 1] == tracker.skeleton.offsets[5, 1]


def test_noise_is_in_pixels_of_this_camera():
    """The same image at twice the focal length, with twice the noise in px, is the same problem."""
    near, far = Tracker(CONFIG), Tracker(replace(CONFIG, noise_px=2 * NOISE_PX))
    for _, observation in observations(near, 0.3):
        a, b = near.track(observation), far.track(replace(observation, focal=2 * FOCAL))
        assert relative_error(a.pose.positions, b.pose.positions) < 1e-9
        assert b.reprojection_px == pytest.approx(2 * a.reprojection_px, rel=1e-6)


@pytest.mark.parametrize("solver", ["daqp", "quadprog"])
def test_another_solver_gives_the_same_motion(solver):
    pytest.importorskip(solver, reason=f"{solver} is a test-only dependency")
    ours, theirs = Tracker(CONFIG), Tracker(replace(CONFIG, solver=solver))
    for _, observation in observations(ours, 0.5):
        a, b = ours.track(observation), theirs.track(observation)
        assert b.accepted and np.abs(a.pose.positions - b.pose.positions).max() < 1e-5


def test_an_uncertified_solve_does_not_move_the_state(monkeypatch):
    tracker = Tracker(CONFIG)
    sequence = [o for _, o in observations(tracker, 0.3)]
    for observation in sequence[:4]:
        tracker.track(observation)
    before = tracker.state
    with monkeypatch.context() as patch:
        patch.setattr(tracker._increments.lasso._dual, "solve", lambda reduced, *_: np.full(len(reduced.H), 1e3))
        for found in ("predicted_solution", "solve_active_set"):
            patch.setattr(f"lassokin_ros.core.lasso.solver.{found}", lambda *_: None)
        answer = tracker.track(sequence[4])
    assert answer.rejection is Rejection.NOT_CERTIFIED and answer.certificate.kkt_residual > 1e-6
    assert answer.status is Status.TRACKING
    assert tracker.state is before
    assert tracker.track(sequence[5]).accepted


def test_bones_without_length_are_tracked():
    scales, plain = np.ones(24), Tracker(CONFIG)
    scales[[plain.skeleton.index(joint) for joint in ("left_ankle", "left_wrist", "right_knee")]] = 0.0
    tracker = Tracker(replace(CONFIG, calibrate=False), plain.skeleton.with_bone_scales(scales))
    with np.errstate(all="raise", under="ignore"):
        for _, observation in observations(tracker, 1.0):
            estimate = tracker.track(observation)
            assert estimate.accepted and np.isfinite(estimate.state.rotations).all()


def test_the_certificate_is_of_the_problem_that_is_given():
    """If sparsity is so small that its alpha must be raised, the problem contains the raised alpha."""
    tracker, raised = Tracker(replace(CONFIG, sparsity=1e-4)), 0
    for _, observation in observations(tracker, 2.0):
        estimate = tracker.track(observation)
        problem, solution = estimate.increment.problem, estimate.increment.solution
        again = certify(problem.A, problem.B, problem.z, problem.alpha, solution.omega, solution.x)
        assert estimate.accepted and again.kkt_residual < 1e-6
        raised += bool(np.all(problem.alpha > 1.01 * 1e-4 / tracker._increments._motion))
    assert raised > 10


@pytest.mark.parametrize(("smoothing", "lag"), [(1e-90, 0.0), (9e-4, 0.1), (1.1e-3, 0.1)])
def test_the_shortest_smoothing_time_switches_the_filter_off(smoothing, lag):
    tracker = Tracker(replace(CONFIG, smoothing=smoothing, smoothing_lag=lag))
    published = []
    for _, observation in observations(tracker, 1.5):
        tracker.track(observation)
        published += tracker.published
    published += tracker.flush()
    assert len(published) == 45
    off = [np.abs(one.state.rotations - one.solved.rotations).max() for one in published]
    assert max(off) <= (0.02 if smoothing > 1e-3 else 0.0)


@pytest.mark.parametrize(
    "up", [np.zeros(3), np.array([0, 0, np.nan]), np.array([0, 0, np.inf]), np.zeros(2), np.eye(3), "z", [0, "a", 1]]
)
def test_a_vertical_that_is_none_is_refused(up):
    with pytest.raises(ConfigurationError, match=r"up is .*; expected the vertical of the fixed frame, \(3,\)"):
        Tracker(CONFIG, up=up)


def test_the_length_of_the_vertical_does_not_count():
    for up in ([0, 0, 5.0], (0, 0, 1), np.array([0, 0, 1e-3])):
        assert np.array_equal(Tracker(CONFIG, up=up).learned.vertical.direction, [0.0, 0.0, 1.0])
