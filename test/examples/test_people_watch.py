"""What `lassokin_ros.watch` and the examples take for known, without processes."""

import ast
import importlib.util
import sys
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

import robots  # noqa: E402
from geometry_msgs.msg import PointStamped  # noqa: E402
from rclpy.clock import ClockType  # noqa: E402
from rclpy.time import Time  # noqa: E402
from robots import EXAMPLES, LATE_TF, ROOT, load, report  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402
from std_msgs.msg import String  # noqa: E402

from lassokin_ros.watch import PeopleWatch, Stillness, covariance, points, position  # noqa: E402
from msg_adapters.backends import RclpyBackend  # noqa: E402
from msg_adapters.output_messages.clouds import JointsReport, SkeletonCloudBuilder  # noqa: E402

NOW_S = 1000.0
MOST_LINES = {
    "follow_person": 25,
    "safety_zone": 35,
    "imitate_arm": 35,
    "pointing": 35,
    "retarget_hand": 35,
    **dict.fromkeys(("gmr_live", "humanoid_in_mujoco", "imitate_arm_joints"), 60),  # with a model of the robot
}
"""Lines of code of an example, if not 40."""


class Node:
    """The parts of a node that a watch and the examples use, with a clock that is set."""

    def __init__(self):
        self.now_s, self.calls, self.timers, self.log, self.sent = NOW_S, {}, [], [], []
        self.publisher = SimpleNamespace(publish=self.sent.append)

    def get_clock(self):
        return SimpleNamespace(now=lambda: Time(nanoseconds=round(self.now_s * 1e9), clock_type=ClockType.ROS_TIME))

    def get_logger(self):
        def log(text, **_):
            self.log.append(text)

        return SimpleNamespace(warn=log, warning=log)

    def create_subscription(self, _, topic, callback, __):
        self.calls[topic] = callback

    def create_timer(self, period, callback, clock):
        self.timers.append(callback)

    def resolve_topic_name(self, topic):
        return f"/robot/{topic}"


@pytest.fixture
def node():
    return Node()


@pytest.fixture
def transforms(monkeypatch):
    """A function that makes a transform known, with tf2_ros and tf2_geometry_msgs replaced."""
    buffers = []
    for name in ("tf2_ros", "tf2_geometry_msgs"):
        spec = importlib.util.spec_from_file_location(name, LATE_TF / name / "__init__.py")
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, name, module)
        spec.loader.exec_module(module)
    tf = sys.modules["tf2_ros"]
    monkeypatch.setattr(tf, "TransformListener", lambda buffer, _: buffers.append(buffer))

    def send(stamp_s, parent="camera", child="odom", **pose):
        buffers[0].set_transform(robots.transform(round(stamp_s * 1e9), parent, child, **pose))

    return send


def people(stamp_s=NOW_S, *reports, frame="camera", untracked=None):
    """A ~/people of these people, of one by default if nobody is untracked."""
    everybody = reports or [report()] * (untracked is None)
    return robots.people(round(stamp_s * 1e9), frame, *everybody, untracked=untracked or 0)


def cloud(stamp_s):
    """A ~/skeleton of which only the stamp is read."""
    message = PointCloud2()
    message.header.stamp = Time(nanoseconds=round(stamp_s * 1e9)).to_msg()
    return message


@pytest.mark.parametrize("ahead_s, known", [(-0.6, False), (-0.4, True), (0.0, True), (0.05, True), (0.45, False)])
def test_people_of_another_clock_are_not_known(node, ahead_s, known):
    """Nor do those of the future become known after the tracker has died."""
    watch = PeopleWatch(node)
    node.calls["tracker/people"](people(NOW_S + ahead_s))
    node.calls["tracker/state"](String(data="tracking"))
    assert (watch.known, watch.state, len(watch.tracked())) == ((True, "tracking", 1) if known else (False, "lost", 0))
    assert len(node.log) == (ahead_s > 0.1) and all("s ahead" in text for text in node.log)
    for node.now_s in np.arange(NOW_S, NOW_S + 1.5, 0.05) if not known else ():
        assert not watch.known and len(watch.everybody()) == 0
    node.calls["tracker/people"](people(node.now_s))
    assert watch.known


