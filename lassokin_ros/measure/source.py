"""The motion to be measured: an exported one, or one that is tracked first."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import is_zipfile

import numpy as np

from lassokin_ros.common.summary_output import print_note
from lassokin_ros.measure.poses import MeasureError, Poses, read_poses

UNSMOOTHED: Mapping[str, float] = {"smoothing": 0.02, "smoothing_lag": 0.0}
"""Settings that keep fast motion: the smoothing with later frames that files get flattens the swing of the knees."""


class NotTracked(Exception):
    """`lassokin track` failed, and has said why on stderr. The argument is its exit code."""


def poses_of(source: str, person: str | None, track: Sequence[str]) -> Poses:
    """Return the motion of an export, or of a video or of keypoints, which are tracked first.

    person: the id in an export, or the --person of `track`. track: options of `lassokin track`, for a video. Raises
    MeasureError; NotTracked if the video is not tracked, of which `track` has said the reason on stderr.
    """
    path = Path(source)
    if _is_motion(path):
        if track:
            raise MeasureError(f"'{source}' is tracked already; expected no {track[0]}, which is for a video")
        return read_poses(path, person)
    from lassokin_ros.video.command import main as track_command

    with TemporaryDirectory() as folder:
        motion = Path(folder) / "motion.npz"
        settings = [text for name, value in UNSMOOTHED.items() for text in ("-p", f"{name}:={value}")]
        who = [] if person is None else ["--person", person]
        with redirect_stdout(io.StringIO()) as summary:
            code = track_command([source, *settings, *who, *track, "--export", str(motion)])
        lines = [line for line in summary.getvalue().splitlines() if not line.startswith("written ")]
        print_note("\n".join(lines))
        if code:
            raise NotTracked(code)
        if not motion.is_file():
            raise MeasureError(f"nobody was tracked in '{source}'")
        return read_poses(motion, None)


def _is_motion(path: Path) -> bool:
    """Whether a file is an export, not a source of `track`: any .npz but one of keypoints alone."""
    if path.suffix != ".npz" or not is_zipfile(path):
        return path.suffix in (".npz", ".npy")
    try:
        with np.load(path, allow_pickle=False) as file:
            return "joint_positions" in file
    except (OSError, ValueError):
        return True
