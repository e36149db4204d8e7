"""Keep what the tracker is given in the first pass, to track it backward in time."""

from __future__ import annotations

import math
import pickle
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.common.array_spool import ArraySpool, Record, clear_errors
from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.recording import backward_states
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.frame_result import FrameResult

STILL = 0.01
"""m, and rad: a camera whose pose in TF changes by less stands still."""


class SpooledStates(Mapping[int, BodyState]):
    """States by stamp in ns, in a temporary file. Methods raise SpoolError if it cannot be written."""

    def __init__(self) -> None:
        self._spool = ArraySpool()
        self._places: dict[int, Record] = {}

    def add(self, stamp_ns: int, state: BodyState) -> None:
        """Store a state."""
        self._places[stamp_ns] = self._spool.append({"rotations": state.rotations, "translation": state.translation})

    def __getitem__(self, stamp_ns: int) -> BodyState:
        place = self._places[stamp_ns]
        rotations, translation = (self._spool.read(place, name) for name in ("rotations", "translation"))
        assert rotations is not None and translation is not None
        return BodyState(rotations, translation)

    def __iter__(self) -> Iterator[int]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class KeptObservations:
    """The observations of one person, in a temporary file. Methods raise SpoolError if it cannot be written."""

    def __init__(self) -> None:
        with clear_errors():
            self._file = tempfile.TemporaryFile()
        self._people: list[tuple[str, list[tuple[int, int]]]] = []
        """The person's ids in order; of each the stamps, ns, and places in the file of what was seen under it."""
        self._first_ns = 0
        self._newest_ns: int | None = None  # of the accepted frames
        self._cameras: dict[str, CameraPose] = {}  # first pose of each, by name
        self._in_order, self._moving, self._alone = True, False, False

    def add(self, frames: Sequence[FrameResult], time_ns: int, seconds: float) -> None:
        """Keep the observations of a message; a listener of OfflineTracker."""
        for frame in frames:
            newer = self._newest_ns is None or frame.stamp_ns > self._newest_ns
            if frame.accepted:
                self._in_order = self._in_order and newer
                self._newest_ns = frame.stamp_ns
            if frame.observations and (frame.accepted or newer):  # not one that was refused because it is late
                self._append(frame.label, frame.stamp_ns, frame.observations)

    def _append(self, person: str, stamp_ns: int, observations: Sequence[Observation]) -> None:
        if not self._people:
            self._first_ns = stamp_ns
        self._follow_cameras([one.camera for one in observations if one.camera.known])
        if not self._people or self._people[-1][0] != person:
            self._people.append((person, []))
        with clear_errors():
            self._people[-1][1].append((stamp_ns, self._file.tell()))
            pickle.dump(list(observations), self._file, pickle.HIGHEST_PROTOCOL)

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

    def states(
        self, tracker: Tracker, placed: Callable[[Sequence[Observation]], list[Observation]]
    ) -> Mapping[int, BodyState]:
        """Return the states by a track backward in time, by stamp in ns; none if it is not `usable`.

        tracker: a new one, with the person's lengths. placed: gives the observations of an instant their cameras.
        """
        states = SpooledStates()
        if not self.usable:
            return states
        for _, places in reversed(self._people):
            tracker.reset(same_camera=True)
            instants = (placed(instant) for instant in self._latest_first(places))
            for stamp, state in backward_states(tracker, (instant for instant in instants if instant)):
                states.add(self._first_ns + round(1e9 * stamp), state)
        return states

    def _seconds(self, stamp_ns: int) -> float:
        return 1e-9 * (stamp_ns - self._first_ns)

    def _latest_first(self, places: Sequence[tuple[int, int]]) -> Iterator[list[Observation]]:
        for stamp_ns, place in sorted(places, reverse=True):
            self._file.seek(place)
            yield [replace(one, stamp=self._seconds(stamp_ns)) for one in pickle.load(self._file)]
