"""The examples of docs/robots.md with the real tracker: late TF, old keypoints, another frame, a process that dies."""

import ast
import importlib.util
import os
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from forked import Forked  # noqa: E402
from geometry_msgs.msg import PointStamped, PoseArray, PoseWithCovarianceStamped, TransformStamped, Twist  # noqa: E402
from live import BACKEND, NO_HANDLERS, NodeProcess  # noqa: E402
from messages import FRAME, camera_info, cloud, crowd, pixels_of_motion, raw_cloud  # noqa: E402
from rcl_interfaces.msg import Log  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import CameraInfo, PointCloud2  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402

from lassokin_ros.watch import points  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
LATE_TF = ROOT / "test" / "support" / "late_tf"
DEADLINE_S, STOP_S = 40.0, 0.6
HEIGHT = ("-p", "height:=1.75")
PIXELS = pixels_of_motion(40, 20.0)
NEAR = PIXELS.mean(axis=1, keepdims=True) + 1.5 * (PIXELS - PIXELS.mean(axis=1, keepdims=True))
NOWHERE = np.full((17, 2), np.nan)
MOST_LINES = {
    "follow_person": 25,
    "safety_zone": 35,
    "imitate_arm": 35,
    "wrist_in_base": 40,
    "two_cameras": 40,
    "pointing": 35,
    "retarget_hand": 35,
    **dict.fromkeys(("gmr_live", "humanoid_in_mujoco", "imitate_arm_joints"), 60),  # with a model of the robot
}


def drives(command):
    return command.linear.x != 0 or command.angular.z != 0


SCENES = {
    "follow_person": (Twist, "cmd_vel", drives),
    "imitate_arm": (PoseWithCovarianceStamped, "arm_target", bool),
    "safety_zone": (String, "zone", lambda message: message.data == "safe"),
    "wrist_in_base": (PointStamped, "right_wrist", bool),
    "two_cameras": (PointStamped, "person", bool),
    "raised_hand": (Log, "/rosout", lambda m: m.name == "raised_hand" and "left hand raised" in m.msg),
}
"""Message type, topic, and whether a message makes the robot do something."""


ONE_PERSON = ("follow_person", "imitate_arm", "wrist_in_base")
"""Examples that do something for the person before one camera."""


