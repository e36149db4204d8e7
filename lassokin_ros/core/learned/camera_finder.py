"""The place of a camera without a given pose, from the person whom it and the placed cameras see.

Each side follows the person by itself. The rigid motion that brings the joints of one to those of the other is near the
camera's pose, and `Extrinsics.find` fits the epipolar lines of the same frames from there.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lassokin_ros.core.image.frame_data import View
from lassokin_ros.core.observation import HERE, CameraPose, Observation, has_passed

if TYPE_CHECKING:
    from lassokin_ros.core.learned.extrinsics import Extrinsics
    from lassokin_ros.core.tracker import Tracker


class UnplacedCameras:
    """Those without a pose: each follows the person with a tracker of its own until it is found."""

    def __init__(self, new_tracker: Callable[[], Tracker]) -> None:
        self._new_tracker = new_tracker
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self.trackers: dict[str, Tracker] = {}

    def find(self, observations: Iterable[Observation], placed: Tracker, extrinsics: Extrinsics) -> None:
        """Compare what these cameras see, each by itself, with the person whom the placed cameras track."""
        for one in observations:
            name = one.camera.name
            if name not in self.trackers:
                self.trackers[name] = self._new_tracker()
            own = self.trackers[name].track(replace(one, camera=HERE))
            seen, seen_alone = placed.seen_at(one.stamp), self.trackers[name].seen_at(one.stamp)
            if not own.accepted or own.repeated or seen is None or seen_alone is None:
                continue
            (view, joints), (alone, own_joints) = seen, seen_alone
            extrinsics.find(name, one.stamp, (view, alone), (joints, own_joints))
            if name in extrinsics.found:
                del self.trackers[name]


FEWEST_FRAMES, EVERY = 50, 10
"""Frames before the pose is computed, and between two trials."""


class CameraFinder:
    """The frames that both a camera without a pose and a placed one have seen."""

    def __init__(self, period: float, longest: int) -> None:
        """period: s between two frames that are kept; longest: number of frames that are kept."""
        self._period, self._newest, self._count = period, -math.inf, 0
        self._joints: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=longest)
        self.views: deque[tuple[View, View]] = deque(maxlen=longest)
        """Both views of each kept frame: of the placed camera, and of the one without a pose."""

    def add(self, stamp: float, views: tuple[View, View], joints: tuple[np.ndarray, np.ndarray]) -> bool:
        """Add a frame. Returns True if it is time to compute the pose.

        views: of a camera with a pose, and of the one without, at a stamp, s. joints: (n, 3) m, in the frame of the
        skeleton; and in that of the camera without a pose, by its own images alone.
        """
        if not has_passed(stamp - self._newest, self._period):
            return False
        self._newest, self._count = stamp, self._count + 1
        self._joints.append(joints)
        self.views.append(views)
        return self._count >= FEWEST_FRAMES and self._count % EVERY == 0

    def resize(self, ratio: float, centre: np.ndarray | None) -> None:
        """Scale the kept joints to a body that is taller by a factor, about the cameras that saw them.

        centre: (3,) m, of the only placed camera; None if several observe where the body is.
        """
        for number, (placed, alone) in enumerate(self._joints):
            self._joints[number] = placed if centre is None else centre + ratio * (placed - centre), ratio * alone

    def pose(self, name: str) -> CameraPose:
        """Return the camera's pose that brings the joints of all frames to those that it sees, in least squares.

        Source: Kabsch (1976); Umeyama (1991) for the sign.
        """
        X, Y = (np.concatenate(parts) for parts in zip(*self._joints))
        x, y = X.mean(axis=0), Y.mean(axis=0)
        U, _, Vt = np.linalg.svd((Y - y).T @ (X - x))
        rotation = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        return CameraPose(name, rotation, y - rotation @ x)
