"""Left/right swaps of keypoints: corrected together, but only for a limited time."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, observations

from lassokin_ros.core.body.landmarks import Layout, built_in_layouts, skeleton_of
from lassokin_ros.core.body.proportions import limb_groups, other_side
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.keypoint_filter import KeypointFilter
from lassokin_ros.core.image.side_swaps import MAX_DURATION, MAX_SHARE, SideSwaps
from lassokin_ros.core.tracker import Tracker

PARTS = ("eye", "shoulder", "wrist", "hip", "knee", "ankle")
NAMES = ("nose", *(f"{side}_{part}" for part in PARTS for side in ("left", "right")))
LIMBS = (-1, -1, -1, 7, 7, 7, 7, 1, 1, 1, 1, 1, 1)
ALL = PARTS
LEGS = ("hip", "knee", "ankle")
RATE, NOISE, LIKENESS = 60.0, 0.002, 0.001
EPOCH = 1.7e9
"""s: stamps are clock times that do not start at 0."""


def crossed(parts):
    """(l,) order of the landmarks with left and right of some parts exchanged."""
    named = [other_side(name) if name.split("_")[-1] in parts else name for name in NAMES]
    return [NAMES.index(name) for name in named]


def places(frame):
    """(13, 2): a person who walks; knees, ankles and wrists pass twice per second, hips are side by side."""
    time = frame / RATE
    points, stride = [(0.0, -0.4)], np.sin(2 * np.pi * time)
    halves = (0.02, 0.06, -0.1 * stride, 0.004, 0.06 * stride, 0.1 * stride)
    for reach, level in zip(halves, (-0.42, -0.3, 0.0, 0.0, 0.2, 0.4)):
        points += [(reach, level), (-reach, level)]
    return np.array(points) + [0.2 * time, 0.0]


def hands_together(frame):
    """The same, with a hand that is hidden and then appears near the position of the other one."""
    points = places(frame)
    for side, place in (("left", 0.02), ("right", -0.02)):
        points[NAMES.index(f"{side}_wrist"), 0] = place + 0.2 * frame / RATE
    return points


def filtered(frames, swapped=(), parts=ALL, weights=None, at=places):
    """The filter's answers to noisy points, with some parts swapped in some frames.

    weights: (l,), or a function of the frame; at: the points of a frame.
    """
    random = np.random.default_rng(0)
    keypoint_filter = KeypointFilter(NAMES, LIMBS)
    weights = np.full(len(NAMES), 1 / NOISE) if weights is None else weights
    answers = []
    for frame in range(frames):
        points = at(frame) + NOISE * random.normal(size=(len(NAMES), 2))
        order = crossed(parts) if frame in swapped else slice(None)
        seen = weights(frame) if callable(weights) else weights
        answers.append(keypoint_filter.update(EPOCH + frame / RATE, points[order], seen[order], 1.0, LIKENESS))
    return answers


def without(hidden, first=0):
    """Weights of a frame: some landmarks are missing from a given frame on."""
    seen = np.array([name not in hidden for name in NAMES])
    return lambda frame: np.where(seen | (frame < first), 1 / NOISE, 0.0)


def assert_same(plain, mended):
    for (a, u), (b, v) in zip(plain, mended, strict=True):
        assert np.allclose(a, b, rtol=0, atol=1e-13) and np.allclose(u, v, rtol=1e-10)


@pytest.mark.parametrize("length", [1, 2, 5, 25, 90, 115])
def test_a_swap_of_the_whole_body_is_corrected(length):
    """Hips are closer than their noise, and wrists and legs pass each other; they follow the other pairs."""
    assert_same(filtered(520), filtered(520, range(400, 400 + length)))


@pytest.mark.parametrize("parts", [LEGS, ("knee", "ankle"), ("shoulder", "wrist")], ids="-".join)
@pytest.mark.parametrize("first, last", [(405, 418), (390, 412), (400, 425), (400, 490)])
def test_a_swap_of_limbs_is_corrected_without_the_rest(parts, first, last):
    """Also if the swap begins, lasts or ends while the legs pass each other (frames 390, 420, 450, …)."""
    plain, mended = filtered(560), filtered(560, range(first, last), parts)
    off = max(np.abs(a - b).max() for (a, _), (b, _) in zip(plain, mended))
    assert off < 3 * NOISE  # pairs that pass each other are closer than this
    assert np.array_equal(plain[-1][1] > 0, mended[-1][1] > 0)


@pytest.mark.parametrize("of, out_of", [(40, 100), (3, 4)])
def test_the_time_limit_holds_for_each_swap(of, out_of):
    swapped = [frame for frame in range(400, 1400) if frame % out_of < of]
    assert_same(filtered(1400), filtered(1400, swapped))


def test_weights_are_exchanged_with_their_points():
    weights = np.where(np.arange(len(NAMES)) % 3, 500.0, 100.0)
    assert_same(filtered(120, (), ALL, weights), filtered(120, range(60, 65), ALL, weights))


@pytest.mark.parametrize("before", [60, 600])
def test_a_lasting_swap_is_accepted_in_the_end(before):
    """Otherwise a start with swapped sides, which the detector then corrects, would be kept for ever."""
    swapped = range(before, before + 240)
    answers = filtered(before + 240, swapped)
    believed = [np.abs(answers[frame][0] - places(frame)[crossed(ALL)]).max() < 0.02 for frame in swapped]
    first, hold = believed.index(True), min(MAX_DURATION, MAX_SHARE / (1 - MAX_SHARE) * before / RATE)
    assert hold - 0.02 < first / RATE < hold + 0.05 and all(believed[first + 2 :])


@pytest.mark.parametrize("duration", [180, 400])
def test_the_return_from_a_swap_that_was_accepted_is_believed_at_once(duration):
    """Otherwise the detector's right sides would be swapped back, for up to `MAX_DURATION`."""
    before = 600
    end = before + duration
    answers = filtered(end + 60, range(before, end))
    wrong = [np.abs(answers[frame][0] - places(frame)).max() > 0.02 for frame in range(end, end + 60)]
    assert np.abs(answers[end - 1][0] - places(end - 1)[crossed(ALL)]).max() < 0.02  # the swap was accepted
    assert not any(wrong[6:])


