"""Where the cameras are, in the frame in which the skeleton is kept: from TF at the time of each image."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np

from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.transforms import STALE_NS, TransformError, Transforms
from msg_adapters.errors import AdapterError

LEVEL = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""(3, 3) from a frame with z up to the optical frame of a level camera that looks along its y axis."""
GivenPoses = Mapping[str, CameraPose] | Callable[[int], CameraPose]
"""Poses of cameras by name, or a function that returns that of the only camera at a stamp, ns."""


class CameraPlaces:
    """The poses of the cameras in one frame."""

    subject, meanwhile = "the cameras' poses", "images of the camera are rejected"
    """What TF gives, and what is done without it."""

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
        self._frame_ids: dict[str, str] = {}  # of the last image of each camera

    def pose(self, name: str, frame_id: str, stamp_ns: int) -> CameraPose:
        """Return the pose of a camera at the time of its image, and keep it in `newest`.

        name: of the camera; frame_id: its optical frame; stamp_ns: ns, of the image. Raises AdapterError with the
        reason `no_transform`.
        """
        self._frame_ids[name] = frame_id = frame_id.lstrip("/")
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
        return self.transforms.reach_ns(self._frame_ids.get(name, ""), self.base) is not None

    def others(self, names: Collection[str], stamp_ns: int) -> list[CameraPose]:
        """Return where the cameras without an image are at a time, as far as TF tells it. They may be on a robot.

        names: of the cameras with an image; stamp_ns: ns.
        """
        found = (self.at(name, stamp_ns) for name in self.newest if name not in names)
        return [pose for pose in found if pose is not None]  # the next image of the others will tell

    def at(self, name: str, stamp_ns: int) -> CameraPose | None:
        """Return where a camera that has sent images was at a time, ns; None if TF does not tell it."""
        try:
            return self._pose(name, self._frame_ids[name], stamp_ns)
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
        for name, frame_id in self._frame_ids.items():
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
