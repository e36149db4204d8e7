"""`cameras` with a single name: the same results and topics as of a camera without a name."""

import numpy as np
from depth_camera import depth_message, render
from detector_messages import HRI, detector_types, hri_skeleton
from messages import FRAME, HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion, rosbags_backend

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.demo.synthetic import motion
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.backends import RosbagsBackend

BACKEND, START_NS, PERIOD_NS = rosbags_backend(), 1_700_000_000_000_000_000, 33_333_333


def made(frame_id=FRAME, **settings):
    result = Session(TrackerConfig(height=1.75), NodeSettings(**settings))
    assert result.set_camera(camera_info(BACKEND, frame_id=frame_id), result.first.name) is None
    return result


def test_it_gives_the_results_and_the_topics_of_a_camera_without_a_name():
    pixels, found = pixels_of_motion(5), []
    for name in ("", "left"):
        session = made(cameras=(name,))
        messages = FrameMessages(BACKEND, session.tracker.skeleton, config=session.config)
        for index in range(5):
            stamp_ns = START_NS + index * PERIOD_NS
            (frame,) = session.frames(cloud(BACKEND, stamp_ns, pixels[index]), stamp_ns, name)
        found.append((frame.positions, frame.frame_id, [topic for topic, _ in messages.build(frame)]))
    assert np.array_equal(found[0][0], found[1][0]) and found[0][1:] == found[1][1:]


def test_its_depth_images_are_compared_with_the_person():
    session = made(cameras=("left",), depth="depth")
    skeleton = Skeleton.load("anthropometric", 1.75)
    pose = Kinematics(skeleton, Layout.load("coco17", skeleton)).pose(motion(skeleton, np.zeros(1)))
    image = depth_message(BACKEND, START_NS, render(skeleton, pose.positions[0]))
    session.cameras["left"].depth.add(image, START_NS)
    (frame,) = session.frames(cloud(BACKEND, START_NS, pixels_of_motion(1)[0]), START_NS, "left")
    assert frame.accepted and frame.estimate.frame.depth_measured
    assert session.cameras["left"].depth.check._frames == 1


def test_it_sees_bodies_with_a_topic_each():
    backend = RosbagsBackend(detector_types())
    config = NodeSettings(cameras=("left",), keypoints_type=HRI, rep155=True, max_people=2)
    session = Session(TrackerConfig(height=1.75, landmarks="hri18"), config)
    assert session.set_camera(camera_info(BACKEND), "left") is None
    session.keep(["abc"])
    pixels = pixels_of_motion(1, layout="hri18")[0]
    message = hri_skeleton(backend, START_NS, FRAME, pixels, np.full(18, 0.9), (WIDTH, HEIGHT))
    (frame,) = session.frames(message, START_NS, body="abc")
    assert frame.accepted and frame.person == "abc"
