"""A robot that imitates a person: directions, limits, holds, floor. The robot is a toy."""

from dataclasses import replace

import numpy as np
import pytest
import toy_robot
from scipy.spatial.transform import Rotation

pytest.importorskip("pink", reason="needs the extra robot: pip install lassokin_ros[robot]")

from benchmarks.robots.fuzz import fuzzed  # noqa: E402
from lassokin_ros import joints  # noqa: E402
from lassokin_ros.robot import imitation  # noqa: E402
from lassokin_ros.robot.check import bone_angles, people  # noqa: E402
from lassokin_ros.robot.clearance import Clearance, closest  # noqa: E402
from lassokin_ros.robot.imitation import DOUBT_S, RAMP_S, Imitation  # noqa: E402
from lassokin_ros.robot.model import RobotModel  # noqa: E402
from lassokin_ros.robot.person import ANKLES, Course, Person  # noqa: E402

URDF, RATE, FPS = toy_robot.urdf(), 100.0, 30.0
FIXED, FREE = (RobotModel(URDF, toy_robot.robot(), free) for free in (False, True))
PEOPLE = people()
DOWN, BENT, ONE_LEG = PEOPLE["arms down"], PEOPLE["elbows bent"], PEOPLE["on the left leg"]


def follow(robot, views, seconds=0.0, each=lambda: None):
    """Images at FPS, each followed by its ticks; `seconds` of the last one again."""
    views = [*views, *[views[-1]] * round(seconds * FPS)]
    ticks = 0
    for index, view in enumerate(views):
        robot.see(view, 1 / FPS)
        while ticks < (index + 1) * RATE / FPS:
            robot.step()
            each()
            ticks += 1
    return robot


def between(a, b, seconds):
    """Views from a to b: the bones keep no length, their directions move."""
    shares = np.linspace(0, 1, round(seconds * FPS))
    return [replace(b, places=(1 - s) * a.places + s * b.places) for s in shares]


@pytest.mark.parametrize("name", ["arms down", "elbows bent", "on the left leg"])
def test_directions_of_a_still_person_are_kept(name):
    robot = follow(Imitation(FREE, RATE), [PEOPLE[name]], 4.0)
    assert max(bone_angles(robot, PEOPLE[name]).values()) < 3.0 and robot.unsolved == 0


def test_the_frame_of_the_person_does_not_matter():
    turn = Rotation.from_rotvec([0.3, -2.0, 0.7]).as_matrix()
    turned = replace(BENT, places=BENT.places @ turn.T + (1.0, 2.0, 3.0), up=turn @ BENT.up)
    robots = [follow(Imitation(FREE, RATE), [view], 1.0) for view in (BENT, turned)]
    assert np.allclose(robots[0].configuration.q, robots[1].configuration.q, atol=1e-5)


def test_a_solver_of_qpsolvers_may_be_chosen():
    robots = [follow(Imitation(FIXED, RATE, solver), [BENT], 1.0) for solver in ("proxqp", "daqp")]
    assert np.allclose(robots[0].positions, robots[1].positions, atol=1e-3)


def test_an_arm_that_is_not_seen_stays():
    usable = DOWN.usable.copy()
    usable[[joints.LEFT_ELBOW, joints.LEFT_WRIST]] = False
    robot = follow(Imitation(FIXED, RATE), [DOWN], 3.0)
    before = dict(zip(FIXED.names, robot.positions))
    views = [replace(view, usable=usable) for view in between(DOWN, BENT, 0.5)]
    after = dict(zip(FIXED.names, follow(robot, views, 2.0).positions))
    assert after["right_elbow"] < before["right_elbow"] - 1.0
    assert all(after[f"left_{name}"] == pytest.approx(before[f"left_{name}"], abs=0.15) for name, *_ in toy_robot.ARM)


@pytest.mark.parametrize("model", [FIXED, FREE], ids=["fixed", "free"])
def test_limits_hold_for_any_targets_and_each_tick_has_a_solution(model):
    worst = fuzzed(model, 6.0, seed=1)
    assert worst.ticks == 600 and worst.followed > 300 and worst.unsolved == worst.nan == 0
    assert worst.angle <= 0 and worst.speed < 1e-9 and worst.acceleration < 1e-6 * model.robot.acceleration


