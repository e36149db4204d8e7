"""Files that are saved on request: a calibrated skeleton (YAML), and the cameras' poses as commands."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from datetime import datetime, timezone
from pathlib import Path

from lassokin_ros.common.atomic_files import AtomicFiles, files_of_people, refuse_existing
from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LassokinError, SkeletonError
from lassokin_ros.core.learned.bone_lengths import Calibration
from lassokin_ros.pipeline.concerns.catalogue import words_of
from lassokin_ros.pipeline.concerns.live import wrong_cameras
from lassokin_ros.pipeline.outputs.figures import length_changes
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import SKELETON_SUFFIXES

LEAST_MOTION = 1.0
"""s of motion that calibration must have used before its skeleton is saved."""


def check_skeleton_file(path: Path, several: bool, replace: bool) -> None:
    """Raise SkeletonError if no skeleton can be saved at `path`. Call it before the work.

    several: one file per person, with the id in the name; replace: an existing file may be replaced.
    """
    if path.suffix.lower() not in SKELETON_SUFFIXES:
        ends = " or ".join(SKELETON_SUFFIXES)
        raise SkeletonError(f"'{path}' is no name for a skeleton; expected one that ends in {ends}")
    path = Path(os.path.expanduser(path))
    if not path.parent.exists():  # the folder will be created
        return
    for file in files_of_people(path.parent, path.stem, path.suffix) if several else [path]:
        refuse_existing(file, replace, SkeletonError)


def save_all(
    calibrations: Mapping[str, Calibration], path: Path, now_ns: int, files: AtomicFiles | None = None
) -> list[Path]:
    """Write a file for each calibrated person, all or none, and return the paths (with `~` resolved).

    calibrations: by id, an empty id if one person is followed; now_ns: ns since 1970, for the comment; files: the set
    of files to which they are added. Raises SkeletonError (or the error of `files`) if a file cannot be written, or
    nobody is calibrated. An existing file is then kept.
    """
    if not calibrations:
        raise SkeletonError("nothing has been calibrated: nobody is there")
    ready = {person: known for person, known in calibrations.items() if known.kept_motion >= LEAST_MOTION}
    texts = {person: _calibrated_text(known, now_ns) for person, known in (ready or calibrations).items()}
    with AtomicFiles(replace=True, error=SkeletonError) if files is None else nullcontext(files) as whole:
        return [_write(for_person(path, person), text, whole, SkeletonError) for person, text in texts.items()]


def _calibrated_text(calibration: Calibration, now_ns: int) -> str:
    """Return the calibrated skeleton and its comment. Raises SkeletonError if nothing is calibrated."""
    if calibration.kept_motion < LEAST_MOTION:
        raise SkeletonError(
            f"nothing has been calibrated: {calibration.kept_motion:.1f} s of motion seen, expected {LEAST_MOTION:g} "
            "or more; set the parameter calibrate and let the person move"
        )
    skeleton = calibration.skeleton
    state = "the lengths are final" if calibration.frozen else "the lengths were still being learned"
    date = datetime.fromtimestamp(now_ns // 1_000_000_000, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    changes = [f"{name} {change:+.1f} %" for name, change in length_changes(calibration).items()]
    return skeleton_text(
        skeleton,
        (
            f"Calibrated by lassokin_ros, {date}.",
            f"For a height of {skeleton.height:g} m: use it with the same parameter height.",
            f"{calibration.kept_motion:g} s of motion counted; {state}.",
            f"Changed from skeleton {_quoted(skeleton.name)}: {', '.join(changes)}.",
        ),
    )


def skeleton_text(skeleton: Skeleton, comments: Sequence[str] = ()) -> str:
    """Return a skeleton in the YAML format of `Skeleton.load`, in metres."""
    lines = [f"# {comment}" for comment in comments]
    lines += [f"name: {_quoted(skeleton.name)}", "height_unit: metre", "joints:"]
    for joint, name in enumerate(skeleton.joint_names):
        parent = skeleton.parents[joint]
        above = "null" if parent < 0 else _quoted(skeleton.joint_names[parent])
        place = ", ".join(map(repr, skeleton.rest_positions[joint].tolist()))
        free = "".join(letter for axis, letter in enumerate("xyz") if 3 * joint + axis not in skeleton.locked)
        rest = f'axes: "{skeleton.axes[joint]}"' + (f', free: "{free}"' if free != "xyz" else "")
        lines.append(f"  - {{name: {_quoted(name)}, parent: {above}, position: [{place}], {rest}}}")
    return "\n".join(lines) + "\n"


def write_text(path: Path, text: str, error: type[LassokinError] = SkeletonError) -> Path:
    """Write a file completely or not at all, and its folder. Return the path with `~` resolved. Raises `error`."""
    with AtomicFiles(replace=True, error=error) as files:
        return _write(path, text, files, error)


def _write(path: Path, text: str, files: AtomicFiles, error: type[LassokinError]) -> Path:
    """Write the file as one of `files`."""
    try:
        path = path.expanduser()
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_text(path, text)
    except LassokinError:
        raise
    except (OSError, ValueError, RuntimeError) as problem:  # the path has no name, or `~` has no home directory
        reason = getattr(problem, "strerror", None) or problem
        raise error(f"'{path}' cannot be written: {reason}") from None
    return path


def for_person(path: Path, person: str) -> Path:
    """Return the path of one of several people's files: the id is added to its name."""
    return path.with_name(f"{path.stem}_{person}{path.suffix}") if person and path.name else path


def _quoted(text: str) -> str:
    """Return a YAML string; JSON strings are valid YAML."""
    return json.dumps(text)


COMMAND = "ros2 run tf2_ros static_transform_publisher"


class CamerasFileError(LassokinError):
    """The poses of the cameras cannot be written."""


def camera_commands(session: Session) -> list[str]:
    """Return one command for each camera whose pose was learned.

    Raises CamerasFileError if none was, or if the keypoints show that a camera is wrong.
    """
    places, extrinsics = session.placement.places, session.roster.extrinsics
    if places is None or not session.config.several_cameras:
        raise CamerasFileError("there is one camera, or none with a pose; expected several (parameter cameras)")
    if wrong := words_of(wrong_cameras(session, learned=False)):
        raise CamerasFileError(
            f"nothing is written, because {'; '.join(wrong)}. Correct that, reset the tracker, and save when a person "
            "has been seen for some seconds"
        )
    commands = []
    for name, camera in session.cameras.items():
        if extrinsics is None or name not in places.newest:
            continue
        if extrinsics.solution(name) is None and name not in extrinsics.found:
            continue
        pose = extrinsics.learned(places.newest[name])
        x, y, z = pose.centre.tolist()
        qx, qy, qz, qw = to_quaternion(pose.rotation.T[None])[0].tolist()
        commands.append(
            f"{COMMAND} --x {x:.4f} --y {y:.4f} --z {z:.4f} --qx {qx:.6f} --qy {qy:.6f} --qz {qz:.6f} --qw {qw:.6f} "
            f"--frame-id {shlex.quote(places.base)} --child-frame-id {shlex.quote(places.frame_ids[camera.name])}"
        )
    if not commands:
        raise CamerasFileError(
            "no pose of a camera was learned yet; expected a person in view of two cameras for some seconds, and "
            "extrinsics check or learn"
        )
    return commands


def save_cameras(session: Session, path: Path) -> Path:
    """Write the commands, one in a line; run the file with bash. Raises CamerasFileError."""
    commands = "".join(f"{command} &\n" for command in camera_commands(session))
    return write_text(path, commands + "wait\n", CamerasFileError)
