"""Keep what the tracker is given in the first pass, to track it backward in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lassokin_ros.common.array_spool import ArraySpool, Record
from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.output.smoothing import Backward
from lassokin_ros.core.recording import track_backward
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.seen import key_of
from msg_adapters.output_messages.people import number_of

STILL = 0.01
"""m, and rad: a camera whose pose in TF changes by less stands still."""


class SpooledFrames(Mapping[int, Backward]):
    """Frames by stamp in ns, in a temporary file. Methods raise SpoolError if it cannot be written."""

    def __init__(self) -> None:
        self._spool = ArraySpool()
        self._places: dict[int, Record] = {}

    def add(self, stamp_ns: int, frame: Backward) -> None:
        """Store a frame."""
        arrays = {"rotations": frame.state.rotations, "translation": frame.state.translation}
        self._places[stamp_ns] = self._spool.append({**arrays, "cost": np.array([frame.cost])})

    def __getitem__(self, stamp_ns: int) -> Backward:
        place = self._places[stamp_ns]
        rotations, translation, cost = (self._spool.read(place, name) for name in ("rotations", "translation", "cost"))
        assert rotations is not None and translation is not None and cost is not None
        return Backward(BodyState(rotations, translation), float(cost[0]))

    def __iter__(self) -> Iterator[int]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class _Instant(NamedTuple):
    """What was seen of a person at one stamp, ns. cameras: their names, in the order of the observations."""

    stamp_ns: int
    cameras: tuple[str, ...]
    place: Record


class KeptObservations:
    """The observations of each person, in a temporary file. Methods raise SpoolError if it cannot be written."""

    def __init__(self) -> None:
        self._spool = ArraySpool()
        self._people: dict[int | None, dict[str, list[_Instant]]] = {}
        """By number, None if one person is followed: the ids in order; of each the instants at which the person was
        seen under it."""
        self.identities: dict[tuple[str, bytes], int] = {}
        """The number of each of several people by what was seen, see `Session.identities`."""
        self._first_ns = 0
        self._newest_ns: dict[int | None, int] = {}  # of the accepted frames, by number
        self._cameras: dict[str, CameraPose] = {}  # first pose of each, by name
        self._in_order, self._moving, self._alone = True, False, False

    @property
    def numbers(self) -> list[int | None]:
        """The numbers of the people; None alone if one person is followed."""
        return list(self._people)

    def add(self, frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        """Keep the observations of a message; a listener of Playback."""
        for frame in frames:
            number = number_of(frame.person) if frame.person else None
            newest_ns = self._newest_ns.get(number)
            newer = newest_ns is None or frame.stamp_ns > newest_ns
            if frame.accepted:
                self._in_order = self._in_order and newer
                self._newest_ns[number] = frame.stamp_ns
            if number is not None:
                self.identities |= {(one.camera.name, key_of(one.points)): number for one in frame.images}
            if frame.observations and (frame.accepted or newer):  # not one that was refused because it is late
                instants = self._people.setdefault(number, {}).setdefault(frame.label or frame.person, [])
                instants.append(self._instant(frame.stamp_ns, frame.observations))

    def _instant(self, stamp_ns: int, observations: Sequence[Observation]) -> _Instant:
        self._first_ns = self._first_ns or stamp_ns
        self._follow_cameras([one.camera for one in observations if one.camera.known])
        arrays = {f"{n} {name}": array for n, one in enumerate(observations) for name, array in _arrays(one).items()}
        return _Instant(stamp_ns, tuple(one.camera.name for one in observations), self._spool.append(arrays))

    @property
    def usable(self) -> bool:
        """False if it cannot be tracked backward.

        Either a stamp was before the last one, as in a recording that was looped. Or several cameras move, and their
        images are of different times, so that nothing here says where the others were.
        """
        return self._in_order and not (self._moving and self._alone and len(self._cameras) > 1)

    def _follow_cameras(self, poses: Sequence[CameraPose]) -> None:
        for pose in poses:
            first = self._cameras.setdefault(pose.name, pose)
            turned, moved = np.abs(first.rotation - pose.rotation).max(), math.dist(first.centre, pose.centre)
            self._moving = self._moving or max(turned, moved) > STILL
        self._alone = self._alone or len(poses) == 1

    def track_backward(
        self, number: int | None, tracker: Tracker, placed: Callable[[Sequence[Observation]], list[Observation]]
    ) -> Mapping[int, Backward]:
        """Track a person backward in time, and return the frames by stamp in ns.

        tracker: a new one, with the person's lengths. placed: gives the observations of an instant their cameras.
        """
        frames = SpooledFrames()
        for instants in reversed(self._people[number].values()):
            tracker.reset(same_camera=True)
            seen = (placed(instant) for instant in self._latest_first(instants))
            for stamp, found in track_backward(tracker, (instant for instant in seen if instant)):
                frames.add(self._first_ns + round(1e9 * stamp), found)
        return frames

    def _latest_first(self, instants: Sequence[_Instant]) -> Iterator[list[Observation]]:
        for instant in sorted(instants, key=lambda one: one.stamp_ns, reverse=True):
            yield [self._observation(instant, number) for number in range(len(instant.cameras))]

    def _observation(self, instant: _Instant, number: int) -> Observation:
        """Return an observation of an instant. Its stamp is in s since the first one."""

        def read(name: str) -> np.ndarray | None:
            return self._spool.read(instant.place, f"{number} {name}")

        points, confidence, numbers = read("points"), read("confidence"), read("numbers")
        assert points is not None and confidence is not None and numbers is not None
        focal, of_surface, depth_age = numbers.tolist()
        rotation, translation = read("rotation"), read("translation")
        name, stamp = instant.cameras[number], 1e-9 * (instant.stamp_ns - self._first_ns)
        camera = CameraPose(name, known=False)
        if rotation is not None and translation is not None:
            camera = CameraPose(name, rotation, translation)
        return Observation(
            stamp, points, confidence, focal, read("depth"), None, bool(of_surface), depth_age, camera=camera
        )


def _arrays(one: Observation) -> dict[str, np.ndarray]:
    """Return what an observation of the session holds, by name."""
    numbers = np.array([one.focal, one.depth_of_surface, one.depth_age])
    arrays = {"points": one.points, "confidence": one.confidence, "numbers": numbers}
    if one.depth is not None:
        arrays["depth"] = one.depth
    if one.camera.known:
        arrays |= {"rotation": one.camera.rotation, "translation": one.camera.translation}
    return arrays
