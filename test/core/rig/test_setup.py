"""The check of a given set-up: what is named, and that right places raise no alarm."""

from functools import partial

import numpy as np
import pytest
from camera_rig import eye, pixels, truth_at
from messages import FOCAL, HEIGHT, WIDTH

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.rig.setup import Explanation, SetUpCheck

EYES = [eye("a", 0), eye("b", 80, 3.0), eye("c", 200, 4.0)]
LAYOUT = Layout.load("coco17", Skeleton.load("anthropometric", 1.75))
REST = Skeleton.load("anthropometric", 1.75).rest_positions[LAYOUT.joints] + LAYOUT.offsets
RANDOM = np.random.default_rng(0)
POINTS = [np.array([pixels(one, 0.0, m, RANDOM, 2.0) for m in truth_at(np.arange(40) / 10).landmarks]) for one in EYES]
TRUE = [(one.pose_at(0).rotation, one.pose_at(0).translation) for one in EYES]
GIVEN = Explanation((0, 1, 2))


def normalise(points):
    return (points - [WIDTH / 2, HEIGHT / 2]) / FOCAL


def judged(poses=None, files=(0, 1, 2), known=None, count=3):
    """The result with other poses, and with other files of the cameras."""
    poses = (poses or TRUE)[:count]
    shown = [POINTS[file] for file in files[:count]]
    known = [np.ones(p.shape[:2], bool) for p in shown] if known is None else known
    return SetUpCheck(shown, known, count * [normalise], poses, LAYOUT.names, REST).result()


def inverse(pose):
    return pose[0].T, -pose[0].T @ pose[1]


def off(pose, radians, metres):
    turn = exponential(np.array([[radians, 0, 0]]))[0]
    return turn @ pose[0], turn @ pose[1] + [metres, 0, 0]


@pytest.mark.parametrize("count", [2, 3])
def test_right_places_and_small_errors_raise_no_alarm(count):
    found = judged(count=count)
    assert found.found == Explanation(tuple(range(count))) and found.wrong is None
    assert found.unit == "m" and found.axis == "+z" and abs(found.scale - 1) < 0.05
    small = judged([TRUE[0], off(TRUE[1], 0.035, 0.03), TRUE[2]], count=count)
    assert small.found.is_given and small.unit == "m"


@pytest.mark.parametrize(
    ("poses", "files", "want"),
    [
        ([inverse(one) for one in TRUE], (0, 1, 2), Explanation((0, 1, 2), frozenset({0, 1, 2}))),
        ([TRUE[0], inverse(TRUE[1]), TRUE[2]], (0, 1, 2), Explanation((0, 1, 2), frozenset({1}))),
        (TRUE, (1, 0, 2), Explanation((1, 0, 2))),
        (TRUE, (1, 2, 0), Explanation((1, 2, 0))),
    ],
)
def test_inverted_poses_and_exchanged_files_are_named(poses, files, want):
    found = judged(poses, files)
    assert {one.order for one in found.costs} >= {want.order}
    back = tuple(int(np.flatnonzero(np.array(files) == camera)[0]) for camera in range(3))
    assert found.found == Explanation(back, want.inverted) and found.wrong is None


@pytest.mark.parametrize(("factor", "unit"), [(1000, "mm"), (100, "cm"), (10, "")])
def test_the_unit_is_known_by_the_size_of_the_person(factor, unit):
    assert judged([(R, factor * t) for R, t in TRUE]).unit == unit


@pytest.mark.parametrize(
    ("turn", "axis"), [(np.diag([1.0, -1, -1]), "-z"), (np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), "+y")]
)
def test_the_vertical_is_known_by_the_trunk(turn, axis):
    assert judged([(R @ turn.T, t) for R, t in TRUE]).axis == axis


def test_somebody_who_lies_shows_no_vertical():
    lying = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # the cameras are turned with the room: the images lie
    poses = [(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ R @ lying.T, t) for R, t in TRUE]
    assert judged(poses).axis == ""


def test_the_one_wrong_camera_is_named():
    found = judged([TRUE[0], TRUE[1], off(TRUE[2], 0.7, 0.5)])
    assert found.found is None and found.wrong == 2 and found.unit == "m"
    assert judged([TRUE[0], off(TRUE[1], 0.7, 0.5)], count=2).wrong is None


def test_too_little_in_common_shows_nothing():
    known = [np.zeros(p.shape[:2], bool) for p in POINTS]
    assert judged(known=known) is None
    check = SetUpCheck(POINTS, [np.ones((40, 17), bool)] * 3, 3 * [partial(normalise)], TRUE, LAYOUT.names, REST)
    assert len(check.result(searched_from=np.inf).costs) == 1
