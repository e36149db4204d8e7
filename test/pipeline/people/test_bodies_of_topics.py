"""Bodies with topics of their own: who comes and leaves with the detector's list, without any message."""

from dataclasses import replace

import numpy as np
import pytest
from depth_camera import depth_message
from messages import FRAME, HEIGHT, WIDTH, camera_info, pixels_of_motion, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.keypoints import Keypoints

BACKEND = rosbags_backend()
PIXELS = pixels_of_motion(1)[0]
CONFIG = NodeSettings(rep155=True, max_people=2, keypoints_type="hri_msgs/msg/Skeleton2D")


@pytest.fixture
def bodies():
    return Session(TrackerConfig(height=1.75), CONFIG)


def test_all_share_the_camera_and_have_stamps_of_their_own(bodies):
    bodies.keep(["a", "b"])
    one, two = bodies.inputs.streams.values()
    assert one.camera is two.camera is bodies.first.camera and one.counts is two.counts is bodies.counts
    assert one.stamps is not two.stamps
    bodies.keep(["b"])
    assert list(bodies.inputs.streams.values()) == [two]


def test_reset_and_settings_count_once_and_reach_all(bodies):
    bodies.reset()
    assert bodies.counts["resets"] == 1
    bodies.keep(["a"])
    bodies.tune(replace(TrackerConfig(height=1.75), noise_px=5.0), replace(CONFIG, forget_after=1.5))
    assert bodies.counts["resets"] == 1 and bodies.config.forget_after == 1.5 and bodies.config.max_people == 2
    assert bodies.roster.trackers["a"].config.noise_px == 5.0 and bodies.roster.config.forget_after == 1.5
    bodies.tune(replace(TrackerConfig(), height=1.5), CONFIG)
    assert bodies.counts["resets"] == 2
    assert all(one.tracker.skeleton.height == 1.5 for one in bodies.roster.bodies) and bodies.roster.ids == ["a"]


def test_depth_images_stay_when_somebody_leaves():
    bodies = Session(TrackerConfig(height=1.75), replace(CONFIG, depth="/depth"))
    bodies.keep(["a", "b"])
    bodies.first.depth.add(depth_message(BACKEND, 5_000_000_000, np.full((4, 6), 2.0)), 5_000_000_000)
    bodies.keep(["b"])
    assert bodies.first.depth.newest_ns == 5_000_000_000
    bodies.reset()
    assert bodies.first.depth.newest_ns is None


def test_one_depth_image_or_the_end_of_the_wait_releases_the_messages_of_all_bodies():
    bodies = Session(TrackerConfig(height=1.75), replace(CONFIG, depth="/depth"))
    bodies.set_camera(camera_info(BACKEND))
    bodies.keep(["a", "b", "c"])

    def sent_and_waiting(stamp_ns):
        for body in "a", "b":
            message = Keypoints(stamp_ns, FRAME, np.arange(len(PIXELS)), PIXELS, np.ones(len(PIXELS)))
            assert bodies.push(message, stamp_ns, body=body) == []

    def image(stamp_ns, late_ns=0):
        depth = depth_message(BACKEND, stamp_ns, np.full((HEIGHT // 4, WIDTH // 4), 3.0))
        answers = bodies.push_depth(depth, stamp_ns + late_ns)
        return [(one.stamp_ns, [frame.person for frame in one.frames]) for one in answers]

    start_ns, period_ns = 5_000_000_000, 33_333_333
    assert image(start_ns) == image(start_ns + period_ns) == []  # from now on the period is known
    for_a_third, for_a_fourth = start_ns + 2 * period_ns, start_ns + 3 * period_ns
    sent_and_waiting(for_a_third)
    assert image(for_a_third, late_ns=1_000_000) == [(for_a_third, ["a"]), (for_a_third, ["b"])]
    sent_and_waiting(for_a_fourth)
    assert bodies.due_at_ns is not None and bodies.due(bodies.due_at_ns - 1) == []
    assert [one.stamp_ns for one in bodies.due(bodies.due_at_ns)] == [for_a_fourth, for_a_fourth]
    assert bodies.due_at_ns is None and bodies.finish() == []
