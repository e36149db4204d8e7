"""Hands that are exchanged, alike, somebody else's or in another order: alone, and through a session; ~/hands."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from detector_messages import detector_types
from messages import FRAME, camera_info, rosbags_backend
from onnx_graph import Graph

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout, skeleton_of
from lassokin_ros.core.body.rotations import exponential, from_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.output.hand_points import HandPoints
from lassokin_ros.detector.backend import keypoint_message, make_detector
from lassokin_ros.gestures import GESTURES
from lassokin_ros.pipeline.concerns.catalogue import CONCERNS
from lassokin_ros.pipeline.concerns.live import HANDS
from lassokin_ros.pipeline.input_checks.hands import ALIKE, EXCHANGED, FAR, FEWEST_POINTS, LIMBS, ORDER, SAME, HandCheck
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.seen import Seen
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.watch import points as points_of
from msg_adapters.backends import RosbagsBackend
from msg_adapters.detectors import point_cloud2
from msg_adapters.keypoints import Keypoints

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


BACKEND = rosbags_backend()
FRAMES, BAD_FROM = 12, 4
MEAN_MM, MOST_MM, STEP_MM = 5.0, 25.0, 10.0
"""Of the 22 joints in each frame, of one joint, and of it from one frame to the next: a wrist that loses its hand."""


def session(landmarks="mediapipe75", skeleton="body_hands"):
    made = Session(TrackerConfig(height=1.75, skeleton=skeleton, landmarks=landmarks), NodeSettings())
    made.set_camera(camera_info(BACKEND))
    return made


def places(one, time, points_with=""):
    """Normalised landmarks of a person who moves the right arm. points_with: side of a hand that points."""
    skeleton, body = one.tracker.skeleton, one.tracker.kinematics
    turns = np.zeros((skeleton.joint_count, 3))
    turns[0] = np.pi, 0, 0
    for side, sign in (("left", 1), ("right", -1)):
        turns[skeleton.index(f"{side}_shoulder")] = 0, 0, -0.9 * sign
        turns[skeleton.index(f"{side}_elbow")] = 0, -0.4 * sign, (1.1 + 0.5 * time * (side == "right")) * sign
        for finger in ("index", "middle", "ring", "pinky"):
            bent = side == points_with and finger != "index"
            for part, bend in zip((1, 2, 3), (1.4, 1.7, 0.9) if bent else (0, 0.5 if side != points_with else 0.1, 0)):
                turns[skeleton.index(f"{side}_{finger}{part}")] = 0, 0, -bend * sign
    pose = body.pose(BodyState(exponential(turns), np.array([0.0, 0.0, 2.5])))
    return project(pose.landmarks)


def px(one, points):
    """The pixels of normalised points."""
    (camera,) = one.cameras.values()
    return camera.camera.view.lens.distort(points)


def run(change=lambda p, i: None, frames=FRAMES):
    """The session, and the positions of the body's joints (frames, 22, 3)."""
    one, random, found = session(), np.random.default_rng(0), []
    for i in range(frames):
        points = places(one, i / 30)
        if i >= BAD_FROM:
            change(points, i)
        pixels = px(one, points) + random.normal(size=(75, 2))
        seen = np.isfinite(pixels[:, 0])
        keypoints = Keypoints(round(1e9 * (1 + i / 30)), FRAME, np.arange(75)[seen], pixels[seen], np.ones(seen.sum()))
        frame = one.process(keypoints, 7)
        assert frame.accepted, frame.detail
        found.append(frame.estimate.pose.positions[:22])
    return one, np.array(found)


@pytest.fixture(scope="module")
def right():
    return run()[1]


def come_and_go(p, i):
    if i % 3:
        p[LEFT] = np.nan
    if i % 4 == 0:
        p[RIGHT] = np.nan


IN_IMAGES = (
    *("exchanged", "one, with the other's label", "the same twice", "one a metre away", "one at the other's wrist"),
    *("the thumb last", "in SMPL-H's order", "come and go"),
)


@pytest.mark.parametrize("case", IN_IMAGES)
def test_bad_hands_hardly_move_the_body_and_are_named(case, right):
    """Each case of the check, and hands that come and go."""
    change, name, _ = CASES.get(case, (None, None, None))
    one, found = run(come_and_go if change is None else lambda p, i: change(p))
    moved = 1e3 * np.linalg.norm(found - right, axis=-1)
    assert moved.mean(axis=1).max() < MEAN_MM and moved.max() < MOST_MM
    assert 1e3 * np.linalg.norm(np.diff(found - right, axis=0), axis=-1).max() < STEP_MM
    assert {count for count in (EXCHANGED, FAR, SAME, ORDER) if one.counts[count]} == ({name} if name else set())


def test_all_counts_have_a_concern():
    assert set(HANDS.values()) == {EXCHANGED, FAR, SAME, ORDER} and set(HANDS) <= set(CONCERNS)


