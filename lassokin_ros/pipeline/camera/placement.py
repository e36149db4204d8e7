"""Where the cameras of the images of one instant are, and which of them are used.

A pose is given, or comes from TF, or is found from the person whom another camera sees. The images of a camera that
contradicts the others are left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.core.config import LEARN
from lassokin_ros.core.learned.vertical import level_from_camera
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.camera_places import LEVEL, CameraPlaces, GivenPoses, PoseJumps
from lassokin_ros.pipeline.camera.camera_selection import View
from lassokin_ros.pipeline.camera.rig_check import RigCheck
from lassokin_ros.pipeline.camera.tf_offset import TfOffset
from lassokin_ros.pipeline.camera.transforms import Transforms
from lassokin_ros.pipeline.people.camera_agreement import LEFT_OUT, CameraAgreement
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Image, Sight
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.errors import AdapterError

JUMPS = "jumps of the cameras in fixed_frame"
"""Key of the count of images before which the poses of all cameras in TF have jumped."""


class Placement:
    """The cameras of a session. Their poses are those in the frame of the skeleton."""

    def __init__(
        self,
        config: NodeSettings,
        people: Sequence[TrackedPerson],
        counts: Counter[str],
        poses: GivenPoses | None,
    ) -> None:
        """people: all who can be tracked. poses: given ones, in place of those from TF."""
        self._people, self.counts, self._several_people = people, counts, config.several_people
        self._names, self._several = config.camera_names, config.several_cameras
        placed = bool(config.fixed_frame) or config.several_cameras or callable(poses)
        self.places = CameraPlaces(config.fixed_frame, self._names, poses) if placed else None
        """Where the cameras are; None for one camera in whose frame the skeleton is kept."""
        self._fixed = bool(config.fixed_frame)
        self.use_floor(config.floor)
        self.jumps = PoseJumps()
        """Jumps of all cameras in their fixed frame."""
        follows_tf = self.places is not None and self._fixed and poses is None
        self.tf_offset = TfOffset(self.places) if self.places is not None and follows_tf else None
        """The offsets between the stamps of cameras and TF in a fixed frame; None if TF does not move them."""
        self.agreement = CameraAgreement()
        """Which of several cameras contradicts the others about the one person who is followed."""
        layout, skeleton = people[0].tracker.layout, people[0].tracker.skeleton
        rest = skeleton.rest_positions[layout.joints] + layout.offsets
        self.rig = RigCheck(self._names, layout.names, rest, config.fixed_frame)
        """What this person says about the places and the clocks of the cameras."""
        for tracked in people:
            if config.several_cameras:
                tracked.tracker.learned.extrinsics.anchor = self._names[0]

    def reset(self) -> None:
        """Forget the people: what they have shown about the cameras."""
        self.agreement.reset()
        self.rig.reset()
        self.jumps.reset()
        if self.tf_offset is not None:
            self.tf_offset.reset()

    @property
    def transforms(self) -> Transforms | None:
        """The buffer of TF; None if it is not used."""
        return None if self.places is None else self.places.transforms

    @property
    def camera_angles(self) -> tuple[float, float]:
        """Roll and pitch of the camera's mount by the settings, rad."""
        config = self._people[0].tracker.config
        return config.camera_roll, config.camera_pitch

    @property
    def level(self) -> np.ndarray:
        """(3, 3) from the frame of the skeleton to the optical frame of a level camera."""
        return LEVEL if self._fixed else level_from_camera(*self.camera_angles)

    @property
    def camera_height(self) -> float | None:
        """m: height of the first camera above the floor; None if it is not known where the floor is."""
        floor = self._people[0].tracker.floor
        if floor is None:
            return None
        pose = self.places.newest.get(self._names[0]) if self.places is not None else None
        return float(floor[3] + (0.0 if pose is None else floor[:3] @ pose.centre))

    def frame_id(self, view: View | None) -> str:
        """Return the frame of the skeleton before the first image. view: of the first camera, None without one."""
        if self.places is not None:
            return self.places.base
        return "" if view is None else view.intrinsics.frame_id

    def use_floor(self, known: bool) -> None:
        """Use the floor at height 0 of the fixed frame, if it is known that there is one."""
        for tracked in self._people:
            tracked.tracker.floor_below = 0.0 if known else None

    def placed(self, images: Sequence[Image]) -> tuple[Sequence[Image], str]:
        """Return the images whose camera has a pose, and the frame of the results.

        Raises AdapterError if none has one. The others are counted. Poses that are to be found from the person come
        last.
        """
        if self.places is None:
            return images, images[0].frame_id
        placed: list[Image] = []
        missing: list[tuple[Image, AdapterError]] = []
        for image in images:
            try:
                pose = self.places.pose(image.camera.name, image.frame_id, image.stamp_ns)
                placed.append(replace(image, camera=pose))
            except AdapterError as error:
                missing.append((image, error))
        stamp_ns = max(image.stamp_ns for image in images)
        others = self.places.others([image.camera.name for image in images], stamp_ns)
        moved = self.jumps.update(stamp_ns, [*(image.camera for image in placed), *others])
        for tracked in self._people:
            tracked.tracker.place_cameras(others)
            if moved is not None:
                tracked.move_frame(moved, stamp_ns)
        if moved is not None:
            self.counts[JUMPS] += 1
        return self._with_found(placed, missing), self.places.base

    def _with_found(self, placed: Sequence[Image], missing: Sequence[tuple[Image, AdapterError]]) -> list[Image]:
        """Return images with a pose by TF and those whose pose was found from the person, in the order of the cameras.

        Those whose pose is to be found come last. Others are left out; raises AdapterError if no image remains.
        """
        assert self.places is not None
        finds = self._several and self._people[0].tracker.config.extrinsics == LEARN and bool(self.places.newest)
        learned = [tracked.tracker.learned.extrinsics for tracked in self._people]
        used, order = list(placed), self._names
        for image, _ in missing:
            name = image.camera.name
            if finds:
                found = next((one.found[name] for one in learned if name in one.found), CameraPose(name, known=False))
                used.append(replace(image, camera=self.places.adopt(name, found)))
            else:
                self.counts[f"no transform of {name}" if name else "no transform"] += 1
        if not used:
            raise missing[0][1]
        return sorted(used, key=lambda image: (not image.camera.known, order.index(image.camera.name)))

    def agreeing(self, images: Sequence[Image]) -> Sequence[Image]:
        """Return the images without those of a camera that contradicts the others. These are counted."""
        if not self._several or self._several_people:
            return images
        sights, learned = [], self._people[0].tracker.learned
        for image in images:
            people = [one for one in image.people if one.trackable]
            pose = learned.extrinsics.corrected(image.camera)
            if len(people) == 1 and pose.known:
                sights.append(Sight(image.stamp_ns, people[0], image.lens, pose))
        self.rig.add(sights)
        due = [sight for sight in sights if self.agreement.is_due(sight.camera.name, sight.stamp_ns)]
        self.agreement.update(due, learned.size_check)
        for image in images:
            self.counts[f"{image.camera.name}: {LEFT_OUT}"] += image.camera.name in self.agreement.left_out
        return [image for image in images if image.camera.name not in self.agreement.left_out]