@pytest.mark.parametrize(
    "ahead_s, words", [(-0.6, "is 0.6 s old"), (-0.4, ""), (0.05, ""), (0.3, "0.3 s ahead"), (3600.0, "3600.0 s ahead")]
)
def test_a_transform_of_another_clock_places_nobody(node, transforms, ahead_s, words):
    watch = PeopleWatch(node, frame="camera")
    node.calls["tracker/people"](people(frame="odom"))
    assert not watch.known  # without TF
    node.log.clear()
    transforms(NOW_S + ahead_s)
    assert watch.known == (words == "")
    assert all(words in text for text in node.log) and len(node.log) == bool(words)
    for node.now_s in NOW_S + ahead_s + np.arange(0, 0.5, 0.1):  # the publisher of TF has died
        if ahead_s > 0.1:
            node.calls["tracker/people"](people(node.now_s, frame="odom"))
            assert not watch.known


def test_a_skeleton_is_delivered_if_people_of_its_image_are_certain_in_any_order(node):
    got = []
    PeopleWatch(node).subscribe("skeleton", got.append)
    skeleton, everybody = node.calls["tracker/skeleton"], node.calls["tracker/people"]
    first, second, third = cloud(NOW_S - 0.2), cloud(NOW_S - 0.1), cloud(NOW_S)
    skeleton(first)
    skeleton(second)
    assert not got  # nothing is known about their person
    everybody(people(NOW_S - 0.2))
    everybody(people(NOW_S - 0.1))
    everybody(people(NOW_S))
    skeleton(third)
    skeleton(cloud(NOW_S - 0.05))
    assert got == [first, second, third]


@pytest.mark.parametrize("people_first", [False, True])
@pytest.mark.parametrize(
    "age_s, seen, delivered",
    [
        *((age_s, [report()], 1) for age_s in (0.4, 0.0, -0.05)),
        *((age_s, [report()], 0) for age_s in (0.6, -0.3)),
        *((0.0, [report(**doubt)], 0) for doubt in ({"guessed": True}, {"doubtful": True}, {"tracked": False})),
        (0.0, [report(), report(id="p2", doubtful=True)], 0),  # ~/skeleton may be that of either
        (0.0, [report(locked=True), report(id="p2", doubtful=True)], 1),  # it is that of the locked person
    ],
)
def test_a_skeleton_of_another_time_or_in_doubt_is_not_delivered(node, age_s, seen, delivered, people_first):
    got = []
    PeopleWatch(node).subscribe("skeleton", got.append)
    sent = [("tracker/skeleton", cloud(NOW_S - age_s)), ("tracker/people", people(NOW_S - age_s, *seen))]
    for topic, message in reversed(sent) if people_first else sent:
        node.calls[topic](message)
    assert len(got) == delivered


def test_silence_is_logged_with_the_name_of_the_topic(node):
    PeopleWatch(node)
    (check,) = node.timers
    check()
    check()
    assert len(node.log) == 2 and all("nothing was received on /robot/tracker/people" in text for text in node.log)
    node.calls["tracker/people"](people())
    check()
    assert len(node.log) == 2
    check()
    assert len(node.log) == 3


def test_an_output_that_does_not_come_while_somebody_is_tracked_is_logged(node):
    """With max_people above 1 it is that of the locked person."""
    PeopleWatch(node).subscribe("skeleton", [].append)
    (check,) = node.timers
    for reports, received, logged in [
        ([report()], False, 0),  # discovery may take a moment
        ([report()], True, 0),
        ([report()], False, 0),
        ([report(doubtful=True)], False, 0),
        ([report()], False, 0),
        ([report(), report(place=(1.0, 0.0, 3.0))], False, 1),
    ]:
        node.calls["tracker/people"](people(NOW_S, *reports))
        if received:
            node.calls["tracker/skeleton"](cloud(NOW_S))
        check()
        assert len(node.log) == logged
    assert "nothing was received on /robot/tracker/skeleton" in node.log[0] and "~/lock" in node.log[0]


