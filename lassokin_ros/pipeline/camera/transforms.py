"""Poses between TF frames: a small buffer of the transforms on /tf and /tf_static.

It replaces tf2's buffer, whose Python package is compiled and not on PyPI.
"""

from __future__ import annotations

import math
from bisect import bisect

import numpy as np

from lassokin_ros.core.body.rotations import from_quaternion

HISTORY_NS = 3_000_000_000
"""ns for which the transforms of a moving frame are kept."""
STALE_NS = 500_000_000
"""ns: nobody waits for a transform if the newest one is older than the image by more than this."""
EXTRAPOLATED_NS = 200_000_000
"""ns: largest time from the newest transform to an image whose camera is placed by it."""
LONGEST_STEP_NS, FASTEST_M_S, FASTEST_RAD_S = 250_000_000, 5.0, 5.0
"""ns, m/s, rad/s: limits of the motion between two transforms. Within them the motion is continued up to the image;
beyond, it is a jump, and the nearest transform is used."""
SHORTEST_STEP_NS = 20_000_000
"""ns: a motion is continued from transforms that are as far apart, because their noise grows with it."""
ACCELERATION = 2.0, 0.5
"""rad/s^2 and m/s^2: standard deviations of the acceleration of a frame that has moved lately, while its motion is
continued; robots turn with up to 4 rad/s^2."""
MOVED = 0.02, 0.02
"""rad and m: motion within `HISTORY_NS` from which on a frame moves."""
SAMPLES = 8
"""Stored poses that are compared with the newest one, to see whether a frame moves."""
MOST_FRAMES, LONGEST_NAME, MOST_STAMPS = 2000, 256, 10_000
"""Limits of the memory: number of frames, characters of a name, transforms of a frame within `HISTORY_NS`."""
FARTHEST_M = 1e8
"""m: largest coordinate of a transform. Those of maps of the earth are below 1e7."""
SMALL_TURN_RAD = 1e-6
"""rad: half of a turn below which orientations are interpolated linearly."""
DEEPEST = 200
"""Frames in a chain. A longer one is a loop."""

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)


class TransformError(Exception):
    """TF does not contain the transform. The text names what is missing."""


