"""Serialised messages: they are equal to the messages, frame by frame, for all changes between frames."""

from importlib.util import find_spec

import numpy as np
import pytest
from messages import camera_info, cloud, pixels_of_motion, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.outputs.topics import CERTIFICATE
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import ALL, OFF, NodeSettings
from msg_adapters.backends import RclpyBackend, RosbagsBackend
from msg_adapters.output_messages.builders import JointStateBuilder, PointStampedBuilder
from msg_adapters.output_messages.serialised_messages import MOST_TEMPLATES, SerialisedMessage

BACKENDS = [rosbags_backend(), *([RclpyBackend()] if find_spec("rclpy") else [])]
START_NS = 10**12


@pytest.fixture(params=BACKENDS, ids=lambda b: type(b).__name__)
def backend(request):
    return request.param


def test_every_serialised_output_equals_its_message(backend):
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(backend))
    tf = ALL if isinstance(backend, RosbagsBackend) else OFF  # rclpy's tf2_msgs may be missing
    settings = {"config": NodeSettings(publish_tf=tf)}
    messages, ready = (FrameMessages(backend, session.tracker.skeleton, serialised=r, **settings) for r in (0, 1))
    for i, xy in enumerate(pixels_of_motion(12)):
        confidence = np.full(17, 0.9)
        confidence[: i % 4] = 0  # so that the number of crosses changes
        stamp = START_NS + i * 16_666_667
        frame = session.process(cloud(backend, stamp, xy, confidence, frame_id="camera" + "_x" * (i // 5)), 0)
        for (topic, message), (same_topic, serialised) in zip(messages.build(frame), ready.build(frame)):
            assert topic == same_topic
            if topic == CERTIFICATE:  # its texts change their lengths
                serialised = backend.serialise(serialised)
            assert isinstance(serialised, bytes), topic
            assert backend.alike(serialised, message), topic


def test_other_numbers_stamps_or_frames_give_other_bytes(backend):
    message, point = PointStampedBuilder(backend), np.array([1.0, 2.0, 3.0])
    serialised = backend.serialise(message.fill(START_NS, "a", point))
    assert backend.alike(serialised, message.fill(START_NS, "a", point))
    assert not backend.alike(serialised[:-8], message.fill(START_NS, "a", point))
    for other in ((START_NS + 1, "a", point), (START_NS, "b", point), (START_NS, "a", point + 1e-9)):
        assert not backend.alike(serialised, message.fill(*other))


def test_a_strict_reader_accepts_the_middlewares_bytes():
    """joint_states ends with an empty sequence of doubles."""
    pytest.importorskip("rclpy")
    backend, typestore = RclpyBackend(), rosbags_backend()._typestore
    for names in (["a"], ["a", "b"], ["a", "b", "long"]):
        numbers = np.arange(float(len(names)))
        for frame_id in ("", "c", "ca", "cam", "came", "camer", "camera"):
            ready = SerialisedMessage(JointStateBuilder(backend, names), backend)
            serialised = ready.fill(START_NS, frame_id, numbers, numbers)
            read = typestore.deserialize_cdr(serialised, "sensor_msgs/msg/JointState")
            assert read.header.frame_id == frame_id and read.position.tolist() == read.velocity.tolist() == [*numbers]


class Otherwise(RosbagsBackend):
    """A middleware whose serialised messages have another memory layout."""

    def serialise(self, message):
        return super().serialise(message)[::-1]


def test_an_unknown_memory_layout_falls_back_to_the_message():
    backend = Otherwise(rosbags_backend()._typestore)
    builder = JointStateBuilder(backend, ["a", "b"])
    for i in range(2):
        serialised = SerialisedMessage(builder, backend)
        message = serialised.fill(START_NS + i, "camera", np.array([1.0, i]), np.array([3.0, 4.0]))
        assert list(message.position) == [1.0, i] and message.header.stamp.nanosec == i


def test_the_places_are_learned_once_for_each_form_of_a_message():
    backend = rosbags_backend()
    ready, learned = SerialisedMessage(JointStateBuilder(backend, ["a"]), backend), []
    learn = ready._learn
    ready._learn = lambda stamp_ns, frame_id, numbers: learned.append(frame_id) or learn(stamp_ns, frame_id, numbers)
    for i in range(3):
        for frame_id in ("camera", "another"):
            ready.fill(START_NS + i, frame_id, np.array([1.0]), np.array([i]))
    assert learned == ["camera", "another"]


def test_changing_frame_ids_use_bounded_memory():
    backend = rosbags_backend()
    ready = SerialisedMessage(PointStampedBuilder(backend), backend)
    for i in range(3 * MOST_TEMPLATES):
        serialised = ready.fill(START_NS, f"camera{i}", np.array([1.0, 2.0, i]))
        read = backend._typestore.deserialize_cdr(serialised, "geometry_msgs/msg/PointStamped")
        assert (read.header.frame_id, read.point.z) == (f"camera{i}", i)
    assert len(ready._templates) <= MOST_TEMPLATES