def test_sides_that_lasted_longer_than_the_former_ones_are_the_right_ones():
    """A start with swapped sides, then right ones, then a swap of 5 frames: it is corrected."""
    answers = filtered(305, [*range(60), *range(300, 305)])
    assert all(np.abs(answers[frame][0] - places(frame)).max() < 0.02 for frame in (299, 300, 302, 304))


def test_pairs_without_evidence_are_accepted_with_the_others():
    """Eyes side by side give no evidence while all other pairs are accepted as swapped.

    They must not undo this later.
    """

    def at(frame):
        points = places(frame)
        points[[NAMES.index("left_eye"), NAMES.index("right_eye")], 0] += 0.02 * (frame < 1940) * np.array([-1, 1])
        return points

    swapped = range(1800, 1950)  # for longer than MAX_DURATION, after half a minute
    answers = filtered(1980, swapped, at=at)
    assert all(np.abs(answers[frame][0] - at(frame)).max() < 0.02 for frame in (1850, *range(1965, 1980)))
    assert np.abs(answers[1948][0] - at(1948)[crossed(ALL)]).max() < 0.02


@pytest.mark.parametrize("parts", [LEGS, ("ankle",)], ids="-".join)
@pytest.mark.parametrize("first", [0, 370, 398])
def test_a_limb_without_its_visible_partner_is_not_swapped(parts, first):
    """From the side the far arm is hidden: there is no partner to exchange with, although the legs are swapped."""
    weights = without({"right_wrist", "right_shoulder"}, first)
    plain, mended = (filtered(430, swapped, parts, weights, hands_together) for swapped in ((), range(400, 425)))
    near = [NAMES.index("left_wrist"), NAMES.index("left_shoulder")]
    for (a, u), (b, v) in zip(plain, mended, strict=True):
        assert np.allclose(a[near], b[near], rtol=0, atol=1e-13) and np.allclose(u[near], v[near], rtol=1e-10)
    legs = [number for number, name in enumerate(NAMES) if any(part in name for part in parts)]
    assert np.abs(plain[412][0] - mended[412][0])[legs].max() < 0.02  # those are exchanged back


