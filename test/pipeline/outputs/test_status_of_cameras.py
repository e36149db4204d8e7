"""The status of several cameras, and of one in a fixed frame: each camera is judged by itself, and named."""

from types import SimpleNamespace

import numpy as np
import pytest
from camera_rig import LEFT, MAP, RIGHT, START_NS, Eye, Play, keypoints, tf_of, truth_at
from depth_camera import depth_message
from messages import camera_info, crowd, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.concerns.catalogue import PROBLEM, Raised
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.output_messages.builders import ERROR, OK, WARN

BACKEND = rosbags_backend()
HZ = 30
EYES = {"left": LEFT, "right": RIGHT}
TRUTH = truth_at(np.arange(HZ) / HZ)


class Scene(Play):
    """Cameras with static transforms; the status after each second."""

    def __init__(self, eyes=EYES, late=0.0, px=None, **settings):
        settings = NodeSettings(cameras=tuple(eyes), fixed_frame=MAP, **settings)
        super().__init__(list(eyes.values()), settings, late=late, px=px)
        for one in self.eyes:
            self.session.placement.transforms.add(tf_of(BACKEND, one, START_NS, 0.0), static=True)
        self.seconds = 0

    def second(self, sends=lambda name, index: True):
        """sends: whether a camera sends an image."""
        silent = lambda number, seconds: not sends(self.names[number], round(HZ * seconds))  # noqa: E731
        self.run(1.0, HZ, tf=False, silent=silent, begin=self.seconds)
        self.seconds += 1
        return self.line(self.seconds)


def test_a_camera_that_never_sends_is_reported():
    scene = Scene()
    lines = [scene.second(sends=lambda name, _: name == "left") for _ in range(4)]
    assert [line.level for line in lines] == [OK, OK, WARN, WARN]
    assert "no keypoints of camera 'right' for more than 2 s" in lines[-1].message


def test_a_camera_that_sends_nothing_while_nobody_is_in_view_is_no_warning():
    scene = Scene(silent_when_empty=True)
    lines = [scene.second(sends=lambda name, _: name == "left") for _ in range(4)]
    assert [line.level for line in lines] == [OK] * 4
    scene.session.scene.detector_connected = False
    assert "no keypoints of camera 'right'" in scene.second(sends=lambda name, _: name == "left").message


def test_nobody_is_in_view_of_the_cameras_that_send():
    session = Scene().session
    assert not session.inputs.nobody_in_view
    session.frames(crowd(BACKEND, START_NS, [], [], frame_id="left_optical"), START_NS, "left")
    assert session.inputs.nobody_in_view
    session.frames(
        keypoints(BACKEND, EYES["right"], START_NS, 0, TRUTH.landmarks[0], np.random.default_rng(0)), START_NS, "right"
    )
    assert not session.inputs.nobody_in_view
    for later_ns, right_is_silent in ((399_000_000, False), (401_000_000, True)):  # stale_after is 0.4 s
        later_ns += START_NS
        session.frames(crowd(BACKEND, later_ns, [], [], frame_id="left_optical"), later_ns, "left")
        assert session.inputs.nobody_in_view is right_is_silent


def test_nobody_is_in_view_of_the_camera_that_still_sends_after_simulated_time_jumped_back():
    scene = Scene()
    scene.second()
    assert not scene.session.inputs.nobody_in_view
    scene.session.reset()
    early_ns = START_NS - 90 * 10**9
    scene.session.frames(crowd(BACKEND, early_ns, [], [], frame_id="left_optical"), early_ns, "left")
    assert scene.session.inputs.nobody_in_view


def test_an_old_recording_of_cameras_with_different_rates_has_one_clock():
    scene = Scene(late=30 * 86400.0)
    lines = [scene.second(sends=lambda name, index: name == "left" or index % 2 == 0) for _ in range(3)]
    assert not any("arrive" in line.message for line in lines)
    jumped = [scene.session.cameras[name].stamps.delay_s for name in EYES]
    assert jumped == pytest.approx([30 * 86400.0] * 2)
    scene.session.reset()
    assert [scene.session.cameras[name].stamps.delay_s for name in EYES] == [None, None]


def test_an_odd_camera_info_is_that_of_its_camera(name="right"):
    scene = Scene()
    odd = np.array([600.0, 0, 330, 0, 480, 250, 0, 0, 1])
    assert scene.session.set_camera(camera_info(BACKEND, frame_id=EYES[name].frame, k=odd), name) is None
    line = scene.second()
    assert line.level == WARN and f"camera '{name}': camera_info has fx = 600, fy = 480" in line.message


