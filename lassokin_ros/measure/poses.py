"""A person's joints over time, from a file that `--export` wrote."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from lassokin_ros.core.errors import LassokinError

NEEDED = ("stamp_ns", "person", "people", "joint_names", "joint_positions", "level", "likely_wrong")


class MeasureError(LassokinError, ValueError):
    """A motion cannot be read, or shows nothing that can be measured."""


@dataclass(frozen=True, eq=False)
class Poses:
    """A motion. seconds: (f,). names: of n joints. positions: (f, n, 3) m in a level frame: x right, y down, z forward.

    likely_wrong: (f,) bool, the frames that the report marks. smoothing: s, see `Motion`.
    """

    seconds: np.ndarray
    names: tuple[str, ...]
    positions: np.ndarray
    likely_wrong: np.ndarray
    smoothing: float = 0.0

    def place(self, joint: str) -> np.ndarray:
        """Return (f, 3) m. Raises MeasureError for a joint that the skeleton lacks."""
        if joint not in self.names:
            raise MeasureError(f"the motion has no joint '{joint}'; its joints are: {', '.join(self.names)}")
        return np.asarray(self.positions[:, self.names.index(joint)])

    def middle(self, part: str) -> np.ndarray:
        """Return (f, 3) m, the middle of the left and the right `part`."""
        return 0.5 * (self.place(f"left_{part}") + self.place(f"right_{part}"))

    @property
    def rate(self) -> float:
        """Hz, of the median period."""
        return float(1 / np.median(np.diff(self.seconds)))


def smoothed(values: np.ndarray, poses: Poses, seconds: float) -> np.ndarray:
    """Return values (f, ...), averaged over a window of this length about each frame; shorter at the ends."""
    half = round(seconds * poses.rate / 2)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    frames = np.arange(len(values))
    first, last = np.maximum(frames - half, 0), np.minimum(frames + half + 1, len(values))
    shape = (-1, *[1] * (values.ndim - 1))
    return np.asarray((total[last] - total[first]) / (last - first).reshape(shape))


def read_poses(path: Path, person: str | None) -> Poses:
    """Return the motion of one person. person: the id if the file has several. Raises MeasureError."""
    try:
        with np.load(path, allow_pickle=False) as file:
            lacking = [name for name in NEEDED if name not in file]
            data = {name: file[name] for name in NEEDED if name in file}
            smoothing = float(file["smoothing"]) if "smoothing" in file else 0.0
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
    seconds = (data["stamp_ns"][mine] - data["stamp_ns"][mine][:1]) * 1e-9
    if len(seconds) < 3 or np.diff(seconds).min() <= 0:
        raise MeasureError(f"'{path}' has {len(seconds)} frames in order; expected a recording of some seconds")
    positions = data["joint_positions"][mine] @ data["level"].T
    return Poses(seconds, tuple(map(str, data["joint_names"])), positions, data["likely_wrong"][mine], smoothing)