def test_a_hold_stops_at_once_and_the_return_is_slow():
    robot = follow(Imitation(FIXED, RATE), between(DOWN, BENT, 0.3))
    follow(robot, [BENT], RAMP_S)
    follow(robot, between(BENT, DOWN, 0.3))
    assert np.abs(robot.speeds).max() > 1.0
    robot.hold()
    for _ in range(round(0.1 * RATE)):
        robot.step()
    assert np.abs(robot.speeds).max() == 0 and robot.holding
    speeds = []
    follow(robot, [BENT], 0.9, lambda: speeds.append(np.abs(robot.speeds).max()))
    assert max(speeds[: round(0.2 * RATE)]) < 0.11 * toy_robot.robot().speed
    assert 0.1 < max(speeds) < 0.5 * toy_robot.robot().speed and not robot.holding


@pytest.mark.parametrize("change", ["nan", "flat", "up", "lying on a side"])
def test_a_person_without_directions_is_not_followed(change):
    robot = follow(Imitation(FIXED, RATE), [DOWN], 1.0)
    places = DOWN.places.copy()
    if change == "nan":
        places[joints.LEFT_ELBOW] = np.nan
    if change == "flat":
        places[joints.LEFT_HIP] = places[joints.RIGHT_HIP]
    verticals = {"up": np.full(3, np.nan), "lying on a side": np.array([0.99, 0.14, 0.0])}
    view = replace(DOWN, places=places, up=verticals.get(change, DOWN.up))
    assert "no directions" in robot.see(view, 1 / FPS) and robot.holding
    before = robot.positions.copy()
    assert np.isfinite(robot.step()).all() and np.allclose(robot.positions, before, atol=0.05)


def test_exchanged_sides_are_held():
    robot = follow(Imitation(FIXED, RATE), [BENT], 3.0)
    before, order = robot.positions.copy(), np.arange(24)
    for name, index in joints.INDEX.items():
        other = name.replace("left", "RIGHT").replace("right", "left").replace("RIGHT", "right")
        order[index] = joints.INDEX[other]
    exchanged = replace(BENT, places=BENT.places[order])
    follow(robot, [exchanged], DOUBT_S - 0.1)
    assert robot.holding and np.abs(robot.positions - before).max() < 0.05
    follow(robot, [BENT], 0.2)
    assert robot.holding  # they were exchanged back a moment ago
    follow(robot, [BENT], DOUBT_S)
    assert not robot.holding


def test_it_begins_at_the_measured_joints():
    robot = Imitation(FREE, RATE)
    start = np.clip(FREE.rest[7:] + 0.2, FREE.lowest, FREE.highest)
    robot.place(start)
    assert np.allclose(robot.positions, start) and robot.holding
    ankles = [FREE.places(robot.configuration.q)[f"{side}_ankle"][2] for side in ("left", "right")]
    assert min(ankles) == pytest.approx(FREE.robot.sole)


def test_feet_that_stand_stay_and_soles_are_never_below_the_floor():
    robot, feet = Imitation(FREE, RATE), []
    places = [robot.model.frames[f"{side}_ankle"] for side in ("left", "right")]

    def look():
        feet.append([robot.configuration.data.oMf[frame].translation.copy() for frame in places])

    follow(robot, [DOWN], 2.5, look)
    follow(robot, between(DOWN, ONE_LEG, 0.4), 1.0, look)
    lifted = np.array(feet)[-1, 1, 2]
    follow(robot, between(ONE_LEG, DOWN, 0.6), 1.0, look)
    path = np.array(feet)
    assert path[..., 2].min() > FREE.robot.sole - 1e-9 and lifted > FREE.robot.sole + 0.15
    slide = np.linalg.norm(np.diff(path[:, 0, :2], axis=0), axis=1).sum()
    assert slide < 0.015  # m, of the left foot, which stands all the time
    assert robot.unsolved == 0


def test_who_jumps_stands_on_the_lower_foot():
    air = replace(ONE_LEG, contacts=np.zeros(2, dtype=bool))
    robot = follow(Imitation(FREE, RATE), [air], 3.0)
    heights = [robot.configuration.data.oMf[FREE.frames[f"{side}_ankle"]].translation[2] for side in ("left", "right")]
    assert heights[0] == pytest.approx(FREE.robot.sole, abs=2e-3) and heights[1] > heights[0] + 0.1