def test_a_camera_without_depth_images_is_named(name="right"):
    scene = Scene(depth="depth")
    for index in range(HZ):
        stamp_ns = START_NS + round(1e9 * index / HZ)
        message = depth_message(BACKEND, stamp_ns, 3.2 + 0.01 * scene.random.normal(size=(48, 64)), EYES["left"].frame)
        scene.session.cameras["left"].depth.add(message, stamp_ns)
    line = scene.second()
    assert f"camera '{name}': no depth images on {name}/depth" in line.message and line.message.count("no depth") == 1


def test_keypoints_outside_the_image_are_those_of_their_camera(name="right"):
    """Half of all messages: those of one camera."""
    scene = Scene(px={1: 900.0})
    info = camera_info(BACKEND, frame_id=EYES[name].frame, width=800, height=600)
    scene.session.set_camera(info, name)
    line = scene.second()
    assert f"camera '{name}': keypoints lie outside the image of 800 x 600 px" in line.message
    assert line.message.count("outside the image") == 1


def test_the_unit_of_the_stamps_and_first_ids_are_checked_for_each_camera():
    scene = Scene()
    for text in ("stamp_rate", "own_depth", "landmark_ids"):
        odd = {"concern": Raised("remark", PROBLEM, f"odd {text}"), "add": lambda *_: None}
        owner = scene.session.cameras["right"]
        owner, name = (owner.stamps, "rate") if text == "stamp_rate" else (owner, text)
        setattr(owner, name, SimpleNamespace(**odd))
    scene.session.cameras["right"].own_depth.checked = lambda keypoints, _: keypoints
    message = scene.second().message
    assert all(f"camera 'right': odd {text}" in message for text in ("stamp_rate", "own_depth", "landmark_ids"))


def test_a_refused_camera_info_is_named_and_the_last_good_one_only_if_there_is_one():
    session = Session(TrackerConfig(height=1.75), NodeSettings(cameras=("left", "right"), fixed_frame=MAP))
    diagnostics = Diagnostics(session, "tracker", 0.0)
    session.set_camera(camera_info(BACKEND, frame_id="left_optical"), "left")
    session.set_camera(camera_info(BACKEND, frame_id="right_optical", k=np.zeros(9)), "right")
    line = diagnostics.line(1.0)
    assert line.level == ERROR and line.message.startswith("camera 'right': camera_info refused: ")
    assert "last good one" not in line.message
    session.set_camera(camera_info(BACKEND, frame_id="right_optical"), "right")
    session.set_camera(camera_info(BACKEND, frame_id="right_optical", k=np.zeros(9)), "right")
    assert diagnostics.line(2.0).message.endswith("; the last good one is used")


def turned(one, rotation):
    pose = one.pose_at(0)
    pose = CameraPose("", rotation @ pose.rotation, rotation @ pose.translation)
    return Eye("", lambda seconds: pose)


def test_a_camera_that_hangs_upside_down_in_a_fixed_frame_is_no_fault():
    scene = Scene({"": turned(EYES["left"], np.diag([-1.0, -1.0, 1.0]))})
    lines = [scene.second() for _ in range(13)]
    assert (lines[-1].level, lines[-1].message) == (OK, "tracking")


def test_a_person_upside_down_in_a_fixed_frame_is_reported():
    scene = Scene({"": turned(EYES["left"], np.eye(3))})
    upside_down = tf_of(BACKEND, turned(EYES["left"], np.diag([-1.0, -1.0, 1.0])), START_NS, 0.0)
    scene.session.placement.transforms.add(upside_down, static=True)
    lines = [scene.second() for _ in range(13)]
    assert lines[-1].level == WARN and "pointed down for more than 10 s" in lines[-1].message
    assert "camera_roll" not in lines[-1].message


def test_somebody_else_is_said_only_while_somebody_is_there():
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    diagnostics = Diagnostics(session, "tracker", 0.0)
    points = EYES["left"].pose_at(0).into_camera(TRUTH.landmarks[0])
    pixels = 600 * points[:, :2] / points[:, 2:] + [320, 240]

    def send(first, last, seen):
        for index in range(first, last):
            stamp_ns = START_NS + round(1e9 * index / HZ)
            people = [(pixels + 0.01 * index, np.full(17, 0.9))] if seen else []
            frames = session.frames(crowd(BACKEND, stamp_ns, people, [-1] * len(people)), stamp_ns)
            diagnostics.count_message(frames, stamp_ns, index / HZ, 0.001)
        return diagnostics.line(last / HZ)

    send(0, 10, True), send(10, 32, False)
    assert "may be somebody else" in send(32, 40, True).message
    assert send(40, 100, False).message == "nobody in view"
