"""Offsets of the clocks of cameras that see one person, from the keypoints alone."""

import numpy as np
import pytest
from camera_rig import eye, pixels, truth_at

from lassokin_ros.core.rig.clocks import (
    STEP_S,
    UNKNOWN,
    Offset,
    Track,
    _combined,
    course_of,
    offset_between,
    offsets_of,
    track_of,
)

EYES = [eye("a", 0), eye("b", 80), eye("c", 200, 4.0)]


def track(camera, begin, end, late=0.0, still=False, lost=None, seed=0):
    """What a camera sees from s to s of the motion. late: s of its clock before the common one; lost: s, s."""
    times, random = np.arange(begin, end, 1 / 30), np.random.default_rng([seed, EYES.index(camera)])
    points = np.array([pixels(camera, 0.0, marks, random, 2.0) for marks in truth_at(times, still=still).landmarks])
    stamps = times - late
    if lost is not None:
        kept = (times < lost[0]) | (times >= lost[1])
        points, stamps = points[kept], stamps[: np.count_nonzero(kept)]
    return track_of(stamps, points, random.uniform(size=points.shape[:2]) > 0.03)


def test_a_track_interpolates_and_does_not_bridge_gaps():
    times = np.concatenate([np.arange(0, 1, 0.033), np.arange(1.5, 2.5, 0.033)])
    points = np.stack([np.sin(times), times], axis=-1)[:, None]
    found = track_of(times, points, np.ones((len(times), 1), bool))
    grid = np.arange(len(found)) * STEP_S
    inside = found.known[:, 0]
    assert inside[(grid > 0.1) & (grid < 0.9)].all() and not inside[(grid > 1.05) & (grid < 1.45)].any()
    assert np.abs(found.points[inside, 0, 1] - grid[inside]).max() < 1e-9
    assert np.abs(found.points[inside, 0, 0] - np.sin(grid[inside])).max() < 1e-3
    assert track_of(times[:1], points[:1], np.ones((1, 1), bool)) is None


def test_the_offset_is_found_with_its_deviation():
    offset = offset_between(track(EYES[0], 0, 6), track(EYES[1], 1, 7, late=2.35))
    assert offset.is_sure and abs(offset.seconds + 2.35) < 0.01 and offset.deviation < 0.01


def test_somebody_who_stands_shows_no_offset():
    assert not offset_between(track(EYES[0], 0, 5, still=True), track(EYES[1], 0, 5, still=True)).is_sure
    nobody = Track(0.0, np.zeros((300, 17, 2)), np.zeros((300, 17), bool))
    assert offset_between(nobody, track(EYES[1], 0, 5)) is UNKNOWN
    assert offset_between(track(EYES[0], 0, 3), track(EYES[1], 0, 3, late=-50)) is UNKNOWN


def test_offsets_of_three_cameras_agree_and_one_that_nobody_connects_is_unknown():
    tracks = [[track(EYES[0], 0, 5)], [track(EYES[1], 0, 5, late=0.5)], [track(EYES[2], 0, 5, late=-0.25)]]
    found = offsets_of(tracks)
    assert [round(one.seconds, 2) for one in found] == [0.0, -0.5, 0.25] and all(one.is_sure for one in found)
    assert found[0].deviation == 0 and offsets_of([tracks[0], tracks[1], []])[2] is UNKNOWN


def test_pairs_are_weighted_by_their_deviations():
    pairs = {(0, 1): Offset(0.1, 0.001, 1, 0), (1, 2): Offset(0.1, 0.001, 1, 0), (0, 2): Offset(0.5, 0.1, 1, 0)}
    offsets, deviations = _combined(4, pairs)
    assert np.allclose(offsets[:3], [0, 0.1, 0.2], atol=1e-3) and np.isinf(deviations[3])


@pytest.mark.parametrize("lost", [None, (5.0, 5.5)])
def test_lost_images_are_found(lost):
    first, other = track(EYES[0], 0, 10), track(EYES[1], 0, 10.5 if lost else 10, late=1.0, lost=lost)
    course = course_of(first, other, offset_between(first, other))
    if lost is None:
        assert not course.lost and not course.drift and abs(course.at(np.array([3.0]))[0] + 1.0) < 0.01
    else:
        ((at, seconds),) = course.lost
        assert abs(at - 4.0) < 1.1 and abs(seconds - 0.5) < 0.02
        assert np.abs(course.at(np.array([0.0, 9.0])) - [-1.0, -1.5]).max() < 0.02