@pytest.mark.parametrize("first", [0, 330, 395])
def test_a_limb_without_its_visible_partner_follows_the_body(first):
    """If the whole body is swapped, its single visible wrist appears as the other one."""
    weights = without({"right_wrist"}, first)
    assert_same(*(filtered(430, swapped, ALL, weights, hands_together) for swapped in ((), range(400, 425))))


def test_missing_pairs_give_no_evidence():
    """Only the swapped wrists and the hips, side by side, are visible: the hips follow the wrists."""
    hidden = {f"{side}_{part}" for part in ("eye", "shoulder", "knee", "ankle") for side in ("left", "right")}
    weights = without(hidden, 400)
    assert_same(filtered(420, (), ALL, weights), filtered(420, range(400, 410), ALL, weights))


def test_a_wrist_detected_at_the_other_wrist_is_left_out():
    """Both wrists are detected at the position of one: nothing is exchanged, and the other one coasts."""
    random = np.random.default_rng(0)
    keypoint_filter, weights = KeypointFilter(NAMES, LIMBS), np.full(len(NAMES), 1 / NOISE)
    left, right = NAMES.index("left_wrist"), NAMES.index("right_wrist")
    for frame in range(400, 436):  # the stride is widest at its end
        points = places(frame) + NOISE * random.normal(size=(len(NAMES), 2))
        if frame == 435:
            points[left] = points[right] + NOISE * random.normal(size=2)
        answer, _ = keypoint_filter.update(EPOCH + frame / RATE, points, weights, 1.0, LIKENESS)
    assert np.linalg.norm(places(435)[left] - places(435)[right]) > 0.15
    assert np.abs(answer - places(435)).max() < 6 * NOISE
    assert keypoint_filter.assignment is not None and np.array_equal(keypoint_filter.assignment, np.arange(len(NAMES)))


def evidence(swaps, stamp, straight, crossed, step=0.1):
    """The answer to distances of ("left_wrist", "right_wrist", "left_knee", "right_knee") for equal tracks."""
    order, given_up = swaps.assign(stamp, step, np.array(straight), np.array(crossed), np.ones(len(straight)))
    return list(order), list(given_up)


@pytest.mark.parametrize("crossed, swapped", [((3.0, 9.0), True), ((3.0, 39.0), False), ((np.nan, np.nan), False)])
def test_outliers_are_not_treated_as_swaps(crossed, swapped):
    """Where hands meet, both points jump: each may be nearer to the other's track without fitting it."""
    swaps = SideSwaps(("left_wrist", "right_wrist"), (0, 0))
    order, given_up = evidence(swaps, 1.0, (58.0, 60.0), crossed)
    assert order == ([1, 0] if swapped else [0, 1]) and not any(given_up)
    assert swaps.pending is swapped


def test_the_time_limit_of_a_swap_recovers_without_a_swap():
    """Pairs side by side follow other pairs, and may never show that they are in place again."""
    swaps = SideSwaps(("left_wrist", "right_wrist", "left_knee", "right_knee"), (0, 0, 1, 1))
    swaps.start_tracks(np.full(4, True), 90.0)
    beside, apart = (1.0, 1.0), (60.0, 60.0)
    for frame in range(15):
        assert evidence(swaps, 100 + frame / 10, beside + apart, beside + beside)[0] == [1, 0, 3, 2]
    for frame in range(16):
        assert swaps.pending or frame == 15
        assert evidence(swaps, 102 + frame / 10, beside + beside, beside + apart)[0] == [0, 1, 2, 3]
    assert not swaps.pending
    for frame in range(15):
        assert evidence(swaps, 104 + frame / 10, apart + apart, beside + beside) == ([1, 0, 3, 2], 4 * [False])


