"""The tracked motion of each person over a whole recording, collected frame by frame for the exports; and its floor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lassokin_ros.common.array_spool import ArraySpool, Record
from lassokin_ros.core.body.roles import is_finger
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.replay.body import floor_height
from lassokin_ros.replay.report.spans import marked_frames

FACE = "head"
ASSUMED, GIVEN = "assumed", "given"
"""Where lens and height come from."""
DETECTED, REPROJECTED = "detected", "reprojected"


@dataclass(frozen=True, eq=False)
class Seen:
    """What one of several cameras saw in f frames: detected and reprojected landmarks (f, l, 2) px, NaN = missing.

    Both are NaN in a frame without an image of the camera.
    """

    detected: np.ndarray
    reprojected: np.ndarray


@dataclass(frozen=True, eq=False)
class Motion:
    """The f accepted frames of one person, in recording order; camera optical frame, m and rad.

    Attributes
    ----------
    person: the id, empty in single-person mode.
    frame_id: the camera frame of the last frame.
    skeleton: the skeleton of the last frame; with calibration, earlier frames have other bone lengths.
    landmark_names: l names.
    stamps_ns: (f,) int64.
    positions: (f, n, 3) joint centres, as published on `joints`.
    rotations: (f, n, 3, 3) rotation of each joint in its parent's frame; of the root in the camera frame.
    translations: (f, 3) of the root.
    angles: (f, n, 3) about x, y and z of each joint, as published on `joint_states`.
    landmarks: (f, l, 3); detected: (f, l, 2) px of the raw image, NaN = missing; of several cameras, of the first one.
    reprojection_px, relative_gap: (f,); support_size: (f,) int; initialised: (f,) bool.
    deviations: (f, n) m and rotation_deviations: (f, n) rad, see `JointUncertainty`; observed: (f, n) bool, the joints
    that keypoints show.
    likely_wrong: (f,) bool, the frames that the report marks.
    contacts: (f, n) bool, ankles of feet that stand still.
    level: (3, 3) rotation from the camera frame to the frame of a level camera at the same place.
    floor: m above the camera, the floor under the feet in the level frame, the same for all people; 0, the camera's
    height, if the feet are seen in few frames.
    cameras: what each of several cameras saw, by name; empty with one camera.
    smoothing: s, time constant of the smoothing with later frames, which flattens fast motion; 0 without.
    start_ns: stamp at which the recording begins for all people: that of the first frame, 0 of a video's first image.
    lens, height_from: `ASSUMED` or `GIVEN`, the field of view or camera_info, and the person's height.
    """

    person: str
    frame_id: str
    skeleton: Skeleton
    landmark_names: tuple[str, ...]
    stamps_ns: np.ndarray
    positions: np.ndarray
    rotations: np.ndarray
    translations: np.ndarray
    angles: np.ndarray
    landmarks: np.ndarray
    detected: np.ndarray
    reprojection_px: np.ndarray
    relative_gap: np.ndarray
    support_size: np.ndarray
    initialised: np.ndarray
    deviations: np.ndarray
    rotation_deviations: np.ndarray
    observed: np.ndarray
    likely_wrong: np.ndarray
    contacts: np.ndarray
    level: np.ndarray
    floor: float = 0.0
    cameras: Mapping[str, Seen] = field(default_factory=dict)
    smoothing: float = 0.0
    start_ns: int = 0
    lens: str = GIVEN
    height_from: str = GIVEN

    @property
    def angles_observed(self) -> np.ndarray:
        """(f, n) bool: keypoints show which way a joint turns; otherwise the pose prior alone gives its angles.

        A joint turns its children, so one of them must be observed. Of the joints without children, the head and the
        last ones of fingers carry keypoints beside their centre.
        """
        skeleton, result = self.skeleton, np.zeros_like(self.observed)
        for child, parent in enumerate(skeleton.parents):
            if parent >= 0:
                result[:, parent] |= self.observed[:, child]
        ends = [name == FACE or is_finger(name) and name.endswith("3") for name in skeleton.joint_names]
        result[:, ends] |= self.observed[:, ends]
        return result

    @property
    def speeds(self) -> np.ndarray:
        """(f, n) m/s of each joint, from the frames before and after; NaN where stamps jump back."""
        seconds = (self.stamps_ns - self.stamps_ns[:1]) * 1e-9
        if self.frame_count < 2:
            return np.full(self.positions.shape[:2], np.nan)
        before = np.maximum(np.arange(self.frame_count) - 1, 0)
        after = np.minimum(np.arange(self.frame_count) + 1, self.frame_count - 1)
        elapsed = seconds[after] - seconds[before]
        ways = np.linalg.norm(self.positions[after] - self.positions[before], axis=-1)
        backwards = (seconds < seconds[before]) | (seconds[after] < seconds)
        return ways / np.where(backwards | (elapsed <= 0), np.nan, elapsed)[:, None]

    @property
    def start(self) -> float:
        """s from the begin of the recording to this person's first frame."""
        return float(self.stamps_ns[0] - self.start_ns) * 1e-9

    @property
    def frame_count(self) -> int:
        """The number of frames, f."""
        return len(self.stamps_ns)