def test_people_are_predicted_to_now_with_a_covariance(node):
    watch = PeopleWatch(node)
    walking = report(velocity=np.array([1.0, 0, 0]), age=0.1, velocity_covariance=0.04 * np.eye(3))
    lost = report(id="p2", tracked=False, velocity=np.array([1.0, 0, 0]), velocity_covariance=np.eye(3))
    node.calls["tracker/people"](people(NOW_S, walking, lost))
    assert watch.stamp.nanoseconds == round(NOW_S * 1e9)
    node.now_s += 0.1
    (one,) = watch.predicted()
    assert position(one) == pytest.approx([0.2, 0, 3.0])
    assert covariance(one) == pytest.approx((0.1**2 + 0.2**2 * 0.04) * np.eye(3))
    later = Time(nanoseconds=round((NOW_S + 0.4) * 1e9), clock_type=ClockType.ROS_TIME)
    both = watch.predicted(later, watch.everybody())
    assert sorted(both["x"].tolist()) == pytest.approx([0.0, 0.5])  # who is lost stays


def test_joints_come_in_the_frame_of_the_watch_and_with_their_person(node, transforms):
    watch, got = PeopleWatch(node, frame="base"), []
    watch.subscribe("skeleton", got.append)
    turns = np.tile([0.0, 0, 0, 1], (24, 1))
    sizes, yes = np.ones(24), np.ones(24, dtype=bool)
    spread = np.tile(np.diag([0.01, 0.04, 0.09]), (24, 1, 1))
    places, speeds = np.tile([1.0, 2, 3], (24, 1)), np.tile([1.0, 0, 0], (24, 1))
    body = JointsReport(7, places, speeds, spread, yes, yes, yes, sizes, sizes, turns, np.array([0.0, -1, 0]))
    message = SkeletonCloudBuilder(RclpyBackend(), 24).fill(round(NOW_S * 1e9), "camera", body)
    node.calls["tracker/people"](people(NOW_S, report(id="p7")))
    node.calls["tracker/skeleton"](message)
    assert got == [message] and watch.whose(message) == 7 and watch.whose(cloud(NOW_S + 1)) is None
    assert watch.joints(message) is None and "expected 'base'" in node.log[-1]
    transforms(NOW_S, "base", "camera", place=(0.0, 0.0, 1.0), turn=(-0.5, 0.5, -0.5, 0.5))  # optical to z up
    joint = watch.joints(message)[5]
    assert position(joint) == pytest.approx([3, -1, -1]) and covariance(joint) == pytest.approx(
        np.diag([0.09, 0.01, 0.04])
    )
    assert [joint[name] for name in ("vx", "vy", "vz")] == pytest.approx([0, -1, 0], abs=1e-6)
    assert [joint[name] for name in ("up_x", "up_y", "up_z")] == pytest.approx([0, 0, 1], abs=1e-6)
    assert [joint[name] for name in ("qx", "qy", "qz", "qw")] == pytest.approx([-0.5, 0.5, -0.5, 0.5])


def test_a_point_is_still_if_it_has_not_moved_for_the_whole_time():
    still = Stillness(seconds=0.5)

    def moved(at_s, x=1.0):
        return still.moved(Time(nanoseconds=round(at_s * 1e9)).to_msg(), np.array([x, 0, 0]))

    assert [moved(10 + i / 10) for i in range(5)] == [np.inf] * 5
    assert moved(10.5) == 0 and moved(10.6, 1.2) == pytest.approx(0.2)
    assert [moved(10.6 + i / 10, 1.2) for i in range(1, 7)] == pytest.approx([0.2] * 4 + [0, 0])
    assert moved(12.0, 1.2) == np.inf  # after a gap