def test_both_points_of_a_pair_are_corrected_and_restarted_together():
    """For random tracks and points: no point may be used for both landmarks."""
    random = np.random.default_rng(0)
    for _ in range(20):
        swaps, stamp, step = SideSwaps(NAMES, random.integers(-1, 3, size=len(NAMES))), 90.0, 1 / RATE
        for _ in range(200):
            stamp += step
            missing, anew = random.random((2, len(NAMES))) < ((0.1,), (0.02,))
            straight, across = random.exponential(random.choice([1.0, 60.0], size=(2, len(NAMES))))
            across = np.where(missing | missing[swaps.other], np.nan, across)
            variance = random.exponential(size=len(NAMES))
            order, given_up = swaps.assign(stamp, step, np.where(missing, np.nan, straight), across, variance)
            assert np.array_equal(order[order], np.arange(len(NAMES)))
            assert np.array_equal(given_up, given_up[swaps.other])
            swaps.start_tracks(anew | given_up, stamp)


def test_restarted_tracks_do_not_depend_on_earlier_points():
    swaps, apart, beside = SideSwaps(("left_wrist", "right_wrist"), (0, 0)), (60.0, 60.0), (1.0, 1.0)
    swaps.start_tracks(np.full(2, True), 90.0)
    assert evidence(swaps, 100.0, apart, beside) == ([1, 0], [False, False])
    swaps.start_tracks(np.full(2, True), 100.1)
    assert evidence(swaps, 100.2, apart, beside) == ([1, 0], [False, False])
    assert evidence(swaps, 100.3, apart, beside) == ([0, 1], [True, True])  # a quarter of 0.2 s is over
    swaps.reset()
    assert not swaps.pending and evidence(swaps, 0.05, apart, beside, step=0.02) == ([1, 0], [False, False])


def test_a_filter_that_is_reset_has_no_swaps():
    weights, random = np.full(len(NAMES), 1 / NOISE), np.random.default_rng(0)
    reset, new = KeypointFilter(NAMES, LIMBS), KeypointFilter(NAMES, LIMBS)
    for frame in range(200):
        order = crossed(ALL) if frame > 180 else slice(None)
        reset.update(EPOCH + frame / RATE, places(frame)[order], weights, 1.0, LIKENESS)
    reset.reset()
    for frame in range(200, 300):
        points = places(frame) + NOISE * random.normal(size=(len(NAMES), 2))
        points = points[crossed(LEGS)] if frame > 240 else points
        answers = [each.update(EPOCH + frame / RATE, points, weights, 1.0, LIKENESS) for each in (reset, new)]
        assert_same(answers[:1], answers[1:])


def test_the_tracker_is_not_moved_by_a_body_swapped_for_half_a_second():
    """The states are bitwise equal: every keypoint is assigned to its landmark again."""
    plain, mixed = Tracker(CONFIG), Tracker(CONFIG)
    order = [plain.layout.names.index(other_side(name)) for name in plain.layout.names]
    for frame, (_, observation) in enumerate(observations(plain, 3.0)):
        seen = observation
        if 100 <= frame < 130:
            seen = replace(observation, points=observation.points[order], confidence=observation.confidence[order])
        a, b = plain.track(observation), mixed.track(seen)
        assert np.array_equal(a.state.rotations, b.state.rotations)


def test_limbs_follow_from_the_skeleton():
    skeleton = Skeleton.load("anthropometric", 1.75)
    limbs = limb_groups(skeleton)
    of = {name: limbs[joint] for joint, name in enumerate(skeleton.joint_names)}
    assert of["left_hip"] == of["right_foot"] != of["left_collar"] == of["right_wrist"]
    assert of["pelvis"] == of["spine2"] == of["head"] == -1
    assert of["left_hip"] >= 0 and of["left_collar"] >= 0


@pytest.mark.parametrize("name", [*built_in_layouts("anthropometric"), *built_in_layouts("body_hands")])
def test_every_landmark_with_a_side_has_another(name):
    layout = Layout.load(name, Skeleton.load(skeleton_of(name), 1.75))
    sided = [landmark for landmark in layout.names if "left" in landmark or "right" in landmark]
    assert all(other_side(landmark) != landmark and other_side(landmark) in layout.names for landmark in sided)
    assert len(sided) >= 12 and all(other_side(other_side(landmark)) == landmark for landmark in layout.names)
