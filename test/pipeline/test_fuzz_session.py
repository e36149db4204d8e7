"""Bad messages among good ones, through the whole session: tracking continues with the next good frame.

After a rejected message the next good frame is bitwise the same. An accepted message (random data may look like a
person) has an effect; after it the person is still tracked, certified and near the truth.
"""

import functools

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from faults.courses import (  # noqa: E402
    ARRAY,
    CLOUD,
    FRAMES,
    HRI,
    POLYGON,
    START_NS,
    TYPES,
    YOLO,
    ZED,
    Course,
    over_the_wire,
    stamp_of,
)
from faults.damage import STEP_NS, WAYS, spoil  # noqa: E402
from faults.fuzzing import count, fuzz  # noqa: E402
from messages import camera_info  # noqa: E402

from lassokin_ros.pipeline.outputs.outputs import LINK_AS_FRAME  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.replay.playback import NodeMessages, Playback  # noqa: E402

INFO = "sensor_msgs/msg/CameraInfo"
COURSES = {
    "one person, PointCloud2": (CLOUD, False, "message", 0.06),
    "one person, PolygonStamped": (POLYGON, False, "message", 0.03),
    "one person, Float32MultiArray": (ARRAY, False, "message", 0.03),
    "one person, hri": (HRI, False, "message", 0.03),
    "one person, yolo": (YOLO, False, "message", 0.03),
    "one person, zed": (ZED, False, "message", 0.03),
    "two people, PointCloud2": (CLOUD, True, "message", 0.05),
    "two people told apart here": (CLOUD, True, "node", 0.04),
    "two people, yolo": (YOLO, True, "message", 0.02),
    "two people, zed": (ZED, True, "message", 0.02),
}


FILTERED = ("too_few_landmarks", "person_absent", "not_certified", "too_small")
"""Reasons that the tracker may give after it has processed the points."""


def faults(message_type):
    """Up to three kinds of damage; the seed of their draws; good frames before, none in one case of ten."""
    ways = st.lists(st.sampled_from(sorted(WAYS[message_type])), min_size=1, max_size=3)
    before = st.sampled_from([0, *[None] * 9])
    return st.tuples(ways, st.integers(0, 2**32 - 1), before)


def prepared(course, before):
    """Advance the course to the place of the bad message: the start, or a later frame."""
    if before == 0 or course.index > FRAMES - 6:
        course.restart()
    course.lead_in(before if before is not None else max(course.index, 4))


def after(name, course, frames):
    """Check the properties that must hold after the answer to a bad message."""
    index = course.index
    if frames and not frames[0].accepted:
        if index >= 4 and frames[0].rejection in FILTERED:
            course.same_or_tracked()
        else:
            course.same_as_ever()
        count(name, frames[0].rejection)
        return
    for frame in frames:
        assert not frame.accepted or frame.estimate.increment.solution.certified
    if index >= 4:
        answers = [course.send_good() for _ in range(2)]
        assert course.tracked(answers[-1], index + 1), [f.detail for frames in answers for f in frames]
    course.restart()
    count(name, "taken" if frames else "taken, nobody in it")


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("name", list(COURSES))
def test_no_message_prevents_tracking_of_the_next_good_frame(name):
    message_type, several, person_ids, share = COURSES[name]
    course = Course(message_type, several, person_ids)

    @fuzz(share)
    @given(faults(message_type))
    def case(fault):
        ways, seed, before = fault
        try:
            prepared(course, before)
            now_ns = stamp_of(course.index) - STEP_NS // 3
            message = spoil(message_type, course.good(course.index), ways, seed, now_ns)
            if "stamp" not in ways and message_type != ARRAY:
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(now_ns, 10**9)
            frames = course.session.frames(over_the_wire(message_type, message), now_ns)
            after(name, course, frames)
        except BaseException:
            course.start_anew()  # results of a failure are not used for the next case
            raise

    case()


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("rectified", [False, True], ids=["raw", "rectified"])
def test_no_camera_info_prevents_tracking_of_the_next_good_frame(rectified):
    course = Course(CLOUD, rectified=rectified)
    name = "camera_info in the session" + ", rectified" * rectified

    @fuzz(0.03)
    @given(faults(INFO))
    def case(fault):
        ways, seed, before = fault
        try:
            prepared(course, before)
            message = over_the_wire(INFO, spoil(INFO, camera_info(course.backend), ways, seed, stamp_of(course.index)))
            reason = course.session.set_camera(message)
            if reason is not None:
                course.same_as_ever()
            else:  # another, valid camera; with the right one again everything is as before
                course.session.frames(course.good(course.index), stamp_of(course.index))
                course.restart()
                course.same_as_ever()
            count(name, reason or "taken")
        except BaseException:
            course.start_anew()
            raise

    case()


def played(course):
    """A playback, and the serialised messages that it writes by topic."""
    written = {}

    def write(topic, kind, time_ns, message, latched):
        written[topic] = message if isinstance(message, bytes) else TYPES.serialize_cdr(message, kind)

    session = Session(*course.settings)
    return Playback(session, NodeMessages(session, TYPES, write)), written


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_outputs_can_be_serialised_for_any_input():
    """Messages and camera_info of any kind, one after another, through the replay's tracker: the outputs are valid
    messages.
    """
    course = Course(CLOUD)
    tracker, written = played(course)
    clock = iter(range(START_NS, 2**63, STEP_NS))

    @fuzz(0.05)
    @given(faults(CLOUD), faults(INFO), st.sampled_from(["keypoints", "camera_info", "good", "unreadable"]))
    def case(fault, camera_fault, kind):
        now_ns = next(clock)
        index = (now_ns - START_NS) // STEP_NS % FRAMES
        message = course.good(index)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now_ns, 10**9)
        if kind == "camera_info":
            camera = spoil(INFO, camera_info(course.backend), *camera_fault[:2], now_ns)
            tracker.camera_info(camera, now_ns)
            tracker.camera_info(course.camera, now_ns)
        elif kind == "unreadable":
            tracker.camera_info(None, now_ns)
            tracker.keypoints(None, now_ns)
        else:
            if kind == "keypoints":
                message = spoil(CLOUD, message, *fault[:2], now_ns)
            tracker.keypoints(over_the_wire(CLOUD, message), now_ns)
        count("outputs", f"{kind}: {'some' if written else 'none'}")
        written.clear()

    case()


@pytest.mark.parametrize("name", ["tracker/head", "tracker/left_knee_x_link", "tracker/root_x_link"])
def test_a_frame_id_that_is_a_links_name_stops_no_output(name):
    course = Course(CLOUD)
    tracker, written = played(course)
    tracker.camera_info(course.camera, START_NS)
    written.clear()
    tracker.keypoints(course.good(0), stamp_of(0))
    usual = set(written)
    written.clear()
    message = course.good(1)
    message.header.frame_id = name
    tracker.keypoints(message, stamp_of(1))
    assert set(written) == usual - {"/tracker/robot_description", "/tracker/state"}  # both as before
    joints = TYPES.deserialize_cdr(written["/tracker/joints"], "geometry_msgs/msg/PoseArray")
    assert joints.header.frame_id == name
    assert tracker.session.counts[LINK_AS_FRAME] == 1


def test_the_comparison_of_bytes_detects_a_small_change():
    """The comparison detects a frame that is changed a little."""
    course = Course(CLOUD)
    course.lead_in(5)
    course.send_good = functools.partial(course.session.frames, course.good(6), stamp_of(5))
    with pytest.raises(AssertionError, match="frame 5 differs"):
        course.same_as_ever()