@pytest.mark.parametrize(
    "state, reports, untracked, discs",
    [
        ("nobody", [], 0, 0),
        ("lost", [], 0, None),
        ("tracking", [{}], 0, 1),
        ("lost", [{"tracked": False, "out_of_view": True, "deviation_m": 0.6}], 0, 1),
        ("tracking", [{}], 1, None),  # somebody is there whose place is not known
    ],
)
def test_a_costmap_has_everybody_or_nothing(node, state, reports, untracked, discs):
    module = load("costmap")
    watch = PeopleWatch(node)
    node.calls["tracker/people"](people(NOW_S, *(report(**one) for one in reports), untracked=untracked))
    node.calls["tracker/state"](String(data=state))
    module.Costmap.on_timer(SimpleNamespace(watch=watch, publisher=node.publisher, get_clock=node.get_clock))
    if discs is None:
        assert not node.sent
        return
    found = points(node.sent[0])
    assert (len(found) > 0) == bool(discs) and node.sent[0].header.frame_id == "camera"
    if discs:
        doubt = reports[0].get("deviation_m", 0.1)
        assert position(found)[0].max() == pytest.approx(0.3 + 2 * doubt, abs=0.11)


def test_the_locked_person_alone_is_followed(node):
    watch, near, far = PeopleWatch(node), (0.0, 0.0, 2.0), (0.0, 0.0, 4.0)

    def followed(*reports, state="tracking", untracked=0):
        node.calls["tracker/people"](people(NOW_S, *reports, untracked=untracked))
        node.calls["tracker/state"](String(data=state))
        return watch.followed()["z"].tolist()

    assert followed(report(near), report(far)) == [2.0, 4.0]
    assert followed(report(near), report(far, locked=True)) == [4.0]
    assert followed(report(near), report(far, locked=True, tracked=False), state="lost") == []
    assert followed(report(near, guessed=True), report(far, doubtful=True), report((0.0, 0.0, 5.0))) == [5.0]
    assert followed(report(near), report(far, locked=True, guessed=True)) == []
    assert followed(report(near), state="lost") == []  # the locked person is not in the message any more
    assert followed(report(near), untracked=2) == [2.0] and len(watch.everybody()) == 3 and len(watch.tracked()) == 1
    assert not watch.everybody()["tracked"][1:].any()


@pytest.mark.parametrize("reads", range(5))
def test_a_message_that_becomes_old_while_it_is_read_is_no_error(node, reads):
    watch, times = PeopleWatch(node), iter([NOW_S + 0.499] * reads + [NOW_S + 0.501] * 9)
    node.calls["tracker/people"](people(NOW_S, report()))
    node.calls["tracker/state"](String(data="tracking"))
    watch.age = lambda header: next(times) - NOW_S
    assert len(watch.followed()) in (0, 1) and watch.followed().dtype == watch.everybody().dtype


