"""A whole recording: lengths first, then backward in time, then forward; published is between both tracks."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, RATE, observations

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.output.smoothing import COMPARED_S, TEMPER, Backward
from lassokin_ros.core.recording import WHOLE_FILE, published, track_backward, track_recording
from lassokin_ros.core.tracker import Tracker

FRAMES = 45
SMOOTHED = replace(CONFIG, **WHOLE_FILE, calibrate=False)


def instants(frames=FRAMES):
    """[[observation]] of the synthetic motion."""
    return [[one] for _, one in observations(Tracker(CONFIG), frames / RATE)]


@pytest.fixture(scope="module")
def tracks():
    """The forward track alone, the states backward, and what is published; all by stamp."""
    forward = {one.stamp: one for one in published(Tracker(SMOOTHED), instants())}
    backward = dict(track_backward(Tracker(SMOOTHED), reversed(instants())))
    both = {one.stamp: one for one in track_recording(SMOOTHED, instants())}
    return forward, backward, both


def test_each_frame_is_published_once_with_its_own_stamp(tracks):
    forward, backward, both = tracks
    stamps = [instant[0].stamp for instant in instants()]
    assert list(forward) == list(both) == stamps and sorted(backward) == stamps


def share(stamp, forward, backward):
    """Share of the way to the backward track: its odds, by the costs of both for 0.25 s before and after the frame."""
    more = [one.cost - backward[one.stamp].cost for one in forward.values() if abs(one.stamp - stamp) <= COMPARED_S]
    return 1 / (1 + np.exp(-TEMPER * np.mean(more)))


def test_the_published_state_is_between_both_tracks_by_their_costs(tracks):
    forward, backward, both = tracks
    shares = {stamp: share(stamp, forward, backward) for stamp in both}
    assert min(shares.values()) < 0.45 and max(shares.values()) > 0.5
    for stamp, estimate in both.items():
        one, other = forward[stamp].state, backward[stamp].state
        place = one.translation + shares[stamp] * (other.translation - one.translation)
        assert np.abs(estimate.state.translation - place).max() < 1e-12
        turns = logarithm(np.swapaxes(one.rotations, -1, -2) @ other.rotations)
        turned = logarithm(np.swapaxes(one.rotations, -1, -2) @ estimate.state.rotations)
        assert np.abs(turned - shares[stamp] * turns).max() < 1e-9


def test_pose_and_reprojection_error_are_those_of_the_published_state(tracks):
    forward, _, both = tracks
    tracker = Tracker(SMOOTHED)
    for stamp in list(both)[::7]:
        estimate = both[stamp]
        assert np.abs(estimate.pose.positions - tracker.kinematics.pose(estimate.state).positions).max() < 1e-12
        assert estimate.reprojection_px != forward[stamp].reprojection_px
        assert vars(estimate.certificate) == vars(forward[stamp].certificate)


def test_frames_that_only_one_track_has_are_published_as_they_are(tracks):
    forward, backward, _ = tracks
    tracker, stamps = Tracker(SMOOTHED), list(backward)
    tracker.backward = {stamp: backward[stamp] for stamp in stamps[::2]}.get
    mixed = {one.stamp: one for one in published(tracker, instants())}
    ahead = {stamp: np.array_equal(mixed[stamp].state.translation, forward[stamp].state.translation) for stamp in mixed}
    assert [stamp for stamp in ahead if not ahead[stamp]] == sorted(stamps[::2])


@pytest.mark.parametrize(("more", "wanted"), [(1e6, 0), (-1e6, 1)], ids=["worse", "better"])
def test_the_track_whose_costs_are_far_higher_has_no_influence(tracks, more, wanted):
    forward, backward, _ = tracks
    tracker = Tracker(SMOOTHED)
    tracker.backward = {at: Backward(one.state, forward[at].cost + more) for at, one in backward.items()}.get
    for one in published(tracker, instants()):
        expected = (forward, backward)[wanted][one.stamp].state.translation
        assert np.abs(one.state.translation - expected).max() < 1e-12


def test_a_backward_track_at_another_distance_changes_nothing(tracks):
    forward, backward, _ = tracks
    tracker = Tracker(SMOOTHED)
    far = {
        stamp: Backward(BodyState(one.state.rotations, 3 * one.state.translation), one.cost)
        for stamp, one in backward.items()
    }
    tracker.backward = far.get
    for one in published(tracker, instants()):
        assert one.state.translation[2] == pytest.approx(forward[one.stamp].state.translation[2], rel=0.05)


def test_images_of_several_cameras_that_are_milliseconds_apart_are_one_instant():
    side = CameraPose("side", np.eye(3), np.array([0.0, 0.0, 0.5]))
    pairs = [[one, replace(one, stamp=one.stamp + 0.004, camera=side)] for (one,) in instants(20)]
    states = dict(track_backward(Tracker(SMOOTHED), reversed(pairs)))
    assert states and set(states) <= {one.stamp for pair in pairs for one in pair}
    for early, late in ([one.stamp for one in pair] for pair in pairs):
        assert (early in states) is (late in states) and states.get(early) is states.get(late)
    assert len(track_recording(SMOOTHED, pairs)) == len(pairs)


def test_without_a_lag_each_frame_is_published_at_once():
    config = replace(SMOOTHED, smoothing_lag=0.0)
    backward = dict(track_backward(Tracker(SMOOTHED), reversed(instants())))
    forward, tracker, costs = Tracker(config), Tracker(config), []
    tracker.backward = backward.get
    for (one,) in instants():
        alone, _ = forward.track(one), tracker.track(one)
        costs.append((one.stamp, alone.cost - backward[one.stamp].cost))
        near = [more for stamp, more in costs if one.stamp - stamp <= COMPARED_S]
        way = backward[one.stamp].state.translation - alone.state.translation
        place = alone.state.translation + way / (1 + np.exp(-TEMPER * np.mean(near)))
        (estimate,) = tracker.published
        assert estimate.stamp == one.stamp and np.abs(estimate.state.translation - place).max() < 1e-12
