"""A calibrated skeleton as a YAML file that the parameter `skeleton` takes."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from datetime import datetime, timezone
from pathlib import Path

from lassokin_ros.common.atomic_files import AtomicFiles, files_of_people, refuse_existing
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.calibration import Calibration
from lassokin_ros.core.errors import LassokinError, SkeletonError
from lassokin_ros.core.yaml_files import SUFFIXES
from lassokin_ros.pipeline.outputs.calibration_status import length_changes

LEAST_MOTION = 1.0
"""s of motion that calibration has to have seen before its skeleton is worth a file."""


def check_skeleton_file(path: Path, several: bool, replace: bool) -> None:
    """Raise SkeletonError when no skeleton could be saved at `path`: said before the work rather than after it.

    several: each of several people has a file, the id added; replace: one that is there gives way.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise SkeletonError(f"'{path}' is no name for a skeleton; expected one that ends in {' or '.join(SUFFIXES)}")
    path = Path(os.path.expanduser(path))
    if not path.parent.exists():  # it will be made
        return
    for file in files_of_people(path.parent, path.stem, path.suffix) if several else [path]:
        refuse_existing(file, replace, SkeletonError)


def save_all(
    calibrations: Mapping[str, Calibration], path: Path, now_ns: int, files: AtomicFiles | None = None
) -> list[Path]:
    """Write a file for everybody who has been calibrated, `~` resolved, all or none; the paths.

    calibrations: by id, an empty one where one person is followed; now_ns: ns since 1970, for the comment; files: the
    set of which they are to be some. Raises SkeletonError (or what `files` does) when a file cannot be written, or
    nobody has been calibrated; a file that was there before then stays as it was.
    """
    if not calibrations:
        raise SkeletonError("nothing has been calibrated: nobody is there")
    ready = {person: known for person, known in calibrations.items() if known.moved >= LEAST_MOTION}
    texts = {person: _calibrated_text(known, now_ns) for person, known in (ready or calibrations).items()}
    with AtomicFiles(replace=True, error=SkeletonError) if files is None else nullcontext(files) as whole:
        return [_write(for_person(path, person), text, whole) for person, text in texts.items()]


def _calibrated_text(calibration: Calibration, now_ns: int) -> str:
    """What calibration knows by now. Raises SkeletonError when nothing has been calibrated."""
    if calibration.moved < LEAST_MOTION:
        raise SkeletonError(
            f"nothing has been calibrated: {calibration.moved:.1f} s of motion seen, expected {LEAST_MOTION:g} or "
            "more; set the parameter calibrate and let the person move"
        )
    skeleton = calibration.skeleton
    state = "the lengths are final" if calibration.frozen else "the lengths were still being learned"
    changes = [f"{name} {change:+.1f} %" for name, change in length_changes(calibration).items()]
    return skeleton_text(
        skeleton,
        (
            f"Calibrated by lassokin_ros, {_date(now_ns)}.",
            f"For a height of {skeleton.height:g} m: use it with the same parameter height.",
            f"{calibration.moved:g} s of motion counted; {state}.",
            f"Changed from skeleton {_quoted(skeleton.name)}: {', '.join(changes)}.",
        ),
    )


def skeleton_text(skeleton: Skeleton, comments: Sequence[str] = ()) -> str:
    """A skeleton in the YAML form that `Skeleton.load` reads, in metres."""
    lines = [f"# {comment}" for comment in comments]
    lines += [f"name: {_quoted(skeleton.name)}", "height_unit: metre", "joints:"]
    for joint, name in enumerate(skeleton.joint_names):
        parent = skeleton.parents[joint]
        above = "null" if parent < 0 else _quoted(skeleton.joint_names[parent])
        place = ", ".join(map(repr, skeleton.rest_positions[joint].tolist()))
        axes = skeleton.axes[joint]
        lines.append(f'  - {{name: {_quoted(name)}, parent: {above}, position: [{place}], axes: "{axes}"}}')
    return "\n".join(lines) + "\n"


def write_text(path: Path, text: str) -> Path:
    """Write a file whole or not at all, its folder too; the path, `~` resolved. SkeletonError when it is impossible."""
    with AtomicFiles(replace=True, error=SkeletonError) as files:
        return _write(path, text, files)


def _write(path: Path, text: str, files: AtomicFiles) -> Path:
    """The same as one of `files`."""
    try:
        path = path.expanduser()
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_text(path, text)
    except LassokinError:
        raise
    except (OSError, ValueError, RuntimeError) as problem:  # no name in the path, no home for `~`
        reason = getattr(problem, "strerror", None) or problem
        raise SkeletonError(f"'{path}' cannot be written: {reason}") from None
    return path


def for_person(path: Path, person: str) -> Path:
    """The path of one of several people's files: the id at the end of its name."""
    return path.with_name(f"{path.stem}_{person}{path.suffix}") if person and path.name else path


def _date(now_ns: int) -> str:
    return datetime.fromtimestamp(now_ns // 1_000_000_000, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")


def _quoted(text: str) -> str:
    """A YAML string; JSON's are."""
    return json.dumps(text)