def test_a_foot_that_leaves_or_touches_the_floor_causes_no_jolt():
    robot, steps = Imitation(FREE, RATE), []
    follow(robot, [DOWN], 2.5)
    flags = [np.array([True, True]), np.array([True, False])] * 4
    follow(
        robot, [replace(DOWN, contacts=each) for each in flags for _ in range(4)], 0, lambda: steps.append(robot.speeds)
    )
    assert np.abs(np.diff(steps, 2, axis=0)).max() * RATE**2 < 300  # rad/s^3


def test_forearms_stay_off_the_trunk_as_far_as_the_radii_say():
    wide = replace(toy_robot.robot(), radii={"trunk": 0.12, "forearm": 0.05})
    crossed = PEOPLE["elbows bent"]
    places = crossed.places.copy()
    for side, other in (("LEFT", "RIGHT"), ("RIGHT", "LEFT")):
        places[getattr(joints, f"{side}_WRIST")] = places[getattr(joints, f"{other}_HIP")] + (0.0, 0.15, 0.0)
    view, gaps = replace(crossed, places=places), []
    for file in (toy_robot.robot(), wide):
        robot = follow(Imitation(RobotModel(URDF, file), RATE), [view], 3.0)
        gaps.append(Clearance(RobotModel(URDF, wide)).gaps(robot.configuration).min())
        assert robot.unsolved == 0
    assert gaps[0] < -0.02 and gaps[1] > -0.002


def test_closest_points_of_segments_are_those_of_a_fine_search():
    ends = np.random.default_rng(2).normal(size=(4, 50, 3))
    ends[3, :5] = ends[2, :5] + ends[1, :5] - ends[0, :5]  # parallel
    ends[1, 5:10] = ends[0, 5:10]  # a point
    s, t = closest(*ends)
    a, b, c, d = ends
    found = np.linalg.norm(a + s[:, None] * (b - a) - c - t[:, None] * (d - c), axis=1)
    u = np.linspace(0, 1, 101)[:, None, None, None]
    apart = np.linalg.norm(a + u * (b - a) - (c + u[:, 0] * (d - c))[:, None].swapaxes(0, 1), axis=-1)
    assert (found <= apart.min(axis=(0, 1)) + 1e-9).all() and (found > apart.min(axis=(0, 1)) - 0.05).all()


def test_the_centre_of_mass_goes_over_the_feet_that_stand():
    mass = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    heavy = URDF.replace('<link name="chest"/>', f'<link name="chest">{mass.format(20)}</link>')
    off = []
    for urdf in (URDF, heavy):
        robot = follow(Imitation(RobotModel(urdf, toy_robot.robot(), free=True), RATE), [ONE_LEG], 4.0)
        at = robot.configuration.data.oMf
        chest, ankle = (at[robot.model.frames[place]].translation for place in ("torso", "left_ankle"))
        off.append(np.linalg.norm(chest[:2] - ankle[:2]))
    assert off[1] < off[0] - 0.005


def test_without_a_solution_it_brakes_and_counts(monkeypatch):
    robot = follow(Imitation(FIXED, RATE), between(DOWN, BENT, 0.5))

    def fail(*_, **__):
        raise imitation.qpsolvers.exceptions.SolverError("no")

    monkeypatch.setattr(imitation.qpsolvers, "solve_problem", fail)
    follow(robot, [BENT], 0.2)
    assert robot.unsolved > 10 and np.abs(robot.speeds).max() == 0


def test_a_course_reaches_each_image_one_image_later_and_follows_a_line_with_its_lag():
    course, speed = Course(), np.array([[0.3, -0.2, 0.0]])
    places = []
    for image in range(60):
        course.add(image / FPS * speed, 1 / FPS)
        places += [course.advance(1 / 90)[0] for _ in range(3)]
    lag = 1 / FPS + Course.LAG
    now = 60 / FPS
    assert np.allclose(places[-1], (now - lag) * speed[0], atol=2e-3)
    jumps = np.diff(places[90:], 2, axis=0)
    assert np.abs(jumps).max() < 1e-4  # no corner at an image


def test_a_person_who_is_no_person_is_refused():
    short = Person(np.zeros((5, 3)), np.ones(5, dtype=bool), np.array([0, 0, 1.0]), np.ones(2, dtype=bool))
    assert not short.usable_as_a_whole and BENT.usable_as_a_whole and len(ANKLES) == 2
