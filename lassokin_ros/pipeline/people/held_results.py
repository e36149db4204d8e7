"""The results of one person that wait for `smoothing_lag`, and what each has from the one before: velocities, doubt."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.output.uncertainty import ObservedJoints
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.doubt.doubt import NO_TURN, Signs, signs_of
from lassokin_ros.doubt.monitor import DoubtMonitor
from lassokin_ros.pipeline.frame_result import FrameResult, ImageOfPerson
from lassokin_ros.pipeline.people.joint_angles import SHORTEST_NS, Angles, JointStates, Moment


class _Held(NamedTuple):
    """A result that waits for `smoothing_lag`.

    fields: those of the FrameResult that are known. stamp: s, of the tracker. The others are those of `signs_of`.
    """

    fields: dict[str, Any]
    image: ImageOfPerson
    stamp_ns: int
    stamp: float
    points: np.ndarray
    height: float
    frame_turn: np.ndarray

    def signs(self, estimate: Estimate) -> Signs:
        """The signs of the estimate that is due."""
        return signs_of(
            estimate,
            points=self.points,
            focal=self.image.lens.focal,
            height=self.height,
            camera=self.image.camera,
            frame_turn=self.frame_turn,
        )


class HeldResults:
    """Holds results until the tracker publishes their estimates. Stamps are ns."""

    def __init__(self, tracker: Tracker) -> None:
        self._tracker = tracker
        layout, skeleton = tracker.layout, tracker.skeleton
        observed = ObservedJoints(skeleton, layout.joints)
        self._doubts = DoubtMonitor(layout.names, skeleton.joint_names, observed.from_visible)
        self.reset()

    def reset(self) -> None:
        """Drop the results that wait, and forget the last one."""
        self._doubts.reset()
        self._joint_states = JointStates(self._tracker.skeleton.axes)  # results of before keep theirs
        self._last: tuple[Moment, np.ndarray] | None = None  # and the positions of its joints
        self._waiting: deque[_Held] = deque()
        self._frame_moved_ns, self._frame_turn = 0, NO_TURN
        self._resized_ns = 0

    def move_frame(self, rotation: np.ndarray, stamp_ns: int) -> None:
        """Note that the frame of the skeleton has turned by (3, 3) before an image of this stamp."""
        self._frame_moved_ns, self._frame_turn = stamp_ns, rotation @ self._frame_turn

    def resize(self, stamp_ns: int) -> None:
        """Note that from this stamp on the body has another height."""
        self._resized_ns = stamp_ns

    def hold(
        self, fields: dict[str, Any], image: ImageOfPerson, stamp_ns: int, stamp: float, points: np.ndarray
    ) -> None:
        """Add a result. fields: those of the FrameResult that are known. Others: see `_Held`."""
        height = self._tracker.skeleton.height
        self._waiting.append(_Held(fields, image, stamp_ns, stamp, points, height, self._frame_turn))

    def due(self, estimates: Sequence[Estimate], now_ns: int) -> list[FrameResult]:
        """Return the held results of these estimates. The tracker returns them in the same order. now_ns: stamp, ns."""
        frames = []
        for estimate in estimates:
            assert estimate.state is not None and estimate.pose is not None
            held = self._waiting.popleft()
            while held.stamp < estimate.stamp:  # skip results lost by an error
                held = self._waiting.popleft()
            stamp_ns = held.stamp_ns
            moment, before, earlier = Moment(stamp_ns, estimate.state, estimate.initialised), None, None
            last_ns = stamp_ns if self._last is None else self._last[0].stamp_ns
            if last_ns < self._frame_moved_ns <= stamp_ns:
                self._last = None
                self._doubts.reset()
            elif last_ns < self._resized_ns <= stamp_ns:
                self._last = None
            if self._last is not None and not estimate.initialised:
                before, places = self._last
                if stamp_ns - before.stamp_ns >= SHORTEST_NS:
                    earlier = (stamp_ns - before.stamp_ns) * 1e-9, places
            self._last = moment, estimate.pose.positions
            made = FrameResult(
                estimate=estimate,
                pending=self._doubts.add(held.signs(estimate)),
                angles=Angles(self._joint_states, moment, before),
                earlier=earlier,
                held_s=(now_ns - stamp_ns) * 1e-9,
                **held.fields,
            )
            frames.append(made)
        return frames
