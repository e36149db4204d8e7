"""An offset between the stamps of a robot's camera and TF is found from people while the robot turns."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from camera_rig import MAP, keypoints, tf_of, truth_at, turning_eye
from messages import camera_info, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.camera_places import CameraPlaces
from lassokin_ros.pipeline.camera.tf_offset import TfOffset
from lassokin_ros.pipeline.concerns.live import of_cameras
from lassokin_ros.pipeline.concerns.period import Period
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

BACKEND, START_NS = rosbags_backend(), 1_700_000_000_000_000_000


def still(seconds):
    return np.array([0.3, 3.0, 1.0])


def walking(seconds):
    return np.array([1.0 * np.sin(0.9 * seconds), 3.0, 1.0 + 0.03 * np.sin(11 * seconds)])


def found(offset, person, pose_at=turning_eye("", 1.2).pose_at, seconds=16.0):
    """Return the offset of a camera whose stamps are too late by `offset`, s, and whether it is said."""
    places, random = CameraPlaces(MAP, ("",)), np.random.default_rng(0)
    check, eye = TfOffset(places), SimpleNamespace(pose_at=pose_at, frame="optical")
    for index in range(round(15 * seconds)):
        now = index / 15
        places.transforms.add(tf_of(BACKEND, eye, START_NS, now), static=False)
        inside = pose_at(now - 0.1).into_camera(person(now - 0.1)) + 0.01 * random.normal(size=3)  # TF is there before
        stamp_ns = START_NS + round(1e9 * (now - 0.1 + offset))
        places.at("", stamp_ns) if places.newest else places.pose("", "optical", START_NS)
        pose = SimpleNamespace(positions=np.array([inside]))
        frame = {"accepted": True, "images": (), "camera": CameraPose(), "label": "", "person": ""}
        check.update([SimpleNamespace(stamp_ns=stamp_ns, estimate=SimpleNamespace(pose=pose), **frame)])
    return check.of(""), check.clear("") is not None


@pytest.mark.parametrize(("person", "offset"), [(still, 0.0), (still, -0.06), (walking, 0.0), (walking, 0.12)])
def test_the_offset_is_found_from_people_who_stand_or_walk(offset, person):
    (seconds, deviation), said = found(offset, person)
    assert abs(seconds - offset) < min(0.02, 3 * deviation) and said == (offset != 0)


def test_a_robot_whose_camera_follows_a_person_late_shows_no_offset():
    def pose_at(seconds):
        x, y, _ = walking(seconds - 0.3)
        forward = np.array([x, y, 0.0]) / np.hypot(x, y)
        rotation = np.stack([np.cross([0.0, 0.0, -1.0], forward), [0.0, 0.0, -1.0], forward])
        return CameraPose("", rotation, -rotation @ np.array([0.0, 0.0, 1.2]))

    assert found(0.0, walking, pose_at) == (None, False)


def test_a_session_says_the_offset_in_ms():
    eye, random = turning_eye("", 1.2), np.random.default_rng(0)
    session = Session(TrackerConfig(height=1.75), NodeSettings(fixed_frame=MAP, wait=0.001))
    session.set_camera(camera_info(BACKEND, frame_id=eye.frame))
    for index in range(80):
        now = index / 7
        session.push_transforms(tf_of(BACKEND, eye, START_NS, now + 0.05))
        body = truth_at([now], still=True).landmarks[0]
        seen = keypoints(BACKEND, eye, START_NS, now, body, random)
        seen.header.stamp = tf_of(BACKEND, eye, START_NS, now + 0.05).transforms[0].header.stamp
        assert all(frame.accepted for frame in session.frames(seen, START_NS + round(1e9 * now) + 10**8))
    (said,) = [one for one in of_cameras(Period(session, 0.0), 0.0) if one.key == "tf_clock"]
    ms = re.match(r"while the camera turns, people move as if the stamps of its keypoints were (\d+) ms", said.text)
    assert 30 < int(ms[1]) < 70 and " too late for TF; nothing is changed: let the driver " in said.text
    session.reset()
    assert not [one for one in of_cameras(Period(session, 0.0), 0.0) if one.key == "tf_clock"]
