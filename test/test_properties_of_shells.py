"""What may not change an answer, and what moves it along, in Python, `replay` and the node alike."""

from contextlib import contextmanager

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from camera_rig import MAP, eye, pixels, truth_at  # noqa: E402
from messages import FRAME, WIDTH, camera_info, crowd, pixels_of_motion, rosbags_backend  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from transforms import tf_message  # noqa: E402

from lassokin_ros.core.body.proportions import partners  # noqa: E402
from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402
from lassokin_ros.replay.playback import Playback  # noqa: E402

FRAMES, RATE, START_NS, DAY_NS = 30, 30.0, 10**18, 86_400 * 10**9
ONE_CAMERA = [{"": xy} for xy in pixels_of_motion(FRAMES, RATE)]
EYES = {name: eye(name, degrees) for name, degrees in (("left", -30), ("right", 40))}
TWO = {"cameras": ("left", "right"), "fixed_frame": MAP}


@contextmanager
def python(**settings):
    session = Session(TrackerConfig(height=1.75), NodeSettings(**settings))
    yield session, rosbags_backend(), session.push, session.reset


@contextmanager
def replay(**settings):
    with python(**settings) as (session, backend, _, reset):
        yield session, backend, Playback(session).keypoints, reset


@contextmanager
def node(**settings):
    pytest.importorskip("rclpy")
    if "fixed_frame" in settings:
        pytest.importorskip("tf2_msgs", reason="the node listens to TF")
    from live import BACKEND, node_in_this_process

    settings = {name: list(value) if isinstance(value, tuple) else value for name, value in settings.items()}
    with node_in_this_process("/properties", height=1.75, **settings) as (running, _):
        yield running._session, BACKEND, running.work_on, running._forget


@pytest.fixture(params=[python, replay, node], ids=lambda shell: shell.__name__)
def shell(request):
    return request.param


def answers(shell, images, start_ns=START_NS, turn=None, shift=0.0, reset_at=0, **settings):
    """(f, 24, 3) m: the joints of the only person after each instant.

    images: of each instant, by the camera's name, pixels (l, 2), or None if it sees nobody. turn, shift: of the map in
    which TF places the cameras. reset_at: number of an instant before which the shell is reset.
    """
    with shell(**settings) as (session, backend, push, reset):
        frames = {name: EYES[name].frame if name else FRAME for name in images[0]}
        for name, frame in frames.items():
            session.set_camera(camera_info(backend, frame_id=frame), name)
            if name:
                pose, turned = EYES[name].pose_at(0), turn or Rotation.identity()
                rotation, centre = turned * Rotation.from_matrix(pose.rotation.T), turned.apply(pose.centre) + shift
                session.push_transforms(tf_message(backend, start_ns, (MAP, frame, rotation, centre)), static=True)
        found = []
        for index, instant in enumerate(images):
            if index == reset_at:
                reset()
            for name, xy in instant.items():
                people, stamp_ns = [] if xy is None else [(xy, np.full(17, 0.9))], start_ns + round(1e9 * index / RATE)
                push(crowd(backend, stamp_ns, people, frame_id=frames[name]), stamp_ns, name)
            (tracker,) = session.roster.trackers.values()
            found.append(tracker.kinematics.pose(tracker.state).positions)
        assert session.counts["accepted"] == len(images), session.counts
        return np.array(found)


def test_after_a_reset_the_poses_are_those_of_a_new_start(shell):
    later = START_NS + round(1e9 * 12 / RATE)
    assert np.array_equal(answers(shell, ONE_CAMERA, reset_at=12)[12:], answers(shell, ONE_CAMERA[12:], later))


@pytest.fixture(scope="module")
def two_cameras():
    """Images of two cameras."""
    landmarks, random = truth_at(np.arange(FRAMES) / RATE).landmarks, np.random.default_rng(0)
    return [{name: pixels(one, 0, seen, random) for name, one in EYES.items()} for seen in landmarks]


def test_the_date_does_not_change_the_poses(shell):
    found = [answers(shell, ONE_CAMERA, start) for start in (START_NS, START_NS + DAY_NS)]
    assert np.array_equal(*found)


def test_one_of_four_possible_people_has_the_poses_of_one(shell):
    assert np.array_equal(answers(shell, ONE_CAMERA), answers(shell, ONE_CAMERA, max_people=4))


def test_a_mirrored_person_has_mirrored_poses(shell):
    """Nearly: the whitening of the network's depths has no symmetry."""
    with python() as (session, *_):
        landmarks, joints = partners(session.tracker.layout.names), partners(session.tracker.skeleton.joint_names)
    mirrored = [{"": (np.array([WIDTH, 0]) + one[""] * [-1, 1])[landmarks]} for one in ONE_CAMERA]
    there = answers(shell, mirrored)[:, joints] * [-1, 1, 1]
    assert np.linalg.norm(answers(shell, ONE_CAMERA) - there, axis=-1).max() < 0.1


def test_a_second_camera_that_sees_nobody_does_not_change_the_poses(shell, two_cameras):
    alone = [{"left": one["left"]} for one in two_cameras]
    silent = [{**one, "right": None} for one in alone]
    one = answers(shell, alone, cameras=("left",), fixed_frame=MAP)
    assert np.abs(one - answers(shell, silent, **TWO)).max() < 1e-9


def test_the_answers_turn_with_the_map(shell, two_cameras):
    """About the vertical only: in a fixed frame z points up."""
    turn, shift = Rotation.from_euler("z", 0.7), np.array([4.0, -2.0, 1.0])
    here, there = (answers(shell, two_cameras, turn=t, shift=s, **TWO) for t, s in ((None, 0.0), (turn, shift)))
    assert np.abs(here @ turn.as_matrix().T + shift - there).max() < 1e-4  # float32