def test_133_points_of_an_onnx_model_reach_their_landmarks(tmp_path):
    """Constant outputs in the form of RTMPose whole body, two bins per pixel. Points of the face are not used."""
    pytest.importorskip("onnxruntime", reason="the model needs onnxruntime")
    onnx = pytest.importorskip("onnx", reason="the model is built with the package onnx")
    one, graph = session("coco133"), Graph(onnx, onnx.TensorProto.FLOAT, ["batch", 3, 512, 640])
    pixels, ids, outputs = px(one, places(one, 0.0)), one.tracker.layout.ids, []
    for name, side, at in (("simcc_x", 640, pixels[:, 0]), ("simcc_y", 512, pixels[:, 1])):
        bins = np.zeros((1, 133, 2 * side))
        bins[0, ids, np.round(2 * at).astype(int)] = 0.8
        bins[0, 50, 100] = 0.9  # a point of the face
        outputs.append((name, graph.constant(bins), list(bins.shape)))
    detector = make_detector(graph.save(tmp_path / "whole_body.onnx", outputs))
    found = detector.detect(np.zeros((512, 640, 3), np.uint8), 0.0)
    assert (detector.landmarks, skeleton_of(detector.landmarks)) == ("coco133", "body_hands")
    keypoints = point_cloud2.decode(keypoint_message(BACKEND, 10**9, FRAME, found, detector.several))
    frame = one.process(keypoints, 7)
    assert frame.accepted and np.abs(frame.detected - pixels).max() <= 0.3 and frame.estimate.visible.all()
    assert one.process(replace(keypoints, stamp_ns=2 * 10**9, landmarks=17), 7).rejection == "other_layout"


def test_the_topic_of_hands_has_both_hands_in_their_axes():
    one = session()
    frame = one.process(Keypoints(10**9, FRAME, np.arange(75), px(one, places(one, 0.0)), np.ones(75)), 7)
    hands = HandPoints(one.tracker.skeleton, one.tracker.layout)
    messages = FrameMessages(BACKEND, one.tracker.skeleton, hands=hands)
    ((name, message),) = messages.build(frame, {topics.HANDS})
    cloud = points_of(message).reshape(2, 21)
    assert name == "~/hands" and (message.header.frame_id, message.header.stamp.sec) == (FRAME, 1)
    assert cloud["index"].tolist() == [list(range(21))] * 2 and cloud["side"].tolist() == [[0] * 21, [1] * 21]
    assert (cloud["observed"] == 1).all() and (cloud["person"] == 1).all()
    read = hands.read(frame.estimate.pose, frame.estimate.visible, frame.uncertainty)
    for row, hand, rows in zip(cloud, read, (LEFT, RIGHT)):
        xyz = np.stack([row[axis] for axis in "xyz"], axis=1)
        turn = from_quaternion(np.array([row[0][q] for q in ("qx", "qy", "qz", "qw")]))
        wrist = np.array([row[0][f"wrist_{axis}"] for axis in "xyz"])
        assert np.allclose(xyz @ turn.T + wrist, frame.estimate.pose.landmarks[rows], atol=1e-5)
        assert np.allclose(row["xy"], hand.covariance[:, 0, 1]) and np.allclose(row["zz"], hand.covariance[:, 2, 2])
        assert np.allclose(row["deviation"], np.sqrt(hand.covariance.trace(axis1=1, axis2=2)))
        assert np.allclose([row[0][f"ray_{axis}"] for axis in "xyz"], hand.ray)
        assert np.allclose(row["ray_deviation"], hand.ray_deviation)


def test_the_topic_says_a_gesture_while_it_is_held():
    """On ~/hands with its confidence, and as REP-155's message: it has pointing up, so the vertical is turned, too."""
    one, said, messages = session(), [], []
    hands, backend = HandPoints(one.tracker.skeleton, one.tracker.layout), RosbagsBackend(detector_types())
    builder = FrameMessages(backend, one.tracker.skeleton, config=NodeSettings(rep155=True), hands=hands)
    for i in range(12):
        pixels, confidence = px(one, places(one, 0.0, "right")), np.ones(75)
        confidence[33:54] = 0
        frame = one.process(Keypoints(round(1e9 * (1 + i / 30)), FRAME, np.arange(75), pixels, confidence), 7)
        (_, message), (name, gesture) = builder.build(frame, {topics.HANDS, topics.GESTURE})
        assert name == "~/gesture" and gesture.header == message.header
        messages.append((gesture.gesture, gesture.handedness))
        said.append(points_of(message).reshape(2, 21)[["gesture", "gesture_confidence"]][:, 0].tolist())
    left, right = zip(*said)
    assert set(left) == {(0, 0.0)} and right[0][0] == 0
    assert right[-1][0] == GESTURES.index("pointing") and 0.5 < right[-1][1] <= 1
    assert messages[0] == messages[-1] == (0, 1)  # the finger points aside
    finger = frame.estimate.pose.landmarks[RIGHT[[5, 8]]]
    up = np.diff(finger, axis=0)[0] / np.linalg.norm(np.diff(finger, axis=0))
    upwards = replace(frame.estimate, up=up, stamp=frame.estimate.stamp + 0.03)
    ((_, gesture),) = builder.build(replace(frame, estimate=upwards), {topics.GESTURE})
    assert (gesture.gesture, gesture.handedness) == (9, 1)


def test_a_body_without_hands_has_no_such_topic():
    one = Session(TrackerConfig(height=1.75), NodeSettings())
    messages = FrameMessages(BACKEND, one.tracker.skeleton, hands=HandPoints(one.tracker.skeleton, one.tracker.layout))
    assert topics.HANDS not in messages._builders
    assert {topics.HANDS, topics.GESTURE}.isdisjoint(topics.person_outputs(True))
    assert topics.GESTURE not in topics.person_outputs(False, hands=True)
