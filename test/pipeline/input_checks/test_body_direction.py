"""The direction of the body in the image, by its joints."""

from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.core.observation import HERE, CameraPose
from lassokin_ros.pipeline.concerns.catalogue import PROBLEM
from lassokin_ros.pipeline.input_checks.body_direction import LONG_S, BodyDirection

NAMES = ("pelvis", "neck", "head")


def frame(degrees, names=NAMES, towards=0.0):
    """A body that is turned clockwise in the image by an angle; towards: m by which the head is nearer."""
    angle = np.radians(degrees)
    up = np.array([np.sin(angle), -np.cos(angle), -towards])
    positions = np.array([0.0, 0.2, 3.0]) + np.outer([0.0, 0.5, 0.7], up)
    return SimpleNamespace(
        estimate=SimpleNamespace(pose=SimpleNamespace(positions=positions)),
        skeleton=SimpleNamespace(joint_names=names),
        camera=HERE,
    )


def words(*frames, seconds=12, roll=0.0):
    direction = BodyDirection()
    for second in range(seconds):
        direction.update(frames, roll, float(second))
    found = direction.concern(float(seconds - 1))
    return ("", False) if found is None else (found.text, found.level == PROBLEM)


@pytest.mark.parametrize(
    ("degrees", "side", "down"),
    [
        (0, False, False),
        (49, False, False),
        (51, True, False),
        (-90, True, False),
        (129, True, False),
        (131, False, True),
    ],
)
def test_a_body_points_up_to_the_side_or_down(degrees, side, down):
    text, is_down = words(frame(degrees))
    assert ("to the side" in text, "down in the image" in text, is_down) == (side, down, down)


def test_it_is_said_after_ten_seconds_and_ends_with_the_first_upright_body():
    direction = BodyDirection()
    assert direction.concern(100.0) is None
    for second in range(12):
        direction.update([frame(180)], 0.0, float(second))
        assert (direction.concern(float(second)) is not None) == (second > LONG_S)
    direction.update([frame(0)], 0.0, 12.0)
    assert direction.concern(12.0) is None and direction.concern(22.0) is None


def test_the_roll_of_the_camera_is_known():
    for degrees in (90, 180, -90):
        # positive roll: the right side of the camera is down, so that bodies lean to its left
        assert words(frame(-degrees), roll=np.radians(degrees))[0] == ""
        assert words(frame(0), roll=np.radians(degrees))[0]


@pytest.mark.parametrize("looks", ["ahead", "up"])
def test_a_person_who_stands_in_the_image_of_a_camera_that_looks_up_shows_a_wrong_frame(looks):
    level = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    one, direction = frame(0), BodyDirection()
    one.camera = CameraPose("", level if looks == "ahead" else np.eye(3))
    one.estimate.pose.positions = one.estimate.pose.positions @ one.camera.rotation
    for second in range(2):
        direction.update([one], None, float(second))
        found = direction.concern(float(second))
        assert (found is not None and "looks up or down" in found.text) == (looks == "up" and second == 1)


def test_of_several_people_one_upright_is_enough_and_without_people_nothing_is_said():
    assert words(frame(180), frame(90), frame(10))[0] == ""
    assert "to the side" in words(frame(180), frame(90))[0]
    assert words()[0] == ""


def test_bodies_that_do_not_show_a_direction_are_not_used():
    assert words(frame(180, towards=2.0))[0] == "" and words(frame(180, towards=1.5))[0]
    assert words(frame(180, ("hips", "neck", "head")))[0] == ""
    assert words(frame(180, ("pelvis", "neck", "skull")))[0]
    nothing = SimpleNamespace(estimate=None, skeleton=None)
    assert words(nothing)[0] == ""
