"""The pipeline without middleware, and its messages made for rclpy and for rosbags."""

import numpy as np
import pytest
from messages import FRAME, camera_info, cloud, pixels_of_motion, rosbags_backend

from lassokin_ros import topics
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.frame_messages import FrameMessages
from lassokin_ros.node_config import NodeConfig
from lassokin_ros.pipeline import Pipeline
from msg_adapters.backends import RclpyBackend

pytest.importorskip("rosbags")
START_NS, PERIOD_NS = 5_000_000_000, 16_666_667
PIXELS = pixels_of_motion(30)


@pytest.fixture
def pipeline():
    result = Pipeline(TrackerConfig(), NodeConfig())
    result.set_camera(camera_info(BACKEND))
    return result


BACKEND = rosbags_backend()


def frame(pipeline, index, stamp_ns=None, **options):
    stamp_ns = START_NS + index * PERIOD_NS if stamp_ns is None else stamp_ns
    return pipeline.process(cloud(BACKEND, stamp_ns, PIXELS[index % 30], **options), 7)


def as_plain(message):
    """A message as nested lists and dictionaries, whichever library made it."""
    if hasattr(message, "__slots__") or hasattr(message, "__dataclass_fields__"):
        names = getattr(message, "__dataclass_fields__", None) or message.get_fields_and_field_types()
        return {n: as_plain(getattr(message, n)) for n in names if n == n.lower() and not n.startswith("__")}
    if isinstance(message, bytes):
        return message[0]
    if isinstance(message, (str, int, float, bool)):
        return message
    return (
        [as_plain(item) for item in np.asarray(message).tolist()]
        if not isinstance(message, list)
        else [*map(as_plain, message)]
    )


def test_both_backends_say_the_same(pipeline):
    pytest.importorskip("rclpy")
    tracked = [frame(pipeline, i) for i in range(3)][-1]
    skeleton = pipeline.tracker.skeleton
    ours, theirs = (dict(FrameMessages(b, skeleton).build(tracked)) for b in (RclpyBackend(), BACKEND))
    assert list(ours) == list(theirs) == [topic.name for topic in topics.FRAME_OUTPUTS]
    for name in ours:
        assert as_plain(ours[name]) == as_plain(theirs[name]), name


def test_only_what_is_wanted_is_made(pipeline):
    tracked = frame(pipeline, 0)
    messages = FrameMessages(BACKEND, pipeline.tracker.skeleton)
    assert [t for t, _ in messages.build(tracked, lambda topic: topic == topics.JOINTS)] == [topics.JOINTS]
    assert list(messages.build(frame(pipeline, 0))) == []  # a repeated stamp: rejected


def test_stamps_and_frames(pipeline):
    first = frame(pipeline, 0)
    assert (first.stamp_ns, first.frame_id, first.accepted) == (START_NS, FRAME, True)
    assert frame(pipeline, 0).rejection == "old_stamp"
    assert frame(pipeline, 0, stamp_ns=START_NS - 400_000_000).rejection == "old_stamp"
    assert pipeline.counts["resets"] == 0
    again = frame(pipeline, 0, stamp_ns=START_NS - 600_000_000)
    assert again.accepted and again.estimate.initialised and pipeline.counts["resets"] == 1


def test_a_stamp_of_zero_is_the_time_of_arrival(pipeline):
    assert frame(pipeline, 0, stamp_ns=0).stamp_ns == 7
    assert pipeline.counts["unstamped"] == 1


def test_the_frame_of_the_camera_stands_in_for_a_missing_one(pipeline):
    assert frame(pipeline, 0, frame_id="").frame_id == FRAME


def test_a_looped_bag_gives_the_same_bytes(pipeline):
    rounds = [[frame(pipeline, i, START_NS + i * 33_333_333) for i in range(30)] for _ in range(2)]
    for once, again in zip(*rounds):
        assert np.array_equal(once.positions, again.positions)
        assert np.array_equal(once.velocities, again.velocities)


def test_a_new_camera_is_used_from_the_next_frame_on(pipeline):
    near = frame(pipeline, 0).estimate.state.translation[2]
    pipeline.reset()
    assert pipeline.set_camera(camera_info(BACKEND, focal=1200.0)) is None
    assert frame(pipeline, 1).estimate.state.translation[2] == pytest.approx(2 * near, rel=0.2)


def test_a_refused_camera_is_counted_each_time_and_the_good_one_stays(pipeline):
    for _ in range(3):
        assert pipeline.set_camera(camera_info(BACKEND, k=np.zeros(9))) == "camera_uncalibrated"
    assert pipeline.counts["rejected: camera_uncalibrated"] == 3
    assert frame(pipeline, 0).accepted
    assert pipeline.set_camera(camera_info(BACKEND)) is None and pipeline.camera_fault == ""


def test_one_of_several_people_is_followed_until_lost(pipeline):
    def two_people(index, first_confidence):
        from messages import CLOUD_DTYPE, CLOUD_FIELDS, raw_cloud

        dtype = np.dtype([*CLOUD_DTYPE.descr, ("person", "<i4")])
        points = np.zeros(34, dtype)
        points["x"], points["y"] = np.concatenate([PIXELS[index], PIXELS[index] + [150, 0]]).T
        points["id"] = np.tile(np.arange(17), 2)
        points["person"] = np.repeat([4, 9], 17)
        points["confidence"] = np.repeat([first_confidence, 0.8], 17)
        fields = (*CLOUD_FIELDS, ("person", 16, 5))
        return raw_cloud(BACKEND, START_NS + index * PERIOD_NS, points.tobytes(), fields, 20, 34)

    x = [pipeline.process(two_people(i, c), 0).estimate.state.translation[0] for i, c in enumerate((0.5, 0.9, 0.9))]
    assert min(x) > 0.5  # person 9 stands to the right, and stays the one when the other becomes the surer
