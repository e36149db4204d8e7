"""Messages as bytes: they say what the messages do, frame by frame, whatever changes between frames."""

from importlib.util import find_spec

import numpy as np
import pytest
from messages import camera_info, cloud, pixels_of_motion, rosbags_backend

from lassokin_ros import topics
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.frame_messages import FrameMessages
from lassokin_ros.node_config import NodeConfig
from lassokin_ros.pipeline import Pipeline
from msg_adapters.backends import RclpyBackend, RosbagsBackend
from msg_adapters.outputs import JointStateBuilder, PointStampedBuilder
from msg_adapters.ready_made import MOST_TEMPLATES, ReadyMade

BACKENDS = [rosbags_backend(), *([RclpyBackend()] if find_spec("rclpy") else [])]
START_NS = 10**12


@pytest.fixture(params=BACKENDS, ids=lambda b: type(b).__name__)
def backend(request):
    return request.param


def test_every_output_says_the_same_as_its_message(backend):
    pipeline = Pipeline(TrackerConfig(), NodeConfig())
    pipeline.set_camera(camera_info(backend))
    settings = {"tf": isinstance(backend, RosbagsBackend)}  # rclpy's tf2_msgs is not always there
    messages, ready = (FrameMessages(backend, pipeline.tracker.skeleton, ready_made=r, **settings) for r in (0, 1))
    for i, xy in enumerate(pixels_of_motion(12)):
        confidence = np.full(17, 0.9)
        confidence[: i % 4] = 0  # so that there are more and fewer crosses
        stamp = START_NS + i * 16_666_667
        frame = pipeline.process(cloud(backend, stamp, xy, confidence, frame_id="camera" + "_x" * (i // 5)), 0)
        for (topic, message), (same_topic, serialised) in zip(messages.build(frame), ready.build(frame)):
            assert topic == same_topic
            if topic != topics.CERTIFICATE:  # text: every frame is of another length
                assert isinstance(serialised, bytes), topic
                assert backend.alike(serialised, message), topic


def test_bytes_of_other_numbers_stamps_or_frames_are_told_apart(backend):
    message, point = PointStampedBuilder(backend), np.array([1.0, 2.0, 3.0])
    serialised = backend.serialise(message.fill(START_NS, "a", point))
    assert backend.alike(serialised, message.fill(START_NS, "a", point))
    for other in ((START_NS + 1, "a", point), (START_NS, "b", point), (START_NS, "a", point + 1e-9)):
        assert not backend.alike(serialised, message.fill(*other))


class Otherwise(RosbagsBackend):
    """A middleware whose serialised messages are not laid out as is thought here."""

    def serialise(self, message):
        return super().serialise(message)[::-1]


def test_where_the_places_are_not_found_the_message_itself_is_given():
    backend = Otherwise(rosbags_backend()._typestore)
    builder = JointStateBuilder(backend, ["a", "b"])
    for i in range(2):
        message = ReadyMade(builder, backend).fill(START_NS + i, "camera", np.array([1.0, i]), np.array([3.0, 4.0]))
        assert list(message.position) == [1.0, i] and message.header.stamp.nanosec == i


def test_a_frame_id_that_is_always_another_takes_no_memory_without_end():
    backend = rosbags_backend()
    ready = ReadyMade(PointStampedBuilder(backend), backend)
    for i in range(3 * MOST_TEMPLATES):
        serialised = ready.fill(START_NS, f"camera{i}", np.array([1.0, 2.0, i]))
        read = backend._typestore.deserialize_cdr(serialised, "geometry_msgs/msg/PointStamped")
        assert (read.header.frame_id, read.point.z) == (f"camera{i}", i)
    assert len(ready._templates) <= MOST_TEMPLATES
