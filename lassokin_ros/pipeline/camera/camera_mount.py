"""The camera's mount from TF: its roll, pitch and height over a frame with its z axis up, such as base_footprint."""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.pipeline.camera.transforms import TransformError, Transforms


class CameraMount:
    """Roll, pitch and height of the camera at the time of an image."""

    subject = "the camera's mount"
    """What TF gives."""

    def __init__(self, base: str) -> None:
        """base: name of the frame with its z axis up."""
        self.base = base.lstrip("/")
        self.transforms = Transforms()
        self.fault = ""
        """Why there was no mount for the last image, in words; empty if there was one, or before the first image."""
        self.angles: tuple[float, float] | None = None
        """Roll and pitch of the last image for which TF gave them, rad; None before."""
        self.height: float | None = None
        """m: height of the camera above the base at that image; None before."""

    def at(self, frame_id: str, stamp_ns: int) -> tuple[float, float] | None:
        """Return roll and pitch, rad, for an image; None if TF does not give them, see `fault`.

        frame_id: the camera's optical frame; stamp_ns: ns, of the image.
        """
        try:
            if not frame_id:
                raise TransformError("neither keypoints nor camera_info have a frame_id")
            rotation, place = self.transforms.pose(frame_id.lstrip("/"), self.base, stamp_ns, continued=False)
            self.angles, self.height = roll_and_pitch(rotation), float(place[2])
        except TransformError as error:
            self.fault = f"camera_mount_frame is '{self.base}': {error}"
            return None
        self.fault = ""
        return self.angles

    @property
    def known(self) -> bool:
        """True if TF has given a mount."""
        return self.angles is not None

    @property
    def meanwhile(self) -> str:
        """What is used as long as TF gives no mount, in words."""
        return "the last mount from TF is used" if self.known else "camera_roll and camera_pitch are used"

    def in_words(self) -> str:
        """Return the newest mount from TF, or a text that there was none."""
        if self.angles is None:
            return f"TF has given no mount over '{self.base}'"
        roll, pitch = (round(angle, 3) + 0.0 for angle in self.angles)  # no -0.000
        return f"follows TF over '{self.base}': roll {roll:.3f} rad, pitch {pitch:.3f} rad"


def roll_and_pitch(rotation: np.ndarray) -> tuple[float, float]:
    """Return roll and pitch, rad, as in the parameters `camera_roll` and `camera_pitch`.

    rotation: (3, 3), from the optical frame (x right, y down, z forward) to a frame with z up. In the camera's body
    frame (x forward, y left, z up), up is (-sin pitch, cos pitch sin roll, cos pitch cos roll).
    """
    right, down, forward = rotation[2].tolist()
    return math.atan2(-right, -down), math.atan2(-forward, math.hypot(right, down))
