"""The poses of the cameras as they are used, as commands that publish them as static transforms."""

from __future__ import annotations

import shlex
from pathlib import Path

from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.errors import LassokinError, SkeletonError
from lassokin_ros.pipeline.concerns.cameras import wrong_cameras
from lassokin_ros.pipeline.concerns.catalogue import words_of
from lassokin_ros.pipeline.outputs.description.skeleton_file import write_text
from lassokin_ros.pipeline.session import Session

COMMAND = "ros2 run tf2_ros static_transform_publisher"


class CamerasFileError(LassokinError):
    """The poses of the cameras cannot be written."""


def camera_commands(session: Session) -> list[str]:
    """Return one command for each camera whose pose was learned.

    Raises CamerasFileError if none was, or if the keypoints show that a camera is wrong.
    """
    places, extrinsics = session.placement.places, session.extrinsics
    if places is None or not session.config.several_cameras:
        raise CamerasFileError("there is one camera, or none with a pose; expected several (parameter cameras)")
    if wrong := words_of(wrong_cameras(session, learned=False)):
        raise CamerasFileError(
            f"nothing is written, because {'; '.join(wrong)}. Correct that, reset the tracker, and save when a person "
            "has been seen for some seconds"
        )
    commands = []
    for name, camera in session.cameras.items():
        given = places.newest.get(name)
        if extrinsics is None or given is None:
            continue
        if extrinsics.solution(name) is None and name not in extrinsics.found:
            continue
        pose = extrinsics.learned(given)
        x, y, z = pose.centre.tolist()
        qx, qy, qz, qw = to_quaternion(pose.rotation.T[None])[0].tolist()
        commands.append(
            f"{COMMAND} --x {x:.4f} --y {y:.4f} --z {z:.4f} --qx {qx:.6f} --qy {qy:.6f} --qz {qz:.6f} --qw {qw:.6f} "
            f"--frame-id {shlex.quote(places.base)} --child-frame-id {shlex.quote(camera.image_frame)}"
        )
    if not commands:
        raise CamerasFileError(
            "no pose of a camera was learned yet; expected a person in view of two cameras for some seconds, and "
            "extrinsics check or learn"
        )
    return commands


def save_cameras(session: Session, path: Path) -> Path:
    """Write the commands, one in a line; run the file with bash. Raises CamerasFileError."""
    commands = camera_commands(session)
    try:
        return write_text(path, "".join(f"{command} &\n" for command in commands) + "wait\n")
    except SkeletonError as error:
        raise CamerasFileError(str(error)) from None
