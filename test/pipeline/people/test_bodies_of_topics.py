"""Bodies with topics of their own: who comes and leaves with the detector's list, without any message."""

from dataclasses import replace

import numpy as np
import pytest
from depth_camera import depth_message
from messages import rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.people.presence import Presence
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

CONFIG = NodeSettings(rep155=True, max_people=2, keypoints_type="hri_msgs/msg/Skeleton2D")


@pytest.fixture
def bodies():
    return Session(TrackerConfig(height=1.75), CONFIG)


def test_people_are_those_of_the_list(bodies):
    assert bodies.ids == [] and bodies.status is Status.SEARCHING and bodies.config == CONFIG
    bodies.keep(["a", "b", "a"])
    assert bodies.ids == ["a", "b"] and list(bodies.calibrations()) == ["a", "b"]
    assert bodies.counts == {"people come": 2}
    bodies.keep(["b"])
    assert bodies.ids == ["b"] and bodies.counts == {"people come": 2, "people left": 1}
    assert bodies.scene.presence_at(10**9) == Presence(Status.SEARCHING, ["b"])


def test_of_too_many_the_first_are_kept(bodies):
    bodies.keep(["a", "b", "c", "d"])
    assert bodies.ids == ["a", "b"] and bodies.counts["people beyond max_people"] == 2
    bodies.keep(["d", "b"])
    assert bodies.ids == ["b", "d"]


def test_the_best_status_of_the_bodies(bodies):
    bodies.keep(["a", "b"])
    bodies.people.tracked["a"].status, bodies.people.tracked["b"].status = Status.LOST, Status.TRACKING
    assert bodies.status is Status.TRACKING
    bodies.people.tracked["b"].status = Status.SEARCHING
    assert bodies.status is Status.LOST


def test_messages_of_somebody_who_is_not_listed_are_dropped(bodies):
    assert bodies.frames(object(), 5, body="nobody") == [] and not bodies.counts


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
    assert bodies.trackers["a"].config.noise_px == 5.0 and bodies.inputs.streams["a"].config.forget_after == 1.5
    bodies.tune(replace(TrackerConfig(), height=1.5), CONFIG)
    assert bodies.counts["resets"] == 2
    assert all(one.tracker.skeleton.height == 1.5 for one in bodies._trackable) and bodies.ids == ["a"]


def test_depth_images_stay_when_somebody_leaves():
    bodies = Session(TrackerConfig(height=1.75), replace(CONFIG, depth="/depth"))
    bodies.keep(["a", "b"])
    bodies.first.depth.add(depth_message(rosbags_backend(), 5_000_000_000, np.full((4, 6), 2.0)), 5_000_000_000)
    bodies.keep(["b"])
    assert bodies.first.depth.newest_ns == 5_000_000_000
    bodies.reset()
    assert bodies.first.depth.newest_ns is None