class Robot:
    """Camera, detector and TF of a robot, and the outputs of an example by the time of their publication."""

    def __init__(self, trackers=("/",)):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=NO_HANDLERS)
        self.node = rclpy.create_node("robot", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        create = self.node.create_publisher
        self._keypoints = [create(PointCloud2, f"{space.rstrip('/')}/keypoints", 10) for space in trackers]
        self._cameras = [create(CameraInfo, f"{space.rstrip('/')}/camera_info", 10) for space in trackers]
        self._tf = create(TransformStamped, "/late_tf", 10)
        self.tf_late_s, self.keypoints_late_s, self.pixels = 0.1, 0.0, PIXELS
        self.transform = base_to_camera
        self.detects, self.sent, self.fresh_ns = True, 0, 0
        self.numbers = ()
        self.published = {}  # topic: [(time of publication in ns, message)]
        self.node.create_timer(0.05, self._detect)
        self.node.create_timer(0.02, self._send_tf)

    def listen(self, message_type, topic):
        got = self.published[topic] = []

        def take(message, info):
            got.append((info["source_timestamp"], message))

        self.node.create_subscription(message_type, topic, take, 100)

    def _detect(self):
        if not self.detects:
            return
        self.fresh_ns = time.time_ns()
        stamp_ns = self.fresh_ns - round(1e9 * self.keypoints_late_s)
        for camera, keypoints in zip(self._cameras, self._keypoints):
            if self.sent % 20 == 0:
                camera.publish(camera_info(BACKEND))
            one = self.pixels[self.sent % len(self.pixels)]
            people = [(one + [shift, 0], np.full(17, sure)) for shift, sure in ((0, 0.9), (200, 0.6)) if self.numbers]
            message = crowd(BACKEND, stamp_ns, people, self.numbers) if people else cloud(BACKEND, stamp_ns, one)
            keypoints.publish(message)
        self.sent += 1

    def _send_tf(self):
        if self.transform is not None:
            self._tf.publish(self.transform(time.time_ns() - round(1e9 * self.tf_late_s)))

    def forget(self):
        """Forget what was published."""
        for got in self.published.values():
            got.clear()

    def spin_until(self, condition, what):
        end = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < end, f"{what} did not come"
            self._executor.spin_once(timeout_sec=0.05)

    def spin_for(self, seconds):
        end = time.monotonic() + seconds
        self.spin_until(lambda: time.monotonic() > end, "the time")

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


def transform(stamp_ns, parent, child, place, turn):
    """A TransformStamped of a place (3,) m and a quaternion x, y, z, w."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    for name, value in zip("xyz", place):
        setattr(message.transform.translation, name, value)
    for name, value in zip("xyzw", turn):
        setattr(message.transform.rotation, name, value)
    return message


def base_to_camera(stamp_ns):
    """base_link to the camera, which looks forward from 1 m."""
    return transform(stamp_ns, "base_link", FRAME, (0.0, 0.0, 1.0), (-0.5, 0.5, -0.5, 0.5))


def odom_in_camera(stamp_ns):
    """The camera at (6, 4, 1) m in odom looks along x."""
    return transform(stamp_ns, FRAME, "odom", (4.0, 1.0, -6.0), (0.5, -0.5, 0.5, 0.5))


def camera_in_odom(stamp_ns):
    """The same transform, the other way round."""
    return transform(stamp_ns, "odom", FRAME, (6.0, 4.0, 1.0), (-0.5, 0.5, -0.5, 0.5))


@contextmanager
def running(name, robot, *arguments):
    """The process of an example, ended by SIGKILL."""
    path = [str(LATE_TF), str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, path))}
    command = [sys.executable, f"examples/{name}.py", "--ros-args", "-p", f"camera_frame:={FRAME}", *arguments]
    process = Forked(command, ROOT, environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    try:
        yield process
        assert process.poll() is None
    finally:
        process.kill()
        said = process.communicate()[0]
    assert "Traceback" not in said, said


@pytest.fixture
def robot(request):
    params = getattr(request.node, "callspec", SimpleNamespace(params={})).params
    spaces = ("/left", "/right") if params.get("names") == ("two_cameras",) else ("/",)
    result = Robot(spaces)
    result.spaces = spaces
    yield result
    result.close()


@contextmanager
def trackers(robot, *arguments):
    """A tracker for each camera, with these ROS arguments."""
    nodes = [NodeProcess(space, *arguments) for space in robot.spaces]
    try:
        yield nodes
    finally:
        for node in nodes:
            with suppress(ProcessLookupError):
                node.process.kill()
            node.process.communicate()


def acts(robot, name, active=None):
    """Publication times, ns, of the messages of an example that make the robot do something; or that are `active`."""
    _, topic, usual = SCENES[name]
    return [time_ns for time_ns, message in robot.published[topic] if (active or usual)(message)]


def lines_of_code(path):
    """Lines that are neither empty, nor a comment, nor part of a docstring."""
    text = path.read_text(encoding="utf-8")
    documented = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(node) is not None:
            documented |= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    lines = enumerate(text.splitlines(), 1)
    return sum(bool(line.strip()) and line.strip()[0] != "#" and i not in documented for i, line in lines)


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "examples").glob("*.py")))
def test_an_example_is_short(name):
    assert lines_of_code(ROOT / "examples" / f"{name}.py") <= MOST_LINES.get(name, 40)


def stopped_after(acts_ns, since_ns):
    """s from a time to the last action, without the delay of a busy machine: up to 0.2 s of the longest pause between
    the last second's actions beyond the usual one.
    """
    last = np.sort([at for at in acts_ns if at > max(acts_ns) - 10**9])
    pauses = np.diff(last) * 1e-9
    late = min(pauses.max() - np.median(pauses), 0.2) if len(pauses) else 0.0
    return (last[-1] - since_ns) * 1e-9 - late


def test_the_delay_of_a_busy_machine_is_not_that_of_a_stop():
    regular = np.arange(31) * 20_000_000
    assert stopped_after(regular, 0) == pytest.approx(0.6)
    assert stopped_after([*regular, regular[-1] + 120_000_000], 0) == pytest.approx(0.72 - 0.1)
    assert stopped_after([*regular, regular[-1] + 500_000_000], 0) == pytest.approx(1.1 - 0.2)


@pytest.mark.parametrize("names", [ONE_PERSON, ("safety_zone",), ("two_cameras",)], ids=",".join)
def test_a_robot_stops(robot, names):
    """In time when the detector dies and when the tracker is killed; and it never moves by old keypoints."""
    if names == ("safety_zone",):
        robot.pixels = [NOWHERE]

    def all_act(count):
        return all(len(acts(robot, name)) > count for name in names)

    with ExitStack() as stack:
        for name in names:
            robot.listen(*SCENES[name][:2])
            stack.enter_context(running(name, robot))
        robot.spin_for(1.0)
        assert not any(acts(robot, name) for name in names)  # without a tracker
        with trackers(robot) as nodes:
            robot.spin_until(lambda: all_act(10), "a first action")
            robot.detects = False  # the detector is dead
            robot.spin_for(1.5)
            assert max(stopped_after(acts(robot, name), robot.fresh_ns) for name in names) < STOP_S
            robot.forget()
            robot.detects = True
            robot.spin_until(lambda: all_act(5), "an action with the detector back")
            for node in nodes:
                node.process.kill()
            killed_ns = time.time_ns()
            robot.spin_for(1.5)
            assert max(stopped_after(acts(robot, name), killed_ns) for name in names) < STOP_S
        robot.forget()
        robot.keypoints_late_s, late_ns = 1.5, time.time_ns()
        with trackers(robot):
            answers = []
            people = f"{robot.spaces[0].rstrip('/')}/tracker/people"
            robot.node.create_subscription(PointCloud2, people, answers.append, 10)
            robot.spin_until(lambda: sum(m.width for m in answers) > 20 or names == ("safety_zone",), "old people")
            robot.spin_for(2.0)
            assert not [at for name in names for at in acts(robot, name) if at > late_ns]  # earlier ones may come late


STILL = {
    "costmap": (PointCloud2, "people_obstacles"),
    "gaze": (PointStamped, "gaze"),
    "hand_over": (PointStamped, "hand"),
}


def test_costmap_gaze_and_hand_over_beside_one_tracker(robot):
    """TF late, numbers exchanged, the detector dead, the tracker killed. The person stands still, and is locked."""
    for kind in STILL.values():
        robot.listen(*kind)
    got = {name: robot.published[topic] for name, (_, topic) in STILL.items()}
    robot.pixels = PIXELS[0] + np.random.default_rng(0).normal(0, 0.5, PIXELS.shape)
    robot.numbers, robot.transform = (7, 9), None
    frame = ("-p", "frame:=base_link")
    with ExitStack() as stack:
        for name in STILL:
            stack.enter_context(running(name, robot, *frame))
        (node,) = stack.enter_context(trackers(robot, *HEIGHT, "-p", "lock:=true", "-p", "max_people:=2"))
        people, lock = [], robot.node.create_client(SetBool, "/tracker/lock")
        robot.node.create_subscription(PointCloud2, "/tracker/people", people.append, 10)

        def all_have(count):
            """Whether each example has sent more. A pause of this busy process is a silence of the detector."""
            if people and (points(people[-1])["locked"] & points(people[-1])["guessed"]).any():
                lock.call_async(SetBool.Request(data=True))  # the one who is detected best, as before
            return all(len(messages) > count.get(name, 0) + 5 for name, messages in got.items())

        robot.spin_until(lambda: sum(message.width for message in people) > 40, "people")
        robot.transform, robot.tf_late_s = base_to_camera, 2.0
        robot.spin_for(1.0)
        assert not any(got.values())  # TF is too late
        robot.tf_late_s = 0.1
        robot.spin_until(lambda: all_have({}), "all outputs")
        assert {messages[-1][1].header.frame_id for messages in got.values()} == {"base_link"}
        head, hand = got["gaze"][-1][1].point, got["hand_over"][-1][1].point
        assert 0 < head.z - hand.z < 1.2 and np.hypot(head.x - hand.x, head.y - hand.y) < 1.2
        robot.numbers = (9, 7)
        counts = {name: len(messages) for name, messages in got.items()}
        robot.spin_until(lambda: all_have(counts), "the outputs afterwards")
        for name, before in ("gaze", head), ("hand_over", hand):
            after = [message.point for _, message in got[name][counts[name] :]]
            assert max(np.hypot(point.x - before.x, point.y - before.y) for point in after) < 0.4, name
        robot.detects = False
        robot.spin_for(STOP_S + 1.0)

        def published_after(since_ns):
            """Names and messages of what was published after a stop, and a moment for what was under way."""
            limit_ns = since_ns + round(1e9 * (STOP_S + 0.4))
            return [(name, message) for name, messages in got.items() for at, message in messages if at > limit_ns]

        after = published_after(robot.fresh_ns)
        assert {name for name, _ in after} == {"costmap"}
        assert all(message.width > 0 for _, message in after)  # somebody may be there
        robot.forget()
        robot.detects = True
        robot.spin_until(lambda: got["costmap"] and got["costmap"][-1][1].width > 0, "people again")
        node.process.kill()
        killed_ns = time.time_ns()
        robot.spin_for(STOP_S + 1.0)
        assert not published_after(killed_ns)


def test_a_zone_with_a_person_is_occupied_and_then_unknown(robot, name="safety_zone"):
    """The synthetic person is nearer than the zone's radius, the reach and the doubt together."""
    robot.listen(String, "zone")
    robot.pixels = NEAR
    with running(name, robot), trackers(robot):
        robot.spin_until(lambda: acts(robot, name, lambda m: m.data == "occupied"), "a person in the zone")
        robot.forget()
        robot.pixels = [NOWHERE]  # the person is lost, and may be anywhere
        robot.spin_until(lambda: acts(robot, name), "an empty zone")
        words = [message.data for _, message in robot.published["zone"]]
        assert words.count("unknown") > 10 and "safe" not in words[: words.index("unknown")]


RAISED = PIXELS.copy()
"""The same person, with the left arm (shoulder 5, elbow 7, wrist 9) straight up. 1 m is about 160 px."""
RAISED[:, 7], RAISED[:, 9] = PIXELS[:, 5] + [15, -45], PIXELS[:, 5] + [15, -85]


def test_a_raised_hand_in_old_keypoints_is_not_logged(robot, name="raised_hand"):
    robot.listen(*SCENES[name][:2])
    skeletons = []
    robot.node.create_subscription(PointCloud2, "/tracker/skeleton", skeletons.append, 10)
    robot.pixels, robot.keypoints_late_s = RAISED, 1.5
    with running(name, robot), trackers(robot):
        robot.spin_until(
            lambda: len(robot.node.get_subscriptions_info_by_topic("/tracker/skeleton")) == 2, "the example"
        )
        robot.spin_until(lambda: len(skeletons) > 20, "old skeletons")
        robot.spin_for(1.5)
        assert not acts(robot, name)
        robot.keypoints_late_s = 0.0
        robot.spin_until(lambda: acts(robot, name), "a raised hand")


PERSON_FIELDS = {
    **dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "xx", "xy", "xz", "yy", "yz", "zz", "confidence", "age"), "<f4"),
    **dict.fromkeys(("person", "tracked", "detector_id", "guessed", "doubtful", "locked"), "<i4"),
}