@pytest.mark.parametrize(
    "state, reports, untracked, old, verdict",
    [
        ("nobody", [], 0, False, "safe"),
        ("tracking", [report((0.0, 0.0, 7.0))], 0, False, "safe"),
        ("tracking", [report((0.0, 0.0, 2.0))], 0, False, "occupied"),
        ("tracking", [report((0.0, 0.0, 4.0), 1.0)], 0, False, "occupied"),  # two deviations reach into the zone
        ("tracking", [report((0.0, 0.0, 7.0))], 1, False, "unknown"),  # somebody is there who is not tracked
        ("tracking", [report((0.0, 0.0, 2.0))], 1, False, "occupied"),
        ("tracking", [], 1, False, "unknown"),
        ("lost", [], 0, False, "unknown"),
        ("lost", [report(tracked=False)], 0, False, "unknown"),
        ("tracking", [report((0.0, 0.0, 7.0)), report((0.0, 0.0, 7.0), id="p2", tracked=False)], 0, False, "unknown"),
        ("tracking", [], 0, False, "unknown"),  # ~/state and ~/people contradict each other for a moment
        ("tracking", [report((0.0, 0.0, 2.0))], 0, True, "unknown"),  # listed, but the place is too old to be used
    ],
)
def test_a_zone_is_safe_only_if_the_images_show_it(node, state, reports, untracked, old, verdict):
    watch = PeopleWatch(node)
    node.calls["tracker/people"](people(NOW_S, *reports, untracked=untracked))
    node.calls["tracker/state"](String(data=state))
    node.now_s += old
    assert load("safety_zone").SafetyZone.verdict(SimpleNamespace(people=watch)) == verdict


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_short_and_can_be_started_in_a_namespace(name):
    """Its topics, and the names of trackers, are relative. Empty lines, comments and docstrings do not count."""
    text, documented = (ROOT / "examples" / f"{name}.py").read_text(encoding="utf-8"), set()
    for part in ast.walk(ast.parse(text)):
        if isinstance(part, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(part) is not None:
            documented |= set(range(part.body[0].lineno, part.body[0].end_lineno + 1))
    lines = [line.strip() for i, line in enumerate(text.splitlines(), 1) if i not in documented]
    assert sum(bool(line) and line[0] != "#" for line in lines) <= MOST_LINES.get(name, 40)
    assert '"/' not in text


@pytest.mark.parametrize(
    "left, right, expected",
    [
        ([report((3.6, 1.2, 1.0))], [], [3.6, 1.2, 1.0]),
        ([report((3.6, 1.2, 1.0))], [report((3.8, 1.2, 1.0))], [3.7, 1.2, 1.0]),
        ([report((3.6, 1.2, 1.0))], [report((3.9, 1.2, 1.0), 0.2)], [3.66, 1.2, 1.0]),  # weighted by 4 to 1
        ([report((3.6, 1.2, 1.0))], [report((3.8, 1.2, 1.0), guessed=True)], [3.6, 1.2, 1.0]),
        ([report((3.6, 1.2, 1.0))], [report((4.6, -1.6, 1.0))], None),
        ([report((3.6, 1.2, 1.0), guessed=True)], [], None),
        ([], [], None),
    ],
)
def test_two_cameras_merge_one_person_only(left, right, expected):
    node, module = Node(), load("two_cameras")
    node.cameras = [PeopleWatch(node, f"{side}/tracker", frame="base_link") for side in ("left", "right")]
    for side, seen in (("left", left), ("right", right)):
        if seen:
            node.calls[f"{side}/tracker/people"](people(NOW_S, *seen, frame="base_link"))
            node.calls[f"{side}/tracker/state"](String(data="tracking"))
    module.TwoCameras.on_timer(node)
    assert node.log == (["the cameras follow two people"] if left and right and expected is None else [])
    points = [[message.point.x, message.point.y, message.point.z] for message in node.sent]
    assert points == ([] if expected is None else [pytest.approx(expected, abs=1e-5)])


def test_a_wrist_of_the_future_does_not_block_those_of_now(node, transforms):
    module, known = load("wrist_in_base"), []
    node.buffer = SimpleNamespace(can_transform=lambda _, __, stamp: stamp in known, transform=lambda wrist, _: wrist)
    node.waiting = deque()
    for stamp_s in (NOW_S + 12, NOW_S - 0.6, NOW_S - 0.1, NOW_S):
        node.waiting.append(PointStamped())
        node.waiting[-1].header.stamp = Time(nanoseconds=round(stamp_s * 1e9)).to_msg()
    *_, old, now = node.waiting
    known.append(old.header.stamp)
    module.WristInBase.on_timer(node)
    assert node.sent == [old] and list(node.waiting) == [now]  # TF is late
    assert len(node.log) == 2 and "dropped" in node.log[0]
    known.append(now.header.stamp)
    module.WristInBase.on_timer(node)
    assert node.sent == [old, now] and not node.waiting