class MotionRecorder:
    """Collect the accepted frames of each person in a temporary file: 4 kB per frame, 0.5 GB for an hour at 30 Hz."""

    def __init__(
        self,
        landmark_names: Sequence[str],
        config: TrackerConfig,
        level: Callable[[], np.ndarray],
        origin_ns: int = 0,
        cameras: Sequence[str] = (),
        lens: str = GIVEN,
        height_from: str = GIVEN,
    ) -> None:
        """landmark_names: l names. config: of the tracker. level: returns (3, 3), see `Motion`, after the last frame.

        origin_ns: stamp that becomes 0. cameras: names of several cameras. lens, height_from: see
        `Motion`.
        """
        self._cameras = tuple(cameras) if len(cameras) > 1 else ()
        self._landmark_names, self._level, self._origin_ns = tuple(landmark_names), level, origin_ns
        smoothing = config.smoothing if config.smoothing_lag > 0 else 0.0
        self._sources = {"lens": lens, "height_from": height_from, "smoothing": smoothing}
        self._spool = ArraySpool()
        self._people: dict[str, list[Record]] = {}
        self._last: dict[str, FrameResult] = {}

    def add(self, frames: Sequence[FrameResult], time_ns: int = 0, seconds: float = 0.0) -> None:
        """Add the frames of one keypoint message, see `Playback.listeners`. Rejected frames add no row."""
        for frame in frames:
            if frame.accepted and frame.estimate is not None:
                self._people.setdefault(frame.person, []).append(self._spool.append(self._row(frame)))
                self._last[frame.person] = frame

    def _row(self, frame: FrameResult) -> dict[str, np.ndarray]:
        """Return the arrays of an accepted frame, see `Motion`."""
        estimate = frame.estimate
        assert estimate is not None and estimate.state is not None and estimate.pose is not None
        assert estimate.certificate is not None and frame.positions is not None
        missing = np.full((len(estimate.pose.landmarks), 2), np.nan)
        images = {image.camera.name: image for image in frame.images}
        main = images.get(self._cameras[0]) if self._cameras else frame
        row = {
            "stamps_ns": frame.stamp_ns,
            "positions": estimate.pose.positions,
            "rotations": estimate.state.rotations,
            "translations": estimate.state.translation,
            "angles": frame.positions[3:].reshape(-1, 3),
            "landmarks": estimate.pose.landmarks,
            "detected": missing if main is None or main.detected is None else main.detected,
            "reprojection_px": estimate.reprojection_px,
            "relative_gap": estimate.certificate.relative_gap,
            "support_size": estimate.certificate.support_size,
            "initialised": estimate.initialised,
            "deviations": frame.uncertainty.deviation,
            "rotation_deviations": frame.uncertainty.rotation_deviation,
            "observed": frame.observed,
            "signs": frame.doubt.has_sign,
            "likely_wrong": frame.doubt.likely_wrong,
            "contacts": frame.contacts,
        }
        for name in self._cameras:
            image = images.get(name)
            row[f"{name} {DETECTED}"] = missing if image is None or image.detected is None else image.detected
            row[f"{name} {REPROJECTED}"] = missing if image is None else image.project(estimate.pose.landmarks)
        return {name: np.asarray(value) for name, value in row.items()}

    def motions(self) -> list[Motion]:
        """Return one motion per person, in order of first appearance; empty if nobody was tracked."""
        motions = []
        for person, records in self._people.items():
            last, columns = self._last[person], self._spool.columns(records)
            assert last.skeleton is not None
            columns["stamps_ns"] = columns["stamps_ns"] - self._origin_ns
            seconds = (columns["stamps_ns"] - columns["stamps_ns"][0]) * 1e-9
            columns["likely_wrong"] = marked_frames(seconds, columns.pop("signs"), columns["likely_wrong"])
            pairs = {
                name: [columns.pop(f"{name} {kind}") for kind in (DETECTED, REPROJECTED)] for name in self._cameras
            }
            seen = {name: Seen(*pair) for name, pair in pairs.items()}
            rest: dict[str, Any] = {**columns, "level": self._level(), "cameras": seen, **self._sources}
            motions.append(Motion(person, last.frame_id, last.skeleton, self._landmark_names, **rest))
        floor = np.array([_floor(motion) for motion in motions])
        common = float(np.median(floor[np.isfinite(floor)])) if np.isfinite(floor).any() else 0.0
        first = min((int(motion.stamps_ns[0]) for motion in motions), default=0)
        start_ns = 0 if self._origin_ns else first
        return [replace(motion, floor=common, start_ns=start_ns) for motion in motions]


def _floor(motion: Motion) -> float:
    names, height = motion.skeleton.joint_names, motion.skeleton.height
    return floor_height(names, height, motion.positions, motion.observed, motion.contacts, motion.level)
