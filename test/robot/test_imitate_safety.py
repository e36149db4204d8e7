"""The node `imitate` in simulated time, without processes: what makes it hold, how soon, and what does not upset it."""

from dataclasses import replace

import numpy as np
import pytest
import toy_robot

pytest.importorskip("pink", reason="needs the extra robot: pip install lassokin_ros[robot]")
rclpy = pytest.importorskip("rclpy")

from rclpy.parameter import Parameter  # noqa: E402
from rclpy.signals import SignalHandlerOptions  # noqa: E402
from rclpy.time import Time  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from simulated.imitated_person import BENT, DOWN, PERSON, PersonMessages, without_shoulder  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402

from lassokin_ros import joints  # noqa: E402
from lassokin_ros.robot.node import ImitateNode  # noqa: E402
from lassokin_ros.robot.robot_file import RobotError  # noqa: E402

FPS, RATE, STOP_S = 25, 50, 0.5
OTHER_SIDE = [
    joints.INDEX[name.replace("left", "#").replace("right", "left").replace("#", "right")] for name in joints.NAMES
]


class Scene:
    """A node whose time, images and ticks the test gives. positions: of all ticks, by their time, s."""

    def __init__(self, tmp_path, context):
        robot = tmp_path / "toy.yaml"
        robot.write_text(toy_robot.as_yaml(toy_robot.robot()))
        given = {"use_sim_time": True, "robot": str(robot), "robot_description": toy_robot.urdf(), "rate": float(RATE)}
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        self.node = ImitateNode(context=context, parameter_overrides=overrides)
        self.messages = PersonMessages()
        self.seconds, self.times, self.positions, self.said = 100.0, [], [], []
        self._set_time()
        self.node._watch._on_state(String(data="tracking"))
        assert self.node._on_enable(SetBool.Request(data=True), SetBool.Response()).success

    def _set_time(self):
        self.node.get_clock().set_ros_time_override(
            Time(seconds=self.seconds, clock_type=self.node.get_clock().clock_type)
        )

    def run(self, seconds, image):
        """image: (view, person, s of delay) of a time, or None for no message."""
        begin = self.seconds
        for tick in range(round(seconds * RATE)):
            self.seconds = begin + (tick + 1) / RATE
            self._set_time()
            if tick * FPS // RATE != (tick - 1) * FPS // RATE and (sent := image(self.seconds)) is not None:
                self.send(*sent)
            self.node._on_timer()
            self.times.append(self.seconds)
            self.positions.append(self.node._robot.positions.copy())
            self.said.append(self.node._state)

    def send(self, view, person=PERSON, late_s=0.0):
        people_message, message = self.messages.of(round(1e9 * (self.seconds - late_s)), view, person)
        self.node._watch._on_people(people_message)
        self.node._watch._waiting.append((self.node._on_skeleton, message))
        self.node._watch._deliver()

    def moved(self, first_s, last_s):
        """The largest motion, rad, of a joint between two times."""
        chosen = [place for time, place in zip(self.times, self.positions) if first_s <= time <= last_s]
        return float(np.ptp(chosen, axis=0).max())


@pytest.fixture(scope="module")
def context():
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    yield context
    context.try_shutdown()


@pytest.fixture
def scene(tmp_path, context):
    scene = Scene(tmp_path, context)
    yield scene
    scene.node.destroy_node()


def swinging(seconds):
    """A person who moves the arms, never faster than people."""
    share = 0.5 - 0.5 * np.cos(2 * np.pi * 0.4 * seconds)
    return replace(DOWN, places=DOWN.places + share * (BENT.places - DOWN.places))


def exchanged(view):
    return replace(view, places=view.places[OTHER_SIDE])


