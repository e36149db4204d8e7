"""Cameras of several videos whose places nobody tells: they are found from the person."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

import numpy as np

from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.learned.camera_finder import FEWEST
from lassokin_ros.core.learned.extrinsics import PERIOD_S
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.calibration_file import Calibration
from lassokin_ros.pipeline.session import Session


def found_poses(session: Session) -> dict[str, CameraPose]:
    """Return the pose of each camera by name after a pass over all images. Raises CameraError if one was not found."""
    places, extrinsics = session.placement.places, session.extrinsics
    assert places is not None
    for name in session.cameras:
        if name not in places.newest:
            raise CameraError(
                f"the place of camera '{name}' was not found; expected a person who moves in view of it and of the "
                f"first camera for {FEWEST * PERIOD_S:g} s or more, in synchronised videos; or --cameras FILE"
            )
    given = {name: places.newest[name] for name in session.cameras}
    return given if extrinsics is None else {name: extrinsics.learned(pose) for name, pose in given.items()}


def where_in_words(pose: CameraPose, first: CameraPose) -> str:
    """Return where a camera is, as seen from the first one."""
    turn = math.degrees(float(np.linalg.norm(logarithm((pose.rotation @ first.rotation.T)[None])[0])))
    apart = float(np.linalg.norm(pose.centre - first.centre))
    return f"found {apart:.2f} m from the first camera, turned by {turn:.0f} degrees"


def calibration_toml(cameras: Sequence[tuple[str, Calibration]], poses: Mapping[str, CameraPose]) -> str:
    """Return a calibration file of lenses and poses that --cameras reads, in the form of Pose2Sim."""
    lines = []
    for name, lens in cameras:
        pose, (width, height) = poses[name], lens.size
        lines += [
            f"[{json.dumps(name, ensure_ascii=False)}]",  # a string of TOML; without quotes few characters are allowed
            f"name = {json.dumps(name, ensure_ascii=False)}",
            f"size = [{width}.0, {height}.0]",
            f"matrix = {lens.K.tolist()}",
            f'distortion_model = "{lens.model}"',
            f"distortions = {np.asarray(lens.D, dtype=float).tolist()}",
            f"rotation = {logarithm(pose.rotation[None])[0].tolist()}",
            f"translation = {pose.translation.tolist()}",
            "",
        ]
    return "\n".join(lines)
