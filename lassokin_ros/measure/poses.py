"""A person's joints over time, from a file that `--export` wrote, or from a video, which is tracked first."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import BadZipFile, is_zipfile

import numpy as np

from lassokin_ros.common.command_line import print_note
from lassokin_ros.core.errors import LassokinError

NEEDED = (
    *("stamp_ns", "person", "people", "joint_names", "joint_positions", "joint_observed", "level", "likely_wrong"),
    *("joint_contacts", "start_ns"),
)
SIDES, LEG = ("left", "right"), ("hip", "knee", "ankle")
UNSMOOTHED: Mapping[str, float] = {"smoothing": 0.02, "smoothing_lag": 0.0}
"""Settings that keep fast motion: the smoothing with later frames that files get flattens the swing of the knees."""
LONGEST_GAP_S, HIDDEN_S = 0.25, 0.4
"""s without a frame, and without keypoints of a leg, over which nothing is measured: an event in it may be missed."""


class MeasureError(LassokinError, ValueError):
    """A motion cannot be read, or shows nothing that can be measured."""


class NotTracked(Exception):
    """`lassokin track` failed, and has said why on stderr. The argument is its exit code."""


@dataclass(frozen=True, eq=False)
class Poses:
    """A motion. seconds: (f,), since the begin of the video or recording. names: of n joints.

    positions: (f, n, 3) m in a level frame: x right, y down, z forward. likely_wrong: (f,) bool, the frames that the
    report marks. smoothing: s, see `Scene`. observed: (f, n) bool, joints that keypoints show; None = all. contacts:
    (f, n) bool, ankles of feet that stand still on the floor; None = unknown. cameras: their number. lens, height:
    where they come from, see `Scene`; empty = unknown.
    """

    seconds: np.ndarray
    names: tuple[str, ...]
    positions: np.ndarray
    likely_wrong: np.ndarray
    smoothing: float = 0.0
    observed: np.ndarray | None = None
    contacts: np.ndarray | None = None
    cameras: int = 1
    lens: str = ""
    height: str = ""

    def place(self, joint: str) -> np.ndarray:
        """Return (f, 3) m. Raises MeasureError for a joint that the skeleton lacks."""
        return np.asarray(self.positions[:, self._index(joint)])

    def middle(self, part: str) -> np.ndarray:
        """Return (f, 3) m, the middle of the left and the right `part`."""
        return 0.5 * (self.place(f"left_{part}") + self.place(f"right_{part}"))

    def shown(self, side: str) -> np.ndarray:
        """Return (f,) bool: keypoints show the leg, or did so shortly before and after."""
        joints = [self._index(f"{side}_{joint}") for joint in LEG]
        if self.observed is None:
            return np.ones(len(self.seconds), dtype=bool)
        times = self.seconds[self.observed[:, joints].all(axis=1)]
        before = np.append(self.seconds[0], times)[np.searchsorted(times, self.seconds, side="right")]
        after = np.append(times, self.seconds[-1])[np.searchsorted(times, self.seconds, side="left")]
        return np.asarray(after - before <= HIDDEN_S)

    def pieces(self, known: np.ndarray | None = None) -> list[Poses]:
        """Return the parts without a gap in which all frames are known. known: (f,) bool; None = all."""
        known = np.ones(len(self.seconds), dtype=bool) if known is None else known
        gap = np.diff(self.seconds) > LONGEST_GAP_S
        ends = np.flatnonzero(np.concatenate([[True], gap | (known[1:] != known[:-1]), [True]]))
        per_frame = {name: getattr(self, name) for name in ("seconds", "positions", "likely_wrong", "observed")}
        given = {name: values for name, values in per_frame.items() if values is not None}
        return [
            replace(self, **{name: values[a:b] for name, values in given.items()})
            for a, b in zip(ends, ends[1:])
            if known[a]
        ]

    def unseen(self) -> list[str]:
        """Return lines about what is not measured: legs that no keypoint shows, and gaps between frames."""
        hidden = {side: 1 - float(self.shown(side).mean()) for side in SIDES}
        gaps = [float(gap) for gap in np.diff(self.seconds) if gap > LONGEST_GAP_S]
        lines = [
            f"keypoints do not show the whole {side} leg in {share:.0%} of the frames: it is not measured there"
            for side, share in hidden.items()
            if share > 0
        ]
        words = "a gap of" if len(gaps) == 1 else f"{len(gaps)} gaps of up to"
        return lines + [f"{words} {max(gaps):.1f} s between frames: nothing is measured across"] if gaps else lines

    def _index(self, joint: str) -> int:
        if joint not in self.names:
            raise MeasureError(f"the motion has no joint '{joint}'; its joints are: {', '.join(self.names)}")
        return self.names.index(joint)


def read_poses(path: Path, person: str | None) -> Poses:
    """Return the motion of one person. person: the id if the file has several. Raises MeasureError."""
    if path.is_file() and not is_zipfile(path):
        raise MeasureError(f"'{path}' is no .npz; expected one that --export wrote: --export motion.npz")
    try:
        with np.load(path, allow_pickle=False) as file:
            lacking = [name for name in NEEDED if name not in file]
            data = {name: file[name] for name in NEEDED if name in file}
            smoothing = float(file["smoothing"]) if "smoothing" in file else 0.0
            lens, height = (str(file[name]) if name in file else "" for name in ("lens", "height_from"))
            cameras = len(file["camera_names"]) if "camera_names" in file else 1
    except (OSError, EOFError, BadZipFile, ValueError, TypeError) as error:  # TypeError: one array, a .npy
        raise MeasureError(f"'{path}' cannot be read ({error}); expected a .npz that --export wrote") from None
    if lacking:
        raise MeasureError(f"'{path}' has no {', '.join(lacking)}; expected a .npz that --export of this release wrote")
    people = [str(name) for name in data["people"]]
    if person is None and len(people) > 1:
        raise MeasureError(f"'{path}' holds {len(people)} people; choose one with --person: {', '.join(people)}")
    if person is not None and person not in people:
        raise MeasureError(f"--person {person}: '{path}' holds {', '.join(filter(None, people)) or 'one person'}")
    mine = data["person"] == (people[0] if person is None else person)
    seconds = (data["stamp_ns"][mine] - data["start_ns"]) * 1e-9
    if len(seconds) < 3:
        raise MeasureError(f"'{path}' has {len(seconds)} frames; expected a recording of some seconds")
    if np.diff(seconds).min() <= 0:
        back = int(np.argmin(np.diff(seconds))) + 1
        raise MeasureError(
            f"the stamps of '{path}' jump back at frame {back}, as in a looped recording; expected stamps that "
            "increase: replay each part of the recording separately"
        )
    positions = data["joint_positions"][mine] @ data["level"].T
    names, wrong = tuple(map(str, data["joint_names"])), data["likely_wrong"][mine]
    seen, contacts = data["joint_observed"][mine], data["joint_contacts"][mine]
    return Poses(seconds, names, positions, wrong, smoothing, seen, contacts, cameras, lens, height)


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
