"""The motion of each person over a whole recording, for the exports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lassokin_ros.core.body.roles import is_finger
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.pipeline.session import Session
from lassokin_ros.replay.body import floor_of
from lassokin_ros.replay.frames import DETECTED, REPROJECTED, SEEN, FrameTable, PersonRows, in_view
from lassokin_ros.replay.spans import marked, wrong_spans

FACE = "head"
ASSUMED, GIVEN = "assumed", "given"
"""Where lens and height come from."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What holds for all people of a recording.

    Attributes
    ----------
    landmark_names: l names.
    cameras: names of several cameras; empty with one.
    level: (3, 3) rotation from the camera frame to the frame of a level camera at the same place.
    floor: m above the camera, the floor under the feet in the level frame; 0, the camera's height, if the feet are seen
    in few frames.
    start_ns: stamp at which the recording begins: that of the first frame, 0 of a video's first image.
    smoothing: s, time constant of the smoothing with later frames, which flattens fast motion; 0 without.
    lens, height_from: `ASSUMED` or `GIVEN`, the field of view or camera_info, and the people's height.
    """

    landmark_names: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    level: np.ndarray = field(default_factory=lambda: np.eye(3))
    floor: float = 0.0
    start_ns: int = 0
    smoothing: float = 0.0
    lens: str = GIVEN
    height_from: str = GIVEN


@dataclass(frozen=True, eq=False)
class Motion:
    """The f accepted frames of one person, in recording order; camera optical frame, m and rad.

    person: the id, empty if one person is followed. frame_id: the camera frame of the last frame. skeleton: that of the
    last frame; with calibration, earlier frames have other bone lengths. frames: arrays (f, ...) by their names in a
    .npz, see `write_npz`.
    """

    person: str
    frame_id: str
    skeleton: Skeleton
    frames: Mapping[str, np.ndarray]
    scene: Scene

    def __getitem__(self, name: str) -> np.ndarray:
        """One of the arrays (f, ...)."""
        return self.frames[name]

    @property
    def start(self) -> float:
        """s from the begin of the recording to this person's first frame."""
        return float(self["stamp_ns"][0] - self.scene.start_ns) * 1e-9

    @property
    def frame_count(self) -> int:
        """The number of frames, f."""
        return len(self["stamp_ns"])


def scene_of(session: Session, level: np.ndarray, lens: str = GIVEN, height_from: str = GIVEN) -> Scene:
    """Return what a session knows of the scene; see `Scene`, whose floor and start `motions` finds."""
    config, names = session.tracker.config, tuple(session.cameras)
    smoothing, cameras = config.smoothing if config.smoothing_lag > 0 else 0.0, names if len(names) > 1 else ()
    layout = tuple(session.tracker.layout.names)
    return Scene(layout, cameras, level, smoothing=smoothing, lens=lens, height_from=height_from)


def motions(table: FrameTable, scene: Scene, origin_ns: int = 0) -> list[Motion]:
    """Return one motion per person, in order of first appearance; empty if nobody was tracked.

    scene: its floor and start are found. origin_ns: stamp that becomes 0, the begin of the recording.
    """
    found = []
    for person, rows in table.people.items():
        if rows.last is None or rows.last.skeleton is None:
            continue
        columns = table.columns(person)
        accepted = columns["accepted"]
        if not accepted.all():
            columns = {name: values[accepted] for name, values in columns.items()}
        columns["stamp_ns"] = columns["stamp_ns"] - origin_ns
        columns |= _derived(rows, columns, rows.last.skeleton, scene.cameras)
        found.append(Motion(person, rows.last.frame_id, rows.last.skeleton, columns, scene))
    floors = np.array([floor_of(one.skeleton, one.frames, scene.level) for one in found])
    floor = float(np.median(floors[np.isfinite(floors)])) if np.isfinite(floors).any() else 0.0
    start_ns = 0 if origin_ns else min((int(motion["stamp_ns"][0]) for motion in found), default=0)
    return [replace(motion, scene=replace(scene, floor=floor, start_ns=start_ns)) for motion in found]


def _derived(
    rows: PersonRows, columns: Mapping[str, np.ndarray], skeleton: Skeleton, cameras: Sequence[str]
) -> dict[str, np.ndarray]:
    """Return what follows from the columns of the table."""
    doubts = [doubt for doubt in rows.doubts if doubt is not None]
    derived = {
        "detected_px": columns[DETECTED],
        "likely_wrong": marked(columns["time"], wrong_spans(columns["time"], doubts)),
        "angles_observed": angles_observed(skeleton, columns["joint_observed"]),
        "joint_speeds": speeds(columns["stamp_ns"], columns["joint_positions"]),
    }
    for number, name in enumerate(cameras):
        seen = columns[in_view(SEEN, number)][:, None, None]
        derived[f"detected_px_{name}"] = columns[in_view(DETECTED, number)]
        derived[f"reprojected_px_{name}"] = np.where(seen, columns[in_view(REPROJECTED, number)], np.nan)
    return derived


def angles_observed(skeleton: Skeleton, observed: np.ndarray) -> np.ndarray:
    """Return (f, n) bool: keypoints show which way a joint turns; otherwise the pose prior alone gives its angles.

    A joint turns its children, so one of them must be observed, (f, n) bool. Of the joints without children, the head
    and the last ones of fingers carry keypoints beside their centre.
    """
    result = np.zeros_like(observed)
    for child, parent in enumerate(skeleton.parents):
        if parent >= 0:
            result[:, parent] |= observed[:, child]
    ends = [name == FACE or is_finger(name) and name.endswith("3") for name in skeleton.joint_names]
    result[:, ends] |= observed[:, ends]
    return result


def speeds(stamps_ns: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Return (f, n) m/s of each joint, from the frames before and after; NaN where stamps jump back.

    stamps_ns: (f,). positions: (f, n, 3) m.
    """
    if (count := len(stamps_ns)) < 2:
        return np.full(positions.shape[:2], np.nan)
    seconds = (stamps_ns - stamps_ns[:1]) * 1e-9
    before, after = np.maximum(np.arange(count) - 1, 0), np.minimum(np.arange(count) + 1, count - 1)
    elapsed = seconds[after] - seconds[before]
    ways = np.linalg.norm(positions[after] - positions[before], axis=-1)
    backwards = (seconds < seconds[before]) | (seconds[after] < seconds)
    return np.asarray(ways / np.where(backwards | (elapsed <= 0), np.nan, elapsed)[:, None])