FAULTS = {
    "the tracker is killed": lambda now, begin: None,
    "keypoints are 1.5 s old": lambda now, begin: (swinging(now - 1.5), PERSON, 1.5),
    "TF is late, so that the tracker waits with an image": lambda now, begin: (swinging(begin), PERSON, now - begin),
    "another person is followed": lambda now, begin: (BENT, replace(PERSON, id="p2")),
    "the person is guessed": lambda now, begin: (swinging(now), replace(PERSON, guessed=True)),
    "the person is doubtful": lambda now, begin: (swinging(now), replace(PERSON, doubtful=True)),
    "the person leaves": lambda now, begin: (swinging(begin), replace(PERSON, tracked=False)),
    "NaN": lambda now, begin: (replace(DOWN, places=np.full((24, 3), np.nan)), PERSON),
    "the vertical is NaN": lambda now, begin: (replace(swinging(now), up=np.full(3, np.nan)), PERSON),
    "the person lies on a side": lambda now, begin: (replace(swinging(now), up=np.array([1.0, 0, 0])), PERSON),
    "a shoulder is not seen": lambda now, begin: (without_shoulder(swinging(now)), PERSON),
    "sides are exchanged": lambda now, begin: (exchanged(swinging(now)), PERSON),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_after_half_a_second_nothing_moves_and_the_return_is_slow(scene, fault):
    scene.run(1.6, lambda now: (swinging(now),))
    begin = scene.seconds
    assert scene.node._state == "following" and scene.moved(begin - 1, begin) > 0.2
    scene.run(1.0, lambda now: FAULTS[fault](now, begin))
    assert scene.moved(begin + STOP_S, scene.seconds) == 0 and scene.node._state.startswith("holding: ")
    scene.node._on_enable(SetBool.Request(data=True), SetBool.Response())
    back = scene.seconds
    scene.run(0.5, lambda now: (swinging(now),))
    assert np.abs(np.diff(scene.positions[-RATE // 2 :], axis=0)).max() * RATE < 0.3 * toy_robot.robot().speed
    assert np.isfinite(scene.positions).all() and scene.moved(back, scene.seconds) < 1.5


def test_sides_that_are_exchanged_for_3_s_move_no_joint_by_more_than_005(scene):
    scene.run(2.5, lambda now: (BENT,))
    begin = scene.seconds
    scene.run(3.0, lambda now: (exchanged(BENT),))
    assert scene.moved(begin - 0.02, scene.seconds) < 0.05


def lying(view, seconds):
    """On the back after a second: the trunk still has a heading."""
    turn = Rotation.from_rotvec([-1.4 * min(seconds, 1.0), 0, 0])
    return replace(view, places=view.places @ turn.as_matrix().T)


def sitting(view, seconds):
    """On a chair after a second."""
    places, share = view.places.copy(), min(seconds, 1.0)
    for side in ("left", "right"):
        hip, knee = joints.INDEX[f"{side}_hip"], joints.INDEX[f"{side}_knee"]
        thigh = np.linalg.norm(places[knee] - places[hip])
        shift = share * (places[hip] + (0, 0, thigh) - places[knee])
        for name in ("knee", "ankle", "foot"):
            places[joints.INDEX[f"{side}_{name}"]] += shift
    return replace(view, places=places)


@pytest.mark.parametrize(
    ("view", "state"),
    [
        (lambda now, begin: lying(swinging(now), now - begin), "following"),
        (lambda now, begin: sitting(swinging(now), now - begin), "following"),
        (lambda now, begin: turned(swinging(now), now - begin), "following"),
        (lambda now, begin: swinging(begin) if (now - begin) % 1 < 0.04 else None, "holding"),
    ],
    ids=["lies down", "sits", "turns the back", "a detector at 1 Hz"],
)
def test_unusual_people_and_a_slow_detector_are_followed_or_held_without_a_jerk(scene, view, state):
    scene.run(1.5, lambda now: (swinging(now),))
    begin = scene.seconds
    scene.run(1.6, lambda now: None if (seen := view(now, begin)) is None else (seen,))
    robot = scene.node._robot
    assert np.isfinite(scene.positions).all() and robot.unsolved == 0
    assert scene.node._state.startswith(state)
    speeds = np.diff(scene.positions, axis=0) * RATE
    assert np.abs(np.diff(speeds, axis=0)).max() * RATE < toy_robot.robot().acceleration * (1 + 1e-6)


def turned(view, seconds):
    """Turned by up to 180 degrees about the vertical, in 2 s."""
    angle = np.pi * min(seconds / 2, 1.0)
    return replace(view, places=view.places @ Rotation.from_rotvec([0, angle, 0]).as_matrix().T)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"robot": "g7"}, "expected g1, h1"),
        ({"robot": "g1", "rate": 1.0}, "rate is 1 Hz; expected 20 to 1000"),
        ({"robot": "g1", "commands": "torque"}, "expected joint_state or trajectory"),
    ],
)
def test_a_parameter_that_is_wrong_is_said(given, words, context):
    with pytest.raises(RobotError, match=words):
        ImitateNode(
            context=context, parameter_overrides=[Parameter(name, value=value) for name, value in given.items()]
        )
