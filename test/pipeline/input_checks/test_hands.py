"""Hands that are exchanged, alike, somebody else's or in another order: each case is named, or taken right."""

from collections import Counter

import numpy as np
import pytest

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.pipeline.input_checks.hands import ALIKE, EXCHANGED, FAR, FEWEST_POINTS, LIMBS, ORDER, SAME, HandCheck
from lassokin_ros.pipeline.seen import Seen

SKELETON = Skeleton.load("body_hands", 1.75)
LAYOUT = Layout.load("mediapipe75", SKELETON)
LEFT, RIGHT = np.arange(33, 54), np.arange(54, 75)


def points():
    """A person who lifts both hands, at 2.5 m, in normalised coordinates."""
    body = Kinematics(SKELETON, LAYOUT)
    turns = np.zeros((54, 3))
    turns[0] = np.pi, 0, 0
    for side, sign in (("left", 1), ("right", -1)):
        turns[SKELETON.index(f"{side}_shoulder")] = 0, 0, -0.9 * sign
        turns[SKELETON.index(f"{side}_elbow")] = 0.0, -0.4 * sign, 1.3 * sign
    return project(body.pose(BodyState(exponential(turns), np.array([0.0, 0.0, 2.5]))).landmarks)


POINTS = points()
LAST = [0, *range(5, 21), *range(1, 5)]  # the thumb after the other fingers


def swapped(p):
    p[LEFT], p[RIGHT] = p[RIGHT].copy(), p[LEFT].copy()


def left_label_of_the_right_hand(p):
    p[LEFT], p[RIGHT] = p[RIGHT].copy(), np.nan


def doubled(p):
    p[RIGHT] = p[LEFT] + 0.0005


def far(p):
    p[LEFT] += [0.4, 0.0]  # 1 m


def both_far(p):
    p[np.r_[LEFT, RIGHT]] += [0.0, -0.4]


def somebody_elses(p):
    p[RIGHT] = np.nan
    p[LEFT] = p[LEFT] * 0.7 + [0.5, 0.1]


def last_thumb(p):
    p[LEFT], p[RIGHT] = p[LEFT][LAST], p[RIGHT][LAST]


def smplh(p):
    order = [0, *range(5, 13), *range(17, 21), *range(13, 17), *range(1, 5)]
    p[LEFT], p[RIGHT] = p[LEFT][order], p[RIGHT][order]


def at_the_other_wrist(p):
    p[LEFT] += POINTS[RIGHT[0]] - POINTS[LEFT[0]]


BOTH = {"left": LEFT, "right": RIGHT}
CASES = {  # what is named, and whose points the hands have then
    "as they should be": (lambda p: None, None, {"left": LEFT, "right": RIGHT}),
    "exchanged": (swapped, EXCHANGED, {"left": LEFT, "right": RIGHT}),
    "one, with the other's label": (left_label_of_the_right_hand, EXCHANGED, {"right": RIGHT}),
    "the same twice": (doubled, SAME, {"left": LEFT}),
    "one a metre away": (far, FAR, {"right": RIGHT}),
    "both a metre away": (both_far, FAR, {}),
    "somebody else's": (somebody_elses, FAR, {}),
    "one at the other's wrist": (at_the_other_wrist, FAR, {"right": RIGHT}),
    "the thumb last": (last_thumb, ORDER, {"left": LEFT, "right": RIGHT}),
    "in SMPL-H's order": (smplh, ORDER, {}),
    "no hands": (lambda p: p.__setitem__(np.r_[LEFT, RIGHT], np.nan), None, {}),
    "no wrists of the body": (lambda p: p.__setitem__([15, 16], np.nan), None, {"left": LEFT, "right": RIGHT}),
}


def seen(p, **more):
    return Seen(p, np.isfinite(p[:, 0]).astype(float), 3, 1000 * p, **more)