class Transforms:
    """The newest transforms of each frame from its parent."""

    def __init__(self) -> None:
        self._frames: dict[str, _Frame] = {}

    def add(self, message: object, static: bool) -> None:
        """Store the transforms of a tf2_msgs/TFMessage. Invalid ones are left out.

        static: the message came on /tf_static and holds for all times.
        """
        for transform in message.transforms:  # type: ignore[attr-defined]
            child, parent = transform.child_frame_id.lstrip("/"), transform.header.frame_id.lstrip("/")
            turn, shift, stamp = transform.transform.rotation, transform.transform.translation, transform.header.stamp
            quaternion, place = (turn.x, turn.y, turn.z, turn.w), (shift.x, shift.y, shift.z)
            square = math.fsum(x * x for x in quaternion)
            names = child and parent and child != parent and max(len(child), len(parent)) <= LONGEST_NAME
            if not (names and 0.9 < square < 1.1 and all(abs(x) <= FARTHEST_M for x in place)):
                continue  # NaN compares false
            frame = self._frames.pop(child, None)
            if frame is None and len(self._frames) >= MOST_FRAMES:  # the moving one of the oldest update is forgotten
                moving = (name for name, known in self._frames.items() if not known.static)
                del self._frames[next(moving, next(iter(self._frames)))]
            if frame is None or frame.parent != parent or frame.static is not static:
                frame = _Frame(parent, static)
            self._frames[child] = frame  # at the end: the last to be forgotten
            x, y, z, w = (part / math.sqrt(square) for part in quaternion)
            frame.add(stamp.sec * 1_000_000_000 + stamp.nanosec, (x, y, z, w), place)

    def clear(self) -> None:
        """Forget the moving frames, after a jump of the clock."""
        self._frames = {name: frame for name, frame in self._frames.items() if frame.static}

    def pose(self, frame: str, base: str, stamp_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Return rotation (3, 3) and translation (3,) m from `frame` to `base`: a point p in `frame` is R p + t.

        Transforms that have not arrived up to the time are continued for up to EXTRAPOLATED_NS. Raises TransformError
        if the frames are not connected, or if a transform is not of this time.
        """
        up, down = self._between(frame, base)
        if up is None or down is None:
            raise TransformError(self._difference_of_trees(frame, base))
        (turn, at), (back, of) = self._product(up, stamp_ns), self._product(down, stamp_ns)
        inverse = from_quaternion(np.array(back)).T
        return inverse @ from_quaternion(np.array(turn)), inverse @ (np.array(at) - np.array(of))

    def deviation(self, frame: str, base: str, stamp_ns: int) -> tuple[float, float]:
        """Return the standard deviations, rad and m, of a pose that continues the motion up to a time; 0 if none is.

        They are half the acceleration of a robot that moves times the square of the gap, see ACCELERATION.
        """
        found = [0.0, 0.0]
        for name in self._moving_between(frame, base):
            one = self._frames[name]
            gap_s = 1e-9 * (stamp_ns - (one.newest_ns or 0))
            if gap_s > 0:
                for i, moves in enumerate(one.moves):
                    found[i] += moves * (0.5 * ACCELERATION[i] * gap_s**2) ** 2
        return math.sqrt(found[0]), math.sqrt(found[1])

    def reach_ns(self, frame: str, base: str) -> int | None:
        """Return the stamp, ns, up to which the pose of a frame in another one is known.

        None if they are not connected, or if nothing between them moves.
        """
        newest = [self._frames[name].newest_ns for name in self._moving_between(frame, base)]
        return min((stamp_ns for stamp_ns in newest if stamp_ns is not None), default=None)

    def _moving_between(self, frame: str, base: str) -> list[str]:
        """Return the names of the frames between two that have moving transforms; none if they are not connected."""
        return [name for chain in self._between(frame, base) for name in chain or () if not self._frames[name].static]

    def _between(self, frame: str, base: str) -> tuple[list[str] | None, list[str] | None]:
        """Return the frames from each of two to below the first common one; None for both if they have none."""
        of_frame, of_base = self._chain(frame), self._chain(base)
        common = next((name for name in of_frame if name in of_base), None)
        if common is None:
            return None, None
        return of_frame[: of_frame.index(common)], of_base[: of_base.index(common)]

    def _chain(self, name: str) -> list[str]:
        """Return the frame, its parent, and so on."""
        chain = [name]
        while len(chain) < DEEPEST and (frame := self._frames.get(chain[-1])) is not None:
            chain.append(frame.parent)
        return chain

    def _product(self, chain: list[str], stamp_ns: int) -> tuple[Quaternion, Vector]:
        """Return the orientation and the position of the first frame of a chain in the parent of the last one."""
        total, place = IDENTITY, (0.0, 0.0, 0.0)
        for name in chain:
            turn, shift = self._frames[name].at(stamp_ns, name)
            x, y, z = _turned(turn, place)
            total, place = _product(turn, total), (x + shift[0], y + shift[1], z + shift[2])
        return total, place

    def _difference_of_trees(self, frame: str, base: str) -> str:
        known = {item for name, one in self._frames.items() for item in (name, one.parent)}
        if unknown := [f"'{name}'" for name in (frame, base) if name not in known]:
            return f"no transform of {' or '.join(unknown)} was received on /tf or /tf_static"
        roots = (self._chain(name)[-1] for name in (frame, base))
        return "'{}' and '{}' are not connected: the one belongs to '{}', the other to '{}'".format(frame, base, *roots)


class _Frame:
    """The orientations and positions of one frame in its parent, by time."""

    def __init__(self, parent: str, static: bool) -> None:
        self.parent, self.static = parent, static
        self._stamps: list[int] = []  # ns
        self._poses: list[tuple[Quaternion, Vector]] = []

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the newest pose, ns; None for a static one."""
        return None if self.static else self._stamps[-1]

    @property
    def moves(self) -> tuple[bool, bool]:
        """Whether the frame has turned and has been shifted lately."""
        newest, place = self._poses[-1]
        older = self._poses[:: max(len(self._poses) // SAMPLES, 1)]
        turned = max(_angle(newest, quaternion) for quaternion, _ in older)
        return turned > MOVED[0], max(math.dist(place, one) for _, one in older) > MOVED[1]

    def add(self, stamp_ns: int, quaternion: Quaternion, place: Vector) -> None:
        """Store a pose; place: m. A stamp far back means that time has started again."""
        if self.static or (self._stamps and stamp_ns < self._stamps[-1] - HISTORY_NS):
            self._stamps, self._poses = [], []
        at = bisect(self._stamps, stamp_ns)
        if at and self._stamps[at - 1] == stamp_ns:
            self._poses[at - 1] = quaternion, place
            return
        self._stamps.insert(at, stamp_ns)
        self._poses.insert(at, (quaternion, place))
        old = max(bisect(self._stamps, self._stamps[-1] - HISTORY_NS), len(self._stamps) - MOST_STAMPS)
        if old > 0:
            del self._stamps[:old], self._poses[:old]

    def at(self, stamp_ns: int, name: str) -> tuple[Quaternion, Vector]:
        """Return the pose at a time, interpolated; the motion goes on beyond the newest one. name: of the frame.

        Raises TransformError if none is near.
        """
        if self.static:
            return self._poses[-1]
        after = bisect(self._stamps, stamp_ns)
        nearest = min(after, len(self._stamps) - 1)
        if 0 < after < len(self._stamps):
            if not self._jumps(after - 1, after):
                return self._between(after - 1, after, stamp_ns)
            nearest -= stamp_ns - self._stamps[after - 1] < self._stamps[after] - stamp_ns
        distance_ns = stamp_ns - self._stamps[nearest]
        if abs(distance_ns) > EXTRAPOLATED_NS:
            side = "older" if distance_ns > 0 else "newer"
            raise TransformError(
                f"the transform of '{name}' is more than {EXTRAPOLATED_NS * 1e-9:g} s {side} than the image: do the "
                "camera and TF have the same clock?"
            )
        if distance_ns > 0 and nearest == len(self._stamps) - 1:  # the newest motion goes on
            since = max(bisect(self._stamps, self._stamps[-1] - SHORTEST_STEP_NS) - 1, 0)
            short = self._stamps[-1] - self._stamps[since] <= LONGEST_STEP_NS
            if since < nearest and short and not self._jumps(since, nearest):
                return self._between(since, nearest, stamp_ns)
        return self._poses[nearest]

    def _between(self, before: int, after: int, stamp_ns: int) -> tuple[Quaternion, Vector]:
        """Return the pose at a time on the straight motion from one stored pose to a later one."""
        share = (stamp_ns - self._stamps[before]) / (self._stamps[after] - self._stamps[before])
        (a, p), (b, q) = self._poses[before], self._poses[after]
        x, y, z = (u + share * (v - u) for u, v in zip(p, q))
        return _interpolated(a, b, share), (x, y, z)

    def _jumps(self, before: int, after: int) -> bool:
        """Return True if no robot moves from one stored pose to a later one in their time."""
        seconds = (self._stamps[after] - self._stamps[before]) * 1e-9
        (a, p), (b, q) = self._poses[before], self._poses[after]
        angle = _angle(a, b)
        return math.dist(p, q) >= FASTEST_M_S * seconds or angle >= FASTEST_RAD_S * seconds


def _angle(a: Quaternion, b: Quaternion) -> float:
    """Return the angle between two orientations, rad."""
    return 2 * math.acos(min(abs(math.fsum(u * v for u, v in zip(a, b))), 1.0))


def _turned(q: Quaternion, v: Vector) -> Vector:
    """Return the vector v rotated by the quaternion q: x, y, z, w."""
    x, y, z, _ = _product(_product(q, (*v, 0.0)), (-q[0], -q[1], -q[2], q[3]))
    return x, y, z


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the product of two quaternions x, y, z, w: the rotation b, then a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _interpolated(before: Quaternion, after: Quaternion, share: float) -> Quaternion:
    """Return the orientation on the shortest turn from `before` to `after`, at constant speed, normalised.

    share: of the turn; above 1, the turn is continued.
    """
    cosine = math.fsum(a * b for a, b in zip(before, after))
    half, sign = math.acos(min(abs(cosine), 1.0)), math.copysign(1.0, cosine)
    first, last = 1 - share, share
    if half > SMALL_TURN_RAD:
        first, last = math.sin(first * half) / math.sin(half), math.sin(last * half) / math.sin(half)
    x, y, z, w = (first * a + last * sign * b for a, b in zip(before, after))
    size = math.sqrt(math.fsum((x * x, y * y, z * z, w * w)))
    return x / size, y / size, z / size, w / size
