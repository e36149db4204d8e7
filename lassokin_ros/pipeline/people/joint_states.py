"""Joint states of one person: continuous angles and velocities, computed for requested frames only."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.record import record
from lassokin_ros.pipeline.people.joint_angles import JointAngleReader

SHORTEST_NS = 1_000_000
"""ns: velocities are differences over stamps. Over a shorter step, as stamps in another unit have, there are none."""


class Moment(NamedTuple):
    """The published state of one frame. stamp_ns: ns; begins: the state was initialised in this frame."""

    stamp_ns: int
    state: BodyState
    begins: bool


class JointStates:
    """Reads angles that are continuous from one requested frame to the next."""

    def __init__(self, axes: Sequence[str]) -> None:
        """axes: see JointAngleReader."""
        self._reader = JointAngleReader(axes)
        self._last: tuple[Moment | None, np.ndarray] = None, np.empty(0)

    def read(self, moment: Moment, before: Moment | None) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (3 + 3 n,) in m and rad, and velocities as differences over stamps.

        before: the frame before, None for the first one. Velocities are 0 after initialisation, and over a step below
        SHORTEST_NS.
        """
        if moment.begins or before is None:
            positions = self._positions(moment)
            return positions, np.zeros_like(positions)
        if self._last[0] is not before:
            self._positions(before)
        earlier = self._last[1]
        positions, step_ns = self._positions(moment), moment.stamp_ns - before.stamp_ns
        if step_ns < SHORTEST_NS:
            return positions, np.zeros_like(positions)
        return positions, (positions - earlier) / (step_ns * 1e-9)

    def _positions(self, moment: Moment) -> np.ndarray:
        if moment.begins:
            self._reader.reset()
        angles = self._reader.read(moment.state.rotations)
        positions = np.concatenate([moment.state.translation, angles.ravel()])
        self._last = moment, positions
        return positions


@record
class Angles:
    """The joint angles of one frame, computed at the first access. They are continuous to the frame that was read last.

    before: the frame before, None for the first one.
    """

    states: JointStates
    moment: Moment
    before: Moment | None

    @cached_property
    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """See `JointStates.read`."""
        return self.states.read(self.moment, self.before)
