"""The vertical in the camera frame: from the camera's mount at first, then learned from the tracked person.

With a level camera it is the optical frame's -y axis. An unknown tilt of the camera then causes a constant error, which
learning removes. People who lie are not used.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.observation import is_longer

TIME_CONSTANT_S = 0.5, 5.0
"""s with which the vertical follows the person's: at first, and at most. It grows with the time of tracking."""
TILT, TILT_COST = 0.45, 4.0
"""rad: pitch of the alternative verticals of `candidates`; and their cost, a negative log-likelihood."""
KNOWN_AFTER = 1.0
"""s for which the vertical must have been learned before it is input to the depth network."""


class Vertical:
    """The vertical of one camera, learned from one person."""

    def __init__(self, roll: float = 0.0, pitch: float = 0.0, given: np.ndarray | None = None) -> None:
        """given: (3,) the vertical of a fixed frame, which neither a mount nor a person changes."""
        self._given = given
        self.set_mount(roll, pitch)

    def set_mount(self, roll: float, pitch: float) -> None:
        """Set the camera's mount, rad, see `vertical_of`, and forget what was learned."""
        self.mount = vertical_of(roll, pitch) if self._given is None else self._given
        """(3,) the vertical that follows from the camera's mount."""
        self.configured = bool(roll or pitch) or self._given is not None
        """True if the mount is known, and not assumed to be level."""
        self.reset()

    @property
    def known(self) -> bool:
        """Whether the vertical is configured, or has been learned for long enough."""
        return self.configured or is_longer(self.learned_for, KNOWN_AFTER)

    def reset(self) -> None:
        """Return to the vertical of the camera's mount."""
        self.direction = self.mount
        """(3,) unit vector in the frame of the skeleton. Learning replaces the array."""
        self.learned_for = 0.0
        """s for which the vertical has been learned."""

    def candidates(self) -> list[tuple[np.ndarray, float]]:
        """The verticals (3,) to try in a first fit without the depth network, with their costs.

        They are that of a level camera and those of cameras pitched up and down, or only what is known already.
        """
        if self.learned_for > 0 or self.configured:
            return [(self.direction, 0.0)]
        tilts = exponential(np.outer((-TILT, TILT), (1.0, 0.0, 0.0)))  # about the image's x axis: the mount is level
        return [(self.mount, 0.0), *((tilt @ self.mount, TILT_COST) for tilt in tilts)]

    def adopt(self, others: Iterable[Vertical]) -> None:
        """Copy the vertical from the one of `others`, for the same camera, that has learned it for the longest time."""
        longest = max(others, key=lambda other: other.learned_for, default=self)
        if longest.learned_for > 0:
            self.direction, self.learned_for = longest.direction, longest.learned_for

    def update(self, root: np.ndarray, step: float) -> None:
        """Move the vertical towards the pelvis' y axis. root: (3, 3), the orientation during the last `step` s."""
        if self._given is not None:
            return
        up, step = root[:, 1], min(step, 0.2)  # s, also after a gap
        if up.dot(self.direction) > 0.5:  # who leans by more than 60 degrees is not used
            first, longest = TIME_CONSTANT_S
            self.learned_for += step
            share = min(step / min(first + self.learned_for, longest), 1.0)
            moved = self.direction + share * (up - self.direction)
            self.direction = moved / math.sqrt(moved.dot(moved))


def level_from_camera(roll: float, pitch: float) -> np.ndarray:
    """Rotation (3, 3) from the optical frame of a camera with this mount, rad, to the optical frame of a level camera.

    The angles are fixed-axis angles of the camera's body frame (x forward, y left, z up), as in a URDF's rpy: with
    positive roll the camera's right side is down, with positive pitch the camera looks down. Yaw does not change. In
    the body frame the rotation is Ry(pitch) Rx(roll); its x is the optical frame's z, its y is the optical frame's -x
    (REP 103).
    """
    about_right, about_sight = exponential(np.array([[-pitch, 0.0, 0.0], [0.0, 0.0, roll]]))
    return np.asarray(about_right @ about_sight)


def vertical_of(roll: float, pitch: float) -> np.ndarray:
    """(3,) the up direction in the optical frame of a camera with this mount, rad; see `level_from_camera`."""
    return -level_from_camera(roll, pitch)[1]
