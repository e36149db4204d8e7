"""The offset between the stamps of a camera that turns and TF, as people show who do not turn with it.

If an image is stamped `s` too late, TF gives the pose that the camera has s later. A person at p in the fixed frame is
then seen at p + s u, where u is the velocity of a point at p that is fixed to the camera. Across the line of sight, the
places q of a second or two are fitted by q = a + b t + s u: who walks on changes a and b alone. The offset is the
median over such parts, of all people. Nothing is changed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.image.projection import MEDIAN_OF_NORMAL
from lassokin_ros.pipeline.camera.camera_places import CameraPlaces
from lassokin_ros.pipeline.frame_result import FrameResult

PART_NS, LATE_NS, STEP_NS = 1_800_000_000, 600_000_000, 25_000_000
"""ns: duration of a part; how much later TF may come; step of the differences that give u."""
FEWEST_IMAGES = 9
TURNS_M_S = 0.4
"""m/s: least standard deviation of u across the line of sight, in a part that counts."""
STAYS = -0.7
"""Largest correlation of the person's motion in the image with that of the camera. Somebody whom the robot follows with
its camera stays in the middle of the image: a lag of the robot would look like an offset."""
PARTS, FEWEST_PARTS = 25, 5
"""Newest parts that are used, and least number."""
LEAST_DEVIATION_S = 0.01
"""s: least standard deviation of a part."""
SMALLEST_S, CLEARLY = 0.015, 3.0
"""s and standard deviations: an offset beyond both is said."""
MEDIANS = 1.25
"""Standard deviation of a median over that of a mean."""
UP = np.array([0.0, 0.0, 1.0])


class _Row(NamedTuple):
    """A person in an image, m and m/s in the fixed frame. sight: (3,) from the camera; speed: (3,), u."""

    stamp_ns: int
    place: np.ndarray
    sight: np.ndarray
    speed: np.ndarray


@dataclass
class _Track:
    """The newest images of a person: stamps, ns, and places (3,) m in the camera's frame that wait for TF, and rows."""

    newest_ns: int
    waiting: deque[tuple[int, np.ndarray]] = field(default_factory=deque)
    rows: list[_Row] = field(default_factory=list)


class TfOffset:
    """Finds the offset of each camera. Times are ns."""

    def __init__(self, places: CameraPlaces) -> None:
        """places: of the cameras, in a frame with z up, from TF."""
        self._places = places
        self.reset()

    def reset(self) -> None:
        """Forget all people and offsets."""
        self._tracks: dict[tuple[str, str], _Track] = {}
        self._offsets: dict[str, deque[float]] = {}

    def update(self, frames: Sequence[FrameResult]) -> None:
        """Use the results of an instant. People whom several cameras see at once are left out."""
        for frame in frames:
            if not frame.accepted or len(frame.images) > 1 or not self._places.moves(frame.camera.name):
                continue
            assert frame.estimate is not None and frame.estimate.pose is not None
            now_ns, camera, key = frame.stamp_ns, frame.camera, (frame.camera.name, frame.label or frame.person)
            track = self._tracks.get(key)
            if track is None or not 0 < now_ns - track.newest_ns < LATE_NS:
                recent = {k: one for k, one in self._tracks.items() if abs(now_ns - one.newest_ns) < PART_NS}
                track = _Track(now_ns)
                self._tracks = {**recent, key: track}
            track.newest_ns = now_ns
            track.waiting.append((now_ns, camera.into_camera(frame.estimate.pose.positions[0])))
            self._advance(camera.name, track)

    def _advance(self, camera: str, track: _Track) -> None:
        """Use the images of a person for which TF must have come."""
        while track.newest_ns - track.waiting[0][0] >= LATE_NS:
            if (row := self._row(camera, *track.waiting.popleft())) is not None:
                track.rows.append(row)
        if len(track.rows) > 1 and track.rows[-1].stamp_ns - track.rows[0].stamp_ns >= PART_NS:
            if (offset := _offset(track.rows)) is not None:
                self._offsets.setdefault(camera, deque(maxlen=PARTS)).append(offset)
            track.rows.clear()

    def _row(self, camera: str, stamp_ns: int, inside: np.ndarray) -> _Row | None:
        """Return where a person was; None if TF does not tell the poses. inside: (3,) m, in the camera's frame."""
        poses = [self._places.at(camera, stamp_ns + step) for step in (-STEP_NS, 0, STEP_NS)]
        known = [pose for pose in poses if pose is not None and not any(pose.deviation)]
        if len(known) < len(poses):
            return None
        before, place, after = (pose.inverse.into_camera(inside) for pose in known)
        return _Row(stamp_ns, place, place - known[1].centre, (after - before) / (2e-9 * STEP_NS))

    def of(self, camera: str) -> tuple[float, float] | None:
        """Return the offset of a camera's stamps and its standard deviation, s; None if it is not known."""
        offsets = np.array(self._offsets.get(camera, ()))
        if len(offsets) < FEWEST_PARTS:
            return None
        middle = float(np.median(offsets))
        spread = max(float(np.median(np.abs(offsets - middle))) / MEDIAN_OF_NORMAL, LEAST_DEVIATION_S)
        return middle, MEDIANS * spread / float(np.sqrt(len(offsets)))

    def clear(self, camera: str) -> tuple[float, float] | None:
        """Return the same if the stamps are off beyond doubt."""
        found = self.of(camera)
        return found if found is not None and abs(found[0]) > max(SMALLEST_S, CLEARLY * found[1]) else None


def _offset(rows: Sequence[_Row]) -> float | None:
    """Return the offset, s, that a part shows; None if it shows none."""
    if len(rows) < FEWEST_IMAGES:
        return None
    stamps, places, sights, speeds = (np.array(column) for column in zip(*rows))
    across = np.cross(UP, sights.mean(axis=0))
    across /= max(float(np.linalg.norm(across)), 1e-9)
    times, q, u = 1e-9 * (stamps - stamps[0]), places @ across, speeds @ across
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (u[1:] + u[:-1]) * np.diff(times))])
    values, line = np.column_stack([q, u, turned]), np.column_stack([np.ones_like(times), times])
    q, u, turned = (values - line @ np.linalg.lstsq(line, values, rcond=None)[0]).T
    if np.std(u) < TURNS_M_S or np.corrcoef(q - turned, turned)[0, 1] > STAYS:
        return None
    return float(q @ u / (u @ u))
