"""Where the cameras are in the frame of the skeleton, from TF at the time of each image, and jumps of that frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.transforms import (
    FASTEST_M_S,
    FASTEST_RAD_S,
    HISTORY_NS,
    STALE_NS,
    TransformError,
    Transforms,
)
from msg_adapters.errors import AdapterError

LEVEL = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""(3, 3) from a frame with z up to the optical frame of a level camera that looks along its y axis."""
GivenPoses = Mapping[str, CameraPose] | Callable[[int], CameraPose]
"""Poses of cameras by name, or a function that returns that of the only camera at a stamp, ns."""


class CameraPlaces:
    """The poses of the cameras in one frame."""

    def __init__(self, fixed_frame: str, names: tuple[str, ...], given: GivenPoses | None = None) -> None:
        """fixed_frame: name of the frame; empty for the optical frame of the first camera. names: of the cameras.

        given: poses by name in a common frame, in place of those from TF, which gives the ones that are not known. It
        is the fixed frame, if that has a name. A function returns the pose of the only camera at a stamp, ns.
        """
        self._first = names[0]
        self._turning = given if callable(given) else None
        self._given = None if callable(given) else given
        self.base = fixed_frame.lstrip("/")
        """Name of the frame. Without a fixed frame it is that of the first camera, empty before its first image."""
        self._fixed = bool(self.base)
        if self._given is not None and not self._fixed:
            self._given = {name: self._given[name].relative_to(self._given[names[0]]) for name in names}
        self.transforms = Transforms()
        self.known = False
        """True if TF has given a pose."""
        self.newest: dict[str, CameraPose] = {}
        """The pose at the last image of each camera, by name."""
        self.faults: dict[str, str] = {}
        """Why the last image of a camera could not be placed, in words, by name."""
        self.frame_ids: dict[str, str] = {}
        """frame_id of the last image of each camera."""

    def pose(self, name: str, frame_id: str, stamp_ns: int) -> CameraPose:
        """Return the pose of a camera at the time of its image, and keep it in `newest`.

        name: of the camera; frame_id: its optical frame; stamp_ns: ns, of the image. Raises AdapterError with the
        reason `no_transform`.
        """
        self.frame_ids[name] = frame_id = frame_id.lstrip("/")
        try:
            self.newest[name] = self._pose(name, frame_id, stamp_ns)
        except TransformError as error:
            where = f"fixed_frame '{self.base}'" if self._fixed else f"the frame '{self.base}' of '{self._first}'"
            self.faults[name] = f"no pose of {f'camera {name!r}' if name else 'the camera'} in {where}: {error}"
            raise AdapterError("no_transform", self.faults[name]) from None
        self.faults.pop(name, None)
        return self.newest[name]

    def may_reach(self, frame_id: str, stamp_ns: int | None) -> bool:
        """Return True if TF moves a camera, and may still tell where it was at a stamp, ns. frame_id: of its images."""
        if stamp_ns is None or not self.base or not frame_id:
            return False
        reach_ns = self.transforms.reach_ns(frame_id, self.base)
        return reach_ns is not None and 0 < stamp_ns - reach_ns < STALE_NS

    def moves(self, name: str) -> bool:
        """Return True if TF moves a camera that has sent images."""
        return self.transforms.reach_ns(self.frame_ids.get(name, ""), self.base) is not None

    def others(self, names: Collection[str], stamp_ns: int) -> list[CameraPose]:
        """Return where the cameras without an image are at a time, as far as TF tells it. They may be on a robot.

        names: of the cameras with an image; stamp_ns: ns.
        """
        found = (self.at(name, stamp_ns) for name in self.newest if name not in names)
        return [pose for pose in found if pose is not None]  # the next image of the others will tell

    def at(self, name: str, stamp_ns: int) -> CameraPose | None:
        """Return where a camera that has sent images was at a time, ns; None if TF does not tell it."""
        try:
            return self._pose(name, self.frame_ids[name], stamp_ns)
        except TransformError:
            return None

    def _pose(self, name: str, frame_id: str, stamp_ns: int) -> CameraPose:
        """Return the pose of a camera at a time. Raises TransformError."""
        if self._turning is not None:
            self.base = frame_id
            return self._turning(stamp_ns)
        if not self._fixed and name == self._first:
            self.base = frame_id
            return CameraPose(name)
        if self._given is not None and self._given[name].known:
            return self._given[name]
        if not frame_id:
            raise TransformError("neither keypoints nor camera_info have a frame_id")
        if not self.base:
            raise TransformError(f"nothing was received of the first camera '{self._first}', in whose frame it is")
        rotation, centre = self.transforms.pose(frame_id, self.base, stamp_ns)
        self.known = True
        deviation = self.transforms.deviation(frame_id, self.base, stamp_ns)
        return CameraPose(name, rotation.T, -rotation.T @ centre, deviation=deviation)

    def adopt(self, name: str, pose: CameraPose) -> CameraPose:
        """Use the pose of a camera that was found from the person, as long as TF gives none; return it."""
        if pose.known:
            self.newest[name] = pose
            self.faults.pop(name, None)
        else:
            self.faults[name] += "; it is found from the person, after some seconds in view of both cameras"
        return pose

    @property
    def fault(self) -> str:
        """Why the last images of cameras could not be placed, in words; empty if they could."""
        return "; ".join(self.faults.values())

    @property
    def shared_frame(self) -> str:
        """That cameras have one frame_id, and so one place, in words; empty if they do not."""
        by_frame: dict[str, list[str]] = {}
        for name, frame_id in self.frame_ids.items():
            if self._given is None or not self._given[name].known:
                by_frame.setdefault(frame_id, []).append(name)
        for frame_id, names in by_frame.items():
            if len(names) > 1:
                listed = " and ".join(f"'{name}'" for name in names)
                return (
                    f"the images of {listed} have one frame_id, '{frame_id[:40]}', so that these cameras are taken to "
                    "be at one place; expected a frame_id for each: set the names of the drivers' optical frames"
                )
        return ""

    def in_words(self) -> str:
        """Return where the poses come from."""
        return f"follow TF in the frame '{self.base}'"