def people_message(frame_id, **values):
    """A ~/people of now with one tracked person, with a deviation of 1 cm."""
    point = np.zeros(1, list(PERSON_FIELDS.items()))
    for name, value in {"xx": 1e-4, "yy": 1e-4, "zz": 1e-4, "tracked": 1, **values}.items():
        point[name] = value
    fields = [(name, 4 * i, 7 if kind == "<f4" else 5) for i, (name, kind) in enumerate(PERSON_FIELDS.items())]
    return raw_cloud(BACKEND, time.time_ns(), point.tobytes(), fields, point.itemsize, 1, frame_id)


def test_a_person_in_a_fixed_frame_is_placed_by_tf_or_unknown(robot, names=("safety_zone", "follow_person")):
    """2 m in front of the camera and 0.2 m to the left, far from the origin of odom: never safe, and never behind."""
    robot.detects, robot.transform = False, None
    people = robot.node.create_publisher(PointCloud2, "/tracker/people", 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    robot.node.create_publisher(String, "/tracker/state", latched).publish(String(data="tracking"))
    robot.node.create_timer(0.05, lambda: people.publish(people_message("odom", x=8.0, y=4.2, z=1.0)))

    def right(message):
        if isinstance(message, String):
            return message.data == "occupied"
        forward, turn = message.linear.x, message.angular.z
        return 0 < forward <= 0.25 + 1e-3 and turn == pytest.approx(np.arctan2(0.2, 2.0), abs=1e-3)

    with ExitStack() as stack:
        for name in names:
            robot.listen(*SCENES[name][:2])
            stack.enter_context(running(name, robot))
        robot.spin_until(lambda: people.get_subscription_count() == 2 and all(robot.published.values()), "the examples")
        robot.spin_for(1.0)  # without TF
        robot.transform, robot.tf_late_s = odom_in_camera, 2.0
        robot.spin_for(1.5)  # with old TF
        assert all(len(got) > 15 for got in robot.published.values())
        assert not any(acts(robot, name) or acts(robot, name, right) for name in names)
        robot.tf_late_s = 0.1
        robot.spin_until(lambda: all(len(acts(robot, name, right)) > 5 for name in names), "an action")
        for name in names:
            _, topic, active = SCENES[name]
            assert all(right(message) for _, message in robot.published[topic] if active(message))


@pytest.mark.skipif(importlib.util.find_spec("tf2_msgs") is None, reason="tf2_msgs is not installed: `make messages`")
def test_a_person_ahead_is_never_safe_for_a_tracker_with_a_fixed_frame(robot, name="safety_zone"):
    from tf2_msgs.msg import TFMessage

    robot.listen(String, "zone")
    robot.pixels, robot.transform = NEAR, None
    people = []
    robot.node.create_subscription(PointCloud2, "/tracker/people", people.append, 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    tf = robot.node.create_publisher(TFMessage, "/tf_static", latched)
    tf.publish(TFMessage(transforms=[camera_in_odom(0)]))
    with running(name, robot), trackers(robot, "-p", "fixed_frame:=odom"):
        robot.spin_until(lambda: sum(m.width for m in people) > 20, "a person")
        assert people[-1].header.frame_id == "odom"
        robot.forget()
        robot.spin_for(1.0)
        assert {message.data for _, message in robot.published["zone"]} == {"unknown"}
        robot.transform = odom_in_camera
        robot.spin_until(lambda: acts(robot, name, lambda m: m.data == "occupied"), "a person in the zone")
        assert not acts(robot, name)


def person(**fields):
    """A point of ~/people, 4 m in front of the camera: outside of the zone."""
    kinds = [(name, "<f4") for name in ("x", "y", "z", "xx", "xy", "xz", "yy", "yz", "zz")] + [("tracked", "<i4")]
    point = np.zeros(1, kinds)
    for name, value in {"z": 4.0, "tracked": 1, **fields}.items():
        point[name] = value
    return point


NOBODY = person()[:0]


@pytest.mark.parametrize(
    "state, fresh, listed, expected",
    [
        ("nobody", NOBODY, NOBODY, "safe"),
        ("tracking", person(), person(), "safe"),
        ("tracking", person(z=2.0), person(z=2.0), "occupied"),
        ("tracking", person(zz=1.0), person(zz=1.0), "occupied"),  # two deviations reach into the zone
        ("lost", NOBODY, NOBODY, "unknown"),
        ("lost", NOBODY, person(tracked=0), "unknown"),
        ("tracking", NOBODY, person(z=2.0), "unknown"),  # listed as tracked, but the place is too old to be used
        ("tracking", person(), np.concatenate([person(), person(tracked=0)]), "unknown"),
        ("tracking", NOBODY, NOBODY, "unknown"),  # ~/state and ~/people contradict each other for a moment
    ],
)
def test_a_zone_is_safe_only_if_the_images_show_it(state, fresh, listed, expected):
    spec = importlib.util.spec_from_file_location("safety_zone", ROOT / "examples" / "safety_zone.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    watch = SimpleNamespace(state=state, tracked=lambda: fresh, everybody=lambda: listed)
    assert module.SafetyZone.verdict(SimpleNamespace(people=watch)) == expected


@pytest.mark.parametrize("late_s", [0.0, 0.1])
def test_every_wrist_is_published_while_tf_is_late(robot, late_s):
    robot.listen(PointStamped, "right_wrist")
    wrists = robot.published["right_wrist"]
    tracker = robot.node.create_publisher(PoseArray, "/tracker/joints", 200)
    robot.tf_late_s, robot.detects = late_s, False
    stamps = []

    def send():
        from geometry_msgs.msg import Pose

        message = PoseArray(poses=[Pose() for _ in range(24)])
        message.header.frame_id = FRAME
        stamps.append(time.time_ns())
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamps[-1], 10**9)
        message.poses[21].position.z = 3.0
        tracker.publish(message)

    with running("wrist_in_base", robot):
        robot.spin_until(lambda: tracker.get_subscription_count() and robot._tf.get_subscription_count(), "the example")
        robot.spin_for(0.3)
        send()
        robot.spin_until(lambda: wrists, "a first wrist")
        wrists.clear()
        stamps.clear()
        timer = robot.node.create_timer(1 / 60, send)
        robot.spin_until(lambda: len(stamps) >= 100, "100 images")
        timer.cancel()
        robot.spin_until(lambda: len(wrists) >= len(stamps), "the last wrist")
    got = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in wrists]
    assert got == stamps
    assert all(message.point.x == pytest.approx(3.0) for _, message in wrists)
