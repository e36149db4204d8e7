"""The examples of docs/robots.md with the real tracker: late TF, old keypoints, another frame, a process that dies."""

import time
from contextlib import ExitStack, contextmanager, suppress
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import (  # noqa: E402
    PointStamped,
    Pose,
    PoseArray,
    PoseWithCovarianceStamped,
    TransformStamped,
    Twist,
)
from live import BACKEND, NodeProcess  # noqa: E402
from messages import FRAME, camera_info, cloud, crowd, pixels_of_motion  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from robots import Robot, base_to_camera, people, report, running, transform  # noqa: E402
from sensor_msgs.msg import CameraInfo, PointCloud2  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402

from lassokin_ros.watch import points  # noqa: E402

STOP_S = 0.6
CAMERA = ("--ros-args", "-p", f"camera_frame:={FRAME}")
HEIGHT = ("-p", "height:=1.75")
PIXELS = pixels_of_motion(40, 20.0)
NEAR = PIXELS.mean(axis=1, keepdims=True) + 1.5 * (PIXELS - PIXELS.mean(axis=1, keepdims=True))
NOWHERE = np.full((17, 2), np.nan)


def drives(command):
    return command.linear.x != 0 or command.angular.z != 0


SCENES = {
    "follow_person": (Twist, "cmd_vel", drives),
    "imitate_arm": (PoseWithCovarianceStamped, "arm_target", bool),
    "safety_zone": (String, "zone", lambda message: message.data == "safe"),
    "wrist_in_base": (PointStamped, "right_wrist", bool),
    "two_cameras": (PointStamped, "person", bool),
}
"""Message type, topic, and whether a message makes the robot do something."""


ONE_PERSON = ("follow_person", "imitate_arm", "wrist_in_base")
"""Examples that do something for the person before one camera."""


class DetectingRobot(Robot):
    """Camera, detector and TF of a robot, too."""

    def __init__(self, spaces=("/",)):
        super().__init__()
        self.spaces = spaces
        self._keypoints = [self.publisher(PointCloud2, f"{space.rstrip('/')}/keypoints") for space in spaces]
        self._cameras = [self.publisher(CameraInfo, f"{space.rstrip('/')}/camera_info") for space in spaces]
        self.tf = self.publisher(TransformStamped, "/late_tf")
        self.tf_late_s, self.keypoints_late_s, self.pixels = 0.1, 0.0, PIXELS
        self.transform = base_to_camera
        self.detects, self.sent, self.fresh_ns = True, 0, 0
        self.numbers = ()
        self.node.create_timer(0.05, self._detect)
        self.node.create_timer(0.02, self._send_tf)

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
            self.tf.publish(self.transform(time.time_ns() - round(1e9 * self.tf_late_s)))

    def forget(self):
        """Forget what was published."""
        for got in self.published.values():
            got.clear()


def odom_in_camera(stamp_ns):
    """The camera at (6, 4, 1) m in odom looks along x."""
    return transform(stamp_ns, FRAME, "odom", (4.0, 1.0, -6.0), (0.5, -0.5, 0.5, 0.5))


@pytest.fixture
def robot(request):
    params = getattr(request.node, "callspec", SimpleNamespace(params={})).params
    result = DetectingRobot(("/left", "/right") if params.get("names") == ("two_cameras",) else ("/",))
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


def stopped_after(acts_ns, since_ns):
    """s from a time to the last action, without the delay of a busy machine: up to 0.3 s of the longest pause between
    the last second's actions beyond the usual one.
    """
    last = np.sort([at for at in acts_ns if at > max(acts_ns) - 10**9])
    pauses = np.diff(last) * 1e-9
    late = min(pauses.max() - np.median(pauses), 0.3) if len(pauses) else 0.0
    return (last[-1] - since_ns) * 1e-9 - late


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
            stack.enter_context(running(name, *CAMERA))
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
            topic = f"{robot.spaces[0].rstrip('/')}/tracker/people"
            robot.node.create_subscription(PointCloud2, topic, answers.append, 10)
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
            stack.enter_context(running(name, *CAMERA, *frame))
        (node,) = stack.enter_context(trackers(robot, *HEIGHT, "-p", "lock:=true", "-p", "max_people:=2"))
        seen, lock = [], robot.node.create_client(SetBool, "/tracker/lock")
        robot.node.create_subscription(PointCloud2, "/tracker/people", seen.append, 10)

        def all_have(count):
            """Whether each example has sent more. A pause of this busy process is a silence of the detector."""
            if seen and (points(seen[-1])["locked"] & points(seen[-1])["guessed"]).any():
                lock.call_async(SetBool.Request(data=True))  # the one who is detected best, as before
            return all(len(messages) > count.get(name, 0) + 5 for name, messages in got.items())

        robot.spin_until(lambda: sum(message.width for message in seen) > 40, "people")
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
    with running(name, *CAMERA), trackers(robot):
        robot.spin_until(lambda: acts(robot, name, lambda m: m.data == "occupied"), "a person in the zone")
        robot.forget()
        robot.pixels = [NOWHERE]  # the person is lost, and may be anywhere
        robot.spin_until(lambda: acts(robot, name), "an empty zone")
        words = [message.data for _, message in robot.published["zone"]]
        assert words.count("unknown") > 10 and "safe" not in words[: words.index("unknown")]


def test_a_person_in_a_fixed_frame_is_placed_by_tf_or_unknown(robot, names=("safety_zone", "follow_person")):
    """2 m in front of the camera and 0.2 m to the left, far from the origin of odom: never safe, and never behind."""
    robot.detects, robot.transform = False, None
    there, latched = report((8.0, 4.2, 1.0), 0.01), QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    sender = robot.publisher(PointCloud2, "/tracker/people")
    robot.node.create_publisher(String, "/tracker/state", latched).publish(String(data="tracking"))
    robot.node.create_timer(0.05, lambda: sender.publish(people(time.time_ns(), "odom", there)))

    def right(message):
        if isinstance(message, String):
            return message.data == "occupied"
        forward, turn = message.linear.x, message.angular.z
        return 0 < forward <= 0.25 + 1e-3 and turn == pytest.approx(np.arctan2(0.2, 2.0), abs=1e-3)

    with ExitStack() as stack:
        for name in names:
            robot.listen(*SCENES[name][:2])
            stack.enter_context(running(name, *CAMERA))
        robot.spin_until(lambda: sender.get_subscription_count() == 2 and all(robot.published.values()), "the examples")
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


def test_every_wrist_is_published_while_tf_is_late(robot):
    robot.listen(PointStamped, "right_wrist")
    wrists = robot.published["right_wrist"]
    tracker = robot.node.create_publisher(PoseArray, "/tracker/joints", 200)
    robot.tf_late_s, robot.detects = 0.1, False
    stamps = []

    def send():
        message = PoseArray(poses=[Pose() for _ in range(24)])
        message.header.frame_id = FRAME
        stamps.append(time.time_ns())
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamps[-1], 10**9)
        message.poses[21].position.z = 3.0
        tracker.publish(message)

    with running("wrist_in_base", *CAMERA):
        robot.spin_until(lambda: tracker.get_subscription_count() and robot.tf.get_subscription_count(), "the example")
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