SHORTEST_S = 0.05
"""s: images that follow each other faster are judged as if they did not: poses of TF have noise."""
FASTEST_M_S2, SMALLEST_M = 20.0, 0.1
"""m/s^2, m: a step that differs from the motion before by more than both is a jump, too. SMALLEST_M is more than the
steps of a localisation that corrects itself."""


class PoseJumps:
    """Compares the poses of the cameras from instant to instant."""

    def __init__(self) -> None:
        self.words = ""
        """By how much the cameras have jumped the last time; empty before the first jump."""
        self.reset()

    def reset(self) -> None:
        """Forget where the cameras were."""
        self._last: tuple[int, dict[str, CameraPose]] | None = None
        self._velocities: dict[str, np.ndarray] = {}  # (3,) m/s, of each camera before the last images
        self.newest: tuple[int, CameraPose] | None = None
        """Stamp, ns, of the first image after the last jump, and how the frame has moved; None before the first one."""

    def update(self, stamp_ns: int, poses: Sequence[CameraPose]) -> CameraPose | None:
        """Return how the frame has moved since the last images if all cameras have jumped with it; None otherwise.

        stamp_ns: ns; poses: of the cameras at this time. What was at x in the frame is at `into_camera(x)` of the
        result now, because the cameras have hardly moved. A camera that jumps alone was moved.
        """
        if self._last is not None and stamp_ns <= self._last[0] < stamp_ns + HISTORY_NS:
            return None  # a late image; long before, time has started again
        last, self._last = self._last, (stamp_ns, {pose.name: pose for pose in poses})
        if last is None or stamp_ns <= last[0]:
            return None
        seconds, before = max((stamp_ns - last[0]) * 1e-9, SHORTEST_S), last[1]
        steps = [(before[pose.name], pose) for pose in poses if pose.name in before]
        velocities = [self._velocities.get(new.name) for _, new in steps]
        self._velocities = {new.name: (new.centre - old.centre) / seconds for old, new in steps}
        if not steps or not all(_jumps(*step, seconds, v) for step, v in zip(steps, velocities)):
            return None
        self._velocities = {}
        old, new = steps[0]
        rotation = new.rotation.T @ old.rotation
        moved = CameraPose(new.name, rotation, new.rotation.T @ (old.translation - new.translation))
        if any(_jumps(old.relative_to(moved), new, seconds) for old, new in steps[1:]):
            return None
        self.words = "{:.1f} m and {:.0f} degrees".format(*_step(*steps[0]))
        self.newest = stamp_ns, moved
        return moved


def _step(old: CameraPose, new: CameraPose) -> tuple[float, float]:
    """Return m and degrees from one pose of a camera to another one."""
    cosine = (float(np.vdot(new.rotation, old.rotation)) - 1) / 2
    return math.dist(new.centre, old.centre), math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))


def _jumps(old: CameraPose, new: CameraPose, seconds: float, velocity: np.ndarray | None = None) -> bool:
    """Return True if no robot moves a camera from one pose to another one in this time, s.

    velocity: (3,) m/s, of the camera before; None if it is not known.
    """
    shift, degrees = _step(old, new)
    if velocity is not None:
        surprise = float(np.linalg.norm(new.centre - old.centre - seconds * velocity))
        if surprise >= max(FASTEST_M_S2 * seconds**2, SMALLEST_M):
            return True
    return shift >= FASTEST_M_S * seconds or math.radians(degrees) >= FASTEST_RAD_S * seconds
