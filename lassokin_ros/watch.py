"""For robots: the people whom a tracker sees now. What is too old counts as unknown.

    watch = PeopleWatch(node, frame="camera_optical_frame")  # in a node; reads tracker/people and tracker/state
    for person in watch.tracked():                    # the nearest one first; empty if nothing is known
        person["x"], person["z"], person["detector_id"]
    watch.predicted()                                 # the same people, where they are expected now
    watch.state                                       # "tracking", "nobody", or "lost": somebody may be there

The tracker publishes in the camera's optical frame, or in its `fixed_frame`. A program that measures from the robot
says in which frame it needs the positions: those in another frame are moved by TF, and nothing is known while TF lacks
the transform.

One age decides, that of the newest ~/people by its stamp. The tracker repeats this message with a stamp that advances,
so that the age is also too large if the tracker was killed or has no processor time, if the keypoints are late, and if
the clocks of two machines differ. A person who is lost, or a detector that stops, is in the message itself.

The joints of one person come by `watch.subscribe("skeleton", callback)`: only those that are fresh, and whose person is
neither guessed nor doubtful in the same image. `watch.joints(message)` gives them in the frame of the watch.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time as Stamp
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header, String

from lassokin_ros.core.body.rotations import from_quaternion, to_quaternion
from lassokin_ros.pipeline.settings import OPTICAL_FRAME
from msg_adapters.output_messages.people import POINT

TRACKING, LOST, NOBODY = "tracking", "lost", "nobody"
STALE_S = 0.5
"""s: age from which on a message is not used."""
AHEAD_S = 0.1
"""s: a stamp may lie so far in the future, since /clock may come 10 times per second only. The same time is lost when a
tracker dies whose camera's clock is ahead."""
PLACE, SPEED, UP = ("x", "y", "z"), ("vx", "vy", "vz"), ("up_x", "up_y", "up_z")
TURN = ("qx", "qy", "qz", "qw")
SPREAD, SPEED_SPREAD = (tuple(of + name for name in ("xx", "xy", "xz", "yy", "yz", "zz")) for of in ("", "v"))
"""Fields of vectors, of a rotation, and of the upper triangles of the covariances of position and velocity."""
LOG_PERIOD_S = 5.0
"""s between two warnings about a missing transform, or about silence."""
GAP_S = 0.3
"""s: a longer gap between two places is an absence."""
DEPTH = 10
"""Messages that are kept of each topic."""
KINDS = {PointField.FLOAT32: "<f4", PointField.INT32: "<i4"}


def points(message: PointCloud2) -> np.ndarray:
    """Return the points of ~/people, ~/skeleton, ~/skeletons, ~/limbs or ~/hands as a structured array (k,)."""
    kind = np.dtype([(field.name, KINDS[field.datatype]) for field in message.fields])
    return np.frombuffer(bytes(message.data), kind)


def position(point: Any) -> np.ndarray:
    """Return the position (3,) m of one point, or (3, k) of k points."""
    return np.array([point[name] for name in "xyz"], dtype=float)


def covariance(point: Any, of: str = "") -> np.ndarray:
    """Return the covariance (3, 3) m^2 of the position of one point, or (3, 3, k). of: "v" for that of the velocity."""
    rows = ("xx", "xy", "xz"), ("xy", "yy", "yz"), ("xz", "yz", "zz")
    return np.array([[point[of + name] for name in row] for row in rows], dtype=float)


def transformed(found: np.ndarray, transform: Any) -> np.ndarray:
    """Return points (k,) of ~/people or ~/skeleton, moved by a geometry_msgs/Transform."""
    moved, names = found.copy(), found.dtype.names or ()
    turn, shift = transform.rotation, transform.translation
    matrix = from_quaternion(np.array([turn.x, turn.y, turn.z, turn.w]))
    fields: tuple[str, ...]
    for fields in (PLACE, SPEED, UP):
        if fields[0] in names:
            vectors = matrix @ np.array([found[name] for name in fields], dtype=float)
            if fields is PLACE:
                vectors += [[shift.x], [shift.y], [shift.z]]
            for name, values in zip(fields, vectors):
                moved[name] = values
    for fields, of in ((SPREAD, ""), (SPEED_SPREAD, "v")):
        if fields[0] in names:
            spread = np.einsum("ij,jkp,lk->ilp", matrix, covariance(found, of), matrix)
            for name, values in zip(fields, spread[np.triu_indices(3)]):
                moved[name] = values
    if TURN[0] in names:
        turns = from_quaternion(np.column_stack([found[name] for name in TURN]).astype(float))
        for name, values in zip(TURN, to_quaternion(matrix @ turns).T):
            moved[name] = values
    return moved


