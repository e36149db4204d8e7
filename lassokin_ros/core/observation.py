"""The tracker's input: the keypoints of one person in one frame; the reasons to reject a frame; the unit of stamps."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np

from lassokin_ros.core.errors import CameraError

ORIGIN, AXES = np.zeros(3), np.eye(3)
for _constant in (ORIGIN, AXES):
    _constant.flags.writeable = False


STAMP_TOLERANCE = 1e-3
"""s by which a time may be shorter than a period that has passed: rounding of stamps must not decide what is due."""


def has_passed(elapsed: float, period: float) -> bool:
    """Whether a time between two stamps, s, is the period or more."""
    return elapsed >= period - STAMP_TOLERANCE


def is_longer(elapsed: float, limit: float) -> bool:
    """Whether a time between two stamps, s, is more than a limit."""
    return elapsed > limit + STAMP_TOLERANCE


class Status(Enum):
    """State of the tracker."""

    SEARCHING = "searching"
    TRACKING = "tracking"
    LOST = "lost"


class Rejection(str, Enum):
    """Reason why a frame was not used."""

    WRONG_SHAPE = "wrong_shape"
    NOT_FINITE = "not_finite"
    OLD_STAMP = "old_stamp"
    LATE = "late"
    TOO_FEW_LANDMARKS = "too_few_landmarks"
    NOT_CERTIFIED = "not_certified"
    TOO_SMALL = "too_small"
    UNPLACED = "unplaced"


@dataclass(frozen=True, eq=False)
class CameraPose:
    """Where a camera is, in the frame in which the skeleton is kept: x_camera = rotation x + translation.

    name: each camera of a tracker has another one. rotation: (3, 3) into the camera's optical frame. translation: (3,)
    m. deviation: standard deviations of both, rad and m, beyond what is usual. The default is a single camera's own
    optical frame. known: False for a pose that is not known; with `extrinsics`
    learn, it is found from the person. Raises CameraError if they are not a rotation and a finite translation.
    """

    name: str = ""
    rotation: np.ndarray = field(default_factory=lambda: AXES)
    translation: np.ndarray = field(default_factory=lambda: ORIGIN)
    known: bool = True
    deviation: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not _is_pose(self.rotation, self.translation):
            raise CameraError(
                f"camera {self.name!r} has the rotation {_listed(self.rotation)} and the translation "
                f"{_listed(self.translation)}; expected arrays, a rotation (3, 3) (R R^T = 1, det R = 1) into the "
                "camera's frame, and (3,) finite m"
            )

    @cached_property
    def is_identity(self) -> bool:
        """Whether the skeleton is kept in this camera's optical frame."""
        return self.known and bool(np.array_equal(self.rotation, np.eye(3)) and not self.translation.any())

    @cached_property
    def centre(self) -> np.ndarray:
        """(3,) m: the camera's centre in the frame of the skeleton."""
        return -self.rotation.T @ self.translation

    @property
    def inverse(self) -> CameraPose:
        """The pose of a camera whose transform is the inverse of this one's."""
        return CameraPose(self.name, self.rotation.T, self.centre)

    def relative_to(self, first: CameraPose) -> CameraPose:
        """The pose in the optical frame of another camera; the pose itself if it is not known."""
        return self.after(first.inverse) if self.known else self

    def is_at(self, other: CameraPose) -> bool:
        """Whether another pose is the same."""
        if self is other:
            return True
        return np.array_equal(self.rotation, other.rotation) and np.array_equal(self.translation, other.translation)

    def after(self, earlier: CameraPose) -> CameraPose:
        """The pose that maps as this one does what the earlier one has mapped."""
        return CameraPose(
            self.name, self.rotation @ earlier.rotation, self.rotation @ earlier.translation + self.translation
        )

    def into_camera(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) m in the camera's optical frame."""
        return points if self.is_identity else points @ self.rotation.T + self.translation


def _is_pose(rotation: np.ndarray, translation: np.ndarray) -> bool:
    """Whether the arrays are a rotation (3, 3) and a finite translation (3,).

    With numbers it takes 1 us, a tenth of numpy's time: poses are made in every frame.
    """
    try:
        (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
        x, y, z = translation.tolist()
        first, second, between = a * a + b * b + c * c - 1, d * d + e * e + f * f - 1, a * d + b * e + c * f
        u, v, w = b * f - c * e - g, c * d - a * f - h, a * e - b * d - i  # the third row is the product of the others
        wrong = first * first + second * second + between * between + u * u + v * v + w * w + 0.0 * (x + y + z)
        return bool(wrong < 0.01**2)  # matrices with 3 decimals pass; False for NaN
    except (AttributeError, TypeError, ValueError):
        return False


def _listed(values: object) -> str:
    return str(values.tolist() if isinstance(values, np.ndarray) else values)[:200]


HERE = CameraPose()
"""A single camera, in whose optical frame the skeleton is kept."""


@dataclass(frozen=True, eq=False)
class Observation:
    """One frame's keypoints of one person, seen by one camera.

    stamp: s. points: (l, 2) normalised image coordinates without distortion, NaN = missing. confidence: (l,) from 0 to
    1, 0 = missing. focal: px per normalised unit; it converts `noise_px` to that unit.
    depth: (l,) m along the optical axis, measured at each landmark, NaN = none; None without a depth sensor.
    depth_deviation: (l,) m, standard deviation of `depth`; None for the configured one.
    depth_of_surface: True if `depth` is that of the body's surface, as a depth camera measures it; False if it is that
    of the landmark inside the body. depth_age: s by which `depth` is older than the points.
    extra: data for the user's own evidence, by name; it reads them from `FrameData.extra`. camera: which camera, and
    where.
    """

    stamp: float
    points: np.ndarray
    confidence: np.ndarray
    focal: float
    depth: np.ndarray | None = None
    depth_deviation: np.ndarray | None = None
    depth_of_surface: bool = False
    depth_age: float = 0.0
    extra: Mapping[str, Any] = field(default_factory=dict)
    camera: CameraPose = HERE


SHORTEST_S, LONGEST_S = 5.0, 250.0
"""s: steps between observations that are those of a camera of 200 to 4 Hz in ms."""
IN_A_ROW = 10
"""Such steps in a row after which there is a warning."""


class StampUnit:
    """Watches the steps between the stamps of the observations."""

    def __init__(self) -> None:
        self._newest: float | None = None
        self._steps, self._numbers = 0, False

    def add(self, stamp: float) -> None:
        """Use the stamp of an observation, s. Warns once of each."""
        try:
            step = 0.0 if self._newest is None else float(stamp - self._newest)
        except TypeError:  # no number, see gate_observation
            return
        self._newest = stamp
        if step == 0.0 or self._steps > IN_A_ROW:
            return
        is_number = step == 1.0 and stamp == round(stamp)
        if is_number != self._numbers:
            self._steps, self._numbers = 0, is_number
        self._steps = self._steps + 1 if is_number or SHORTEST_S <= step <= LONGEST_S else 0
        if self._steps == IN_A_ROW:
            self._steps += 1
            what = (
                "whole numbers, 1 apart" if is_number else f"{step:g} s apart, so that each frame is initialised anew"
            )
            remedy = "the number of a frame by the frame rate" if is_number else "a time in ms by 1000"
            warnings.warn(
                f"the stamps of {IN_A_ROW} observations in a row are {what}; expected stamps in s: divide {remedy}",
                stacklevel=4,
            )
