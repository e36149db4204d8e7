"""Who left the view is remembered until the place was looked at, or for `nobody_after`."""

from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.people.out_of_view import CONTINUED_S, EMPTY_AFTER_S, OutOfView
from lassokin_ros.pipeline.seen import Image

UP = np.array([0.0, 0.0, 1.0])
LENS = Lens(np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]), size=(640, 480))
START_NS, STEP_NS = 10**10, 10**8


def image(stamp_ns, yaw=0.0):
    """An empty image of a camera at 1 m above the origin, which looks along x, turned by yaw."""
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[s, -c, 0.0], [0, 0, -1], [c, s, 0]])
    return Image([], stamp_ns, "odom", LENS, camera=CameraPose("", rotation, -rotation @ [0, 0, 1.0]))


def person(place, velocity=(0, 0, 0), stamp_ns=START_NS, label="p1"):
    """The fields of an accepted result."""
    pose = SimpleNamespace(positions=np.array([place], dtype=float))
    fields = dict(stamp_ns=stamp_ns, accepted=True, label=label, person="")
    return SimpleNamespace(estimate=SimpleNamespace(pose=pose), velocity=np.array(velocity, dtype=float), **fields)


def look(watch, seconds, yaw=0.0, since_s=0.0, empty_after_s=3.0, jump=None):
    """Look for some seconds, 10 times per second, and return the ids of those who may still be there."""
    steps = range(1, round(seconds * 10) + 1)
    for i in steps:
        watch.update([], [image(START_NS + round(since_s * 1e9) + i * STEP_NS, yaw)], empty_after_s, jump)
    end_ns = START_NS + round((since_s + seconds) * 1e9)
    return [one.frame.label for one in watch.at(end_ns, 30.0)]


@pytest.fixture
def watch():
    result = OutOfView(UP)
    result.update([person((3.0, 0.2, 1.0))], [image(START_NS)], 3.0, None)
    return result


def test_a_place_that_was_looked_at_is_empty(watch):
    assert look(watch, EMPTY_AFTER_S - 0.15) == ["p1"]
    assert not watch.at(START_NS + STEP_NS, 30.0)[0].out_of_view
    assert look(watch, 0.5, since_s=EMPTY_AFTER_S - 0.1) == []


def test_a_person_behind_a_camera_that_turned_away_is_out_of_view_until_it_looks_again_or_time_has_passed(watch):
    assert look(watch, 20.0, yaw=np.pi) == ["p1"]
    (absent,) = watch.at(START_NS + 20 * 10**9, 30.0)
    assert absent.out_of_view
    assert not watch.at(START_NS + 31 * 10**9, 30.0)
    assert look(watch, 1.5, since_s=21.0) == []


def test_a_place_at_the_edge_of_the_view_is_not_looked_at(watch):
    edge = np.arctan(320 / 600)
    assert look(watch, 5.0, yaw=edge - 0.05) == ["p1"]


def test_a_person_who_walks_out_of_the_view_is_expected_outside(watch):
    watch.update([person((3.0, 1.0, 1.0), velocity=(0, 1.4, 0))], [], 3.0, None)
    assert look(watch, 5.0) == ["p1"]
    assert look(watch, 1.5, yaw=0.4, since_s=5.0) == []
    assert CONTINUED_S * 1.4 > 0.5


def test_a_person_who_is_seen_again_is_remembered_anew(watch):
    look(watch, EMPTY_AFTER_S - 0.2)
    watch.update([person((3.0, 0.2, 1.0), stamp_ns=START_NS + 10**9)], [], 3.0, None)
    assert look(watch, 0.5, since_s=1.0) == ["p1"]


def test_the_silence_of_a_detector_that_sends_nothing_without_people_is_a_look(watch):
    here, away = image(START_NS).camera, image(START_NS, np.pi).camera
    for i in range(1, 30):
        watch.look([away], START_NS + i * STEP_NS, 3.0)
    assert watch.ids == ["p1"]
    for i in range(30, 42):
        watch.look([here], START_NS + i * STEP_NS, 3.0)
    assert watch.ids == [] and not watch.at(START_NS + 42 * STEP_NS, 30.0)


def test_a_shorter_forget_after_holds(watch):
    assert look(watch, 0.3, empty_after_s=0.2) == []


def test_places_move_with_a_jump_of_the_fixed_frame(watch):
    moved = CameraPose("", np.diag([-1.0, -1.0, 1.0]), np.zeros(3))  # half a turn
    assert look(watch, 2.0, jump=(START_NS + 1, moved)) == ["p1"]
    assert look(watch, 2.0, yaw=np.pi, since_s=2.0, jump=(START_NS + 1, moved)) == []


def test_a_ray_that_the_distortion_folds_into_the_image_is_not_looked_at():
    lens = Lens(np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]), [-0.3, 0.0, 0, 0, 0], "plumb_bob", (640, 480))
    watch = OutOfView(UP)
    watch.update([person((1.0, -1.6, 1.0))], [], 3.0, None)
    for i in range(1, 30):
        frame = image(START_NS + i * STEP_NS)
        watch.update([], [Image([], frame.stamp_ns, "odom", lens, camera=frame.camera)], 3.0, None)
    assert watch.at(START_NS + 3 * 10**9, 30.0)