def cloud(stamp: Stamp, frame_id: str, places: np.ndarray) -> PointCloud2:
    """Return places (k, 3) m as a PointCloud2 with x, y, z, such as obstacles for a costmap."""
    fields = [PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1) for i, name in enumerate(PLACE)]
    data = np.asarray(places, dtype="<f4").reshape(-1, 3).tobytes()
    size = {"width": len(data) // 12, "height": 1, "point_step": 12, "row_step": len(data)}
    return PointCloud2(header=Header(stamp=stamp, frame_id=frame_id), fields=fields, data=data, is_dense=True, **size)


class Stillness:
    """Tells how far a point has moved lately. A hand that is held still has moved by less than some centimetres."""

    def __init__(self, seconds: float = 0.5) -> None:
        """seconds: s, the time that counts."""
        self._seconds, self._places = seconds - 1e-6, deque[tuple[float, np.ndarray]]()

    def moved(self, stamp: Stamp, place: np.ndarray) -> float:
        """Add a place (3,) m, and return its largest distance, m, from those of the last time.

        Infinite until there are places of so much time, without a gap of more than GAP_S.
        """
        now_s = stamp.sec + 1e-9 * stamp.nanosec
        if self._places and not 0 <= now_s - self._places[-1][0] <= GAP_S:
            self._places.clear()
        self._places.append((now_s, place))
        while len(self._places) > 2 and now_s - self._places[1][0] >= self._seconds:
            self._places.popleft()
        if now_s - self._places[0][0] < self._seconds:
            return np.inf
        return max(float(np.linalg.norm(place - before)) for _, before in self._places)


def is_fresh(age_s: float, stale_s: float) -> bool:
    """Return True for an age from -AHEAD_S to stale_s. A stamp far in the future is of another clock."""
    return -AHEAD_S <= age_s <= stale_s


def certain_person(people: np.ndarray) -> int | None:
    """Return who of ~/people (k,) is tracked, if nobody who is tracked is guessed or doubtful; else None.

    If somebody is locked, only that person counts, whose joints are those of one person.
    """
    locked = people["locked"] == 1
    seen = people[(people["tracked"] == 1) & (locked | ~locked.any())]
    return None if len(seen) == 0 or (seen["guessed"] | seen["doubtful"]).any() else int(seen["person"][0])


def camera_frame(node: Node) -> str:
    """Return the parameter `camera_frame` of a node: the optical frame of a camera on the robot."""
    name: str = node.declare_parameter("camera_frame", OPTICAL_FRAME).value
    return name


class IntoFrame:
    """Moves people into a frame by TF. It reads TF from the first message on that is in another frame."""

    def __init__(self, node: Node, frame: str, stale_s: float) -> None:
        """frame: to move into; empty: none. stale_s: s, largest age of a transform. Static ones have no age."""
        self._node, self.frame, self._stale_s = node, frame, stale_s
        self._buffer: Any = None
        self._ahead_ns = 0  # ns, stamp of the newest transform that was ahead of the time

    def move(self, people: np.ndarray, source: str) -> np.ndarray | None:
        """Return people or joints (k,) of the frame `source` in the wanted one; None, with a warning, if TF lacks it.

        The newest transform is used: a person stays in place in a fixed frame while the robot moves on.
        """
        if len(people) == 0 or self.frame in ("", source):
            return people
        transform, fault = self._newest(source)
        if transform is None:
            self._node.get_logger().warning(
                f"people are in the frame '{source}', expected '{self.frame}' (in some examples the parameter "
                f"camera_frame: an optical frame on the robot), or a fresh transform between them in TF: {fault}",
                throttle_duration_sec=LOG_PERIOD_S,
            )
            return None
        return transformed(people, transform)

    def _newest(self, source: str) -> tuple[Any, str]:
        """Return the newest geometry_msgs/Transform from `source` and "", or None and why there is none."""
        try:
            from tf2_ros import Buffer, TransformException, TransformListener
        except ImportError:
            return None, "tf2_ros is not installed (apt install ros-$ROS_DISTRO-tf2-ros-py)"
        if self._buffer is None:
            self._buffer = Buffer()
            self._listener = TransformListener(self._buffer, self._node)
        try:
            found = self._buffer.lookup_transform(self.frame, source, Time())
        except TransformException as error:
            return None, str(error)
        stamp_ns = Time.from_msg(found.header.stamp).nanoseconds
        age_s = (self._node.get_clock().now().nanoseconds - stamp_ns) * 1e-9
        if age_s < -AHEAD_S:
            self._ahead_ns = stamp_ns  # not used later either: its publisher may have died
        if stamp_ns and (stamp_ns == self._ahead_ns or not is_fresh(age_s, self._stale_s)):
            return None, f"the newest one is {abs(age_s):.1f} s " + ("ahead of the time" if age_s < 0 else "old")
        return found.transform, ""


class PeopleWatch:
    """Subscribes to ~/people and ~/state of a tracker. `people_type` must be the default, sensor_msgs/PointCloud2."""

    def __init__(self, node: Node, tracker: str = "tracker", stale_s: float = STALE_S, frame: str = "") -> None:
        """tracker: name of the tracker's node, in the namespace of `node` unless it starts with a slash.

        stale_s: s, largest age of a message and of a transform that is used.

        frame: in which people are needed; those in another frame are moved by TF. Empty: as they come, see `frame_id`.
        """
        self._node, self._tracker = node, tracker
        self._clock, self._stale_s = node.get_clock(), stale_s
        self._into = IntoFrame(node, frame, stale_s)
        self._people: PointCloud2 | None = None
        self._state = LOST
        self._heard = self._sure = False  # since the last look at silence: ~/people, and one with a certain person
        self._outputs: dict[str, bool] = {}  # topic of `subscribe`: whether it was received since then
        self._missed: set[str] = set()  # topics that were not received before the last look, though `_sure`
        self._certain: deque[tuple[int, int]] = deque(maxlen=DEPTH)  # ns, stamps of images, and the person
        self._waiting: deque[tuple[Callable[[Any], None], Any]] = deque(maxlen=DEPTH)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(PointCloud2, f"{tracker}/people", self._on_people, DEPTH)
        node.create_subscription(String, f"{tracker}/state", self._on_state, latched)
        node.create_timer(LOG_PERIOD_S, self._warn_of_silence, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_people(self, message: PointCloud2) -> None:
        self._heard, ahead_s = True, -self.age(message.header)
        self._people = message if ahead_s <= AHEAD_S else None  # it would be fresh later, if the tracker dies now
        if ahead_s > AHEAD_S:
            self._node.get_logger().warning(
                f"people are not used: their stamp is {ahead_s:.1f} s ahead; expected the same time on all machines",
                throttle_duration_sec=LOG_PERIOD_S,
            )
        if (person := certain_person(points(message))) is not None:
            self._sure = True
            self._certain.append((Time.from_msg(message.header.stamp).nanoseconds, person))
        self._deliver()

    def _warn_of_silence(self) -> None:
        """Log a warning if ~/people, which is repeated several times per second, has not come for LOG_PERIOD_S.

        Of an output, if it has not come in two such periods in each of which somebody was tracked.
        """
        missed = {topic for topic, heard in self._outputs.items() if self._sure and not heard}
        for topic in sorted(missed & self._missed):
            name = self._node.resolve_topic_name(topic)
            self._node.get_logger().warning(
                f"somebody is tracked, but nothing was received on {name}: with max_people above 1 the tracker "
                "publishes it for the locked person alone; set its parameter lock, or call ~/lock"
            )
        self._missed, self._sure, self._outputs = missed, False, dict.fromkeys(self._outputs, False)
        if not self._heard:
            topic = self._node.resolve_topic_name(f"{self._tracker}/people")
            self._node.get_logger().warning(
                f"nothing was received on {topic} for {LOG_PERIOD_S:.0f} s: expected a tracker there, with the default "
                "people_type; a node in another namespace is started with --ros-args -r __ns:=NAMESPACE"
            )
        self._heard = False

    def subscribe(self, output: str, callback: Callable[[Any], None]) -> None:
        """Call back with the messages of ~/skeleton, ~/limbs or ~/hands that are fresh and whose person is certain.

        output: "skeleton", "limbs" or "hands". The person is certain if ~/people of the same image says so, see
        `certain_person`; either message may come first. With `max_people` above 1 they are those of the locked person,
        see ~/lock.
        """
        topic = f"{self._tracker}/{output}"
        self._outputs[topic] = False

        def on_message(message: Any) -> None:
            self._outputs[topic] = True
            self._waiting.append((callback, message))
            self._deliver()

        self._node.create_subscription(PointCloud2, topic, on_message, DEPTH)

    def _deliver(self) -> None:
        """Call back with the waiting messages of certain images. The others are pushed out by newer ones."""
        for _ in range(len(self._waiting)):
            callback, message = self._waiting.popleft()
            if self.whose(message) is None:
                self._waiting.append((callback, message))
            elif self.fresh(message.header):
                callback(message)

    def whose(self, message: PointCloud2) -> int | None:
        """Return whose joints a message of `subscribe` has: `person` in ~/people. None if that is not certain."""
        return dict(self._certain).get(Time.from_msg(message.header.stamp).nanoseconds)

    def joints(self, message: PointCloud2) -> np.ndarray | None:
        """Return the points of ~/skeleton or ~/skeletons in the frame of the watch, see `IntoFrame.move`."""
        return self._into.move(points(message), message.header.frame_id)

    def _on_state(self, message: String) -> None:
        self._state = message.data

    def age(self, header: Any) -> float:
        """Return the age of a std_msgs/Header by its stamp, s; negative if it lies in the future."""
        now_ns: int = self._clock.now().nanoseconds
        return (now_ns - Time.from_msg(header.stamp).nanoseconds) * 1e-9

    def fresh(self, header: Any) -> bool:
        """Return True if a std_msgs/Header is `stale_s` old at most by its stamp, and AHEAD_S in the future at most."""
        return is_fresh(self.age(header), self._stale_s)

    @property
    def known(self) -> bool:
        """True if the newest message is fresh, and its people are in the wanted frame or TF moves them there."""
        return self._read() is not None

    @property
    def state(self) -> str:
        """The tracker's state; "lost" if the people are not known."""
        return self._state if self.known else LOST

    @property
    def frame_id(self) -> str:
        """Frame of the positions: `frame`, or that of the newest message, the camera's optical frame (x right, y down,
        z forward) or the tracker's `fixed_frame` (z up); empty before a message.
        """
        return self._into.frame or ("" if self._people is None else str(self._people.header.frame_id))

    @property
    def stamp(self) -> Time | None:
        """Stamp of the newest people; each was seen `age` s before it. None before a message."""
        return None if self._people is None else Time.from_msg(self._people.header.stamp)

    def predicted(self, now: Time | None = None, people: np.ndarray | None = None) -> np.ndarray:
        """Return people (k,) with the places where they are expected at a time, and the covariance of these.

        now: by default the time of the node's clock; also a later time, such as that of an action. people: of this
        watch, by default `tracked`. Those who are not tracked stay where they are: their covariance has grown already.
        """
        people = self.tracked() if people is None else people.copy()
        if self.stamp is not None:
            ahead_s = ((now or self._clock.now()) - self.stamp).nanoseconds * 1e-9
            seconds = np.where(people["tracked"] == 1, ahead_s + people["age"], 0.0)
            for place, speed in zip(PLACE, SPEED):
                people[place] += seconds * people[speed]
            for spread, of_speed in zip(SPREAD, SPEED_SPREAD):
                people[spread] += np.where(seconds > 0, seconds**2 * people[of_speed], 0.0)
        return people

    def _read(self) -> np.ndarray | None:
        """Return the people (k,) of the newest message in the wanted frame; None if they are not known."""
        if self._people is None or not self.fresh(self._people.header):
            return None
        return self._into.move(points(self._people), self._people.header.frame_id)

    def everybody(self) -> np.ndarray:
        """Return all people of the newest message, also those who are lost, the nearest one first; none if not known.

        The fields are x, y, z (m), vx, vy, vz (m/s, over ground if the tracker has a fixed frame), xx to zz (m^2), vxx
        to vzz (m^2/s^2), confidence, age (s), person, tracked, detector_id, guessed, doubtful, locked, out_of_view. The
        nearest one is that to the origin of `frame_id`. People in the image whom the tracker does not follow come last:
        their place is NaN.
        """
        people = self._read()
        if people is None:
            return np.zeros(0, POINT)
        return people[np.argsort(people["x"] ** 2 + people["y"] ** 2 + people["z"] ** 2)]

    def tracked(self) -> np.ndarray:
        """Return the people whose last frame is fresh, the nearest one first; none if these are not known."""
        return self._tracked_of(self.everybody())

    def _tracked_of(self, people: np.ndarray) -> np.ndarray:
        """Return those of `everybody` (k,) whose last frame is fresh."""
        if self._people is None or len(people) == 0:
            return people
        fresh = self.age(self._people.header) + people["age"] <= self._stale_s
        return people[(people["tracked"] == 1) & fresh]

    def followed(self) -> np.ndarray:
        """Return whom a robot may follow: those of `tracked`, the locked person alone if somebody is locked.

        Guessed and doubtful people are left out: one may be somebody else, the other's place may be wrong. Nobody while
        the state is not "tracking": the locked person may be lost.
        """
        people = self.everybody()  # once: it may be too old the next time
        if len(people) == 0 or self._state != TRACKING:
            return people[:0]
        wanted = people[people["locked"] == 1] if people["locked"].any() else people
        return self._tracked_of(wanted[(wanted["guessed"] | wanted["doubtful"]) == 0])