@pytest.mark.parametrize("case", CASES)
def test_each_case_is_named_or_taken_right(case):
    change, name, expected = CASES[case]
    given, counts = POINTS.copy(), Counter()
    change(given)
    check = HandCheck(LAYOUT.names, counts)
    for _ in range(12):
        (one,) = check.checked([seen(given.copy(), depth=np.arange(75.0))])
    assert set(counts) == ({name} if name else set())
    for side, rows in BOTH.items():
        if side in expected:
            assert np.allclose(one.points[rows], POINTS[expected[side]]) and (one.confidence[rows] == 1).all()
        else:
            assert np.isnan(one.points[rows]).all() and (one.confidence[rows] == 0).all()
    assert np.array_equal(one.points[:33], given[:33], equal_nan=True) and one.number == 3
    assert np.array_equal(one.pixels, 1000 * one.points, equal_nan=True)


def test_depths_move_with_their_hand():
    given = POINTS.copy()
    swapped(given)
    (one,) = HandCheck(LAYOUT.names, Counter()).checked([seen(given, depth=np.arange(75.0), sampled=None)])
    assert one.depth[LEFT].tolist() == RIGHT.tolist() and one.depth[:33].tolist() == list(range(33))


def test_hands_that_meet_are_not_exchanged():
    for apart in (0.0, 0.01):
        given, counts = POINTS.copy(), Counter()
        middle = 0.5 * (given[15] + given[16])
        for wrist, rows, shift in ((15, LEFT, [apart, 0.0]), (16, RIGHT, [-apart, 0.0])):
            given[rows] += middle + shift - given[wrist]
            given[wrist] = middle + shift
        HandCheck(LAYOUT.names, counts).checked([seen(given)])
        assert not counts


def test_the_order_is_known_from_both_hands_of_an_image_or_after_some_single_ones():
    def taken(check, p):
        """Whether the left hand has the points of the left hand in their order."""
        return np.allclose(check.checked([seen(p)])[0].points[LEFT], POINTS[LEFT])

    wrong = POINTS.copy()
    last_thumb(wrong)
    assert taken(HandCheck(LAYOUT.names, Counter()), wrong)
    wrong[RIGHT] = np.nan
    check = HandCheck(LAYOUT.names, Counter())
    single = [taken(check, wrong) for _ in range(6)]
    assert single == sorted(single) and not single[0] and single[3]
    again = [taken(check, POINTS) for _ in range(40)]
    assert not again[0] and again[-1]


def test_a_hand_alone_has_only_its_order_checked():
    counts, names = Counter(), LAYOUT.names[33:54]
    check = HandCheck(names, counts)
    (one,) = check.checked([seen(POINTS[LEFT])])
    assert np.array_equal(one.points, POINTS[LEFT]) and not counts and check.active
    for _ in range(12):
        check.checked([seen(POINTS[LEFT][LAST])])
    assert set(counts) == {ORDER}


def test_a_layout_without_hands_is_left_alone():
    check = HandCheck(LAYOUT.names[:33], Counter())
    person = seen(POINTS[:33])
    assert not check.active and check.checked([person])[0] is person


def test_few_points_are_no_hand():
    given, counts = POINTS.copy(), Counter()
    far(given)
    given[LEFT[FEWEST_POINTS - 1 :]] = np.nan
    HandCheck(LAYOUT.names, counts).checked([seen(given)])
    assert not counts


def test_hands_are_alike_up_to_a_share_of_their_size():
    extent = np.linalg.norm(np.ptp(POINTS[LEFT], axis=0))
    for share, found in ((0.9 * ALIKE, True), (1.1 * ALIKE, False)):
        given, counts = POINTS.copy(), Counter()
        given[RIGHT] = given[LEFT] + [share * extent, 0.0]
        HandCheck(LAYOUT.names, counts).checked([seen(given)])
        assert (SAME in counts) is found


def test_the_lengths_of_limbs_are_those_of_the_skeleton():
    body = Skeleton.load("anthropometric", 1.0)
    for ends, share in LIMBS.items():
        places = [body.rest_positions[body.index(f"left_{joint}")] for joint in ends]
        assert np.linalg.norm(np.subtract(*places)) == pytest.approx(share, abs=0.02), ends
