"""Who is who in the image: a track of keypoints for each person in view, whether followed or not.

A person who is followed must not be exchanged for a bystander. A detection therefore belongs to a bystander if a
bystander's track explains it nearly as well as the followed person's does: the followed person is then absent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from lassokin_ros.pipeline.people.assignment import assign
from lassokin_ros.pipeline.people.choice import GUESS_AFTER_S
from lassokin_ros.pipeline.people.matching import NEAR, distance, distances, match_radius
from lassokin_ros.pipeline.seen import Seen

RIVAL = 0.7
"""The followed person gets a detection that a bystander's track explains, too, if its cost is below this share of the
bystander's cost; after an absence of GUESS_AFTER_S not at all."""
FARTHEST_FOLLOWED = 0.5
"""Largest cost of a detection that is the followed person's. Bystanders' tracks explain detections farther away."""
SIZE_WEIGHT = 0.5
"""Weight of the logarithm of the ratio of sizes, in the cost of a pair; the rest is the distance of `matching`."""
SAME_BODY = 0.5 * NEAR
"""A detection this near to another one of the same image is a duplicate, not a second person."""
LONGEST_PREDICTION_S = 0.5
"""s: a track is continued with constant velocity for this long."""
VELOCITY_MEMORY_S = 0.2
"""s: averaging time of a track's velocity."""


@dataclass(eq=False)
class ImageTrack:
    """The keypoints of one person over time.

    detection: the newest one; points: (l, 2) normalised, the newest position of each landmark; seen_ns: stamp of the
    newest detection; velocity: (2,) 1/s; gap_s: s between the two newest detections; by_place: the newest detection
    was found by place, not by a persistent number.
    """

    detection: Seen
    points: np.ndarray
    seen_ns: int
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(2))
    gap_s: float = 0.0
    by_place: bool = False

    def unseen_s(self, stamp_ns: int) -> float:
        """Return s since the newest detection."""
        return (stamp_ns - self.seen_ns) * 1e-9

    def predicted(self, stamp_ns: int) -> np.ndarray:
        """Return the expected points (l, 2)."""
        shifted: np.ndarray = self.points + self.velocity * min(self.unseen_s(stamp_ns), LONGEST_PREDICTION_S)
        return shifted

    def see(self, detection: Seen, stamp_ns: int, by_place: bool) -> None:
        """Continue the track with a detection."""
        step = _mean(detection.points - self.points)
        self.gap_s, self.by_place = self.unseen_s(stamp_ns), by_place
        if 0 < self.gap_s <= LONGEST_PREDICTION_S:
            share = 1 - np.exp(-self.gap_s / VELOCITY_MEMORY_S)
            self.velocity = self.velocity + share * (step / self.gap_s - self.velocity)
        else:
            self.velocity = np.zeros(2)
        self.points = np.where(np.isfinite(detection.points), detection.points, self.points + step)
        self.detection, self.seen_ns = detection, stamp_ns


class ImageTracks:
    """The tracks of all people. Times are stamps, ns; only differences matter."""

    def __init__(self) -> None:
        self._tracks: list[ImageTrack] = []

    @property
    def tracks(self) -> Sequence[ImageTrack]:
        """All tracks, oldest first."""
        return self._tracks

    def seen_at(self, stamp_ns: int) -> list[ImageTrack]:
        """Return the tracks with a detection in the image of this stamp."""
        return [track for track in self._tracks if track.seen_ns == stamp_ns]

    def clear(self) -> None:
        """Forget all tracks."""
        self._tracks.clear()

    def update(
        self,
        stamp_ns: int,
        detections: Sequence[Seen],
        persistent: bool,
        forget_after: float,
        followed: ImageTrack | None = None,
        expected: Callable[[], np.ndarray | None] = lambda: None,
    ) -> None:
        """Continue the tracks with the detections of one image, and begin new ones.

        persistent: a detection with the number of a track belongs to it, wherever it is. followed: the track of the
        followed person, which is never forgotten; expected: returns (l, 2), where this person is expected, None: by the
        track. forget_after: s.
        """
        self._forget(stamp_ns, forget_after, followed)
        rest = self._continue_numbers(stamp_ns, detections) if persistent else list(detections)
        open_tracks = [track for track in self._tracks if track.seen_ns != stamp_ns]
        near = [track for track in open_tracks if track.unseen_s(stamp_ns) <= forget_after]
        for track, detection in self._assigned(stamp_ns, near, rest, followed, expected):
            rest.remove(detection)
            track.see(detection, stamp_ns, by_place=True)
        self._begin(stamp_ns, rest)

    def _forget(self, stamp_ns: int, forget_after: float, followed: ImageTrack | None) -> None:
        kept = [t for t in self._tracks if t is followed or 0 <= t.unseen_s(stamp_ns) <= forget_after]
        self._tracks = kept

    def _continue_numbers(self, stamp_ns: int, detections: Sequence[Seen]) -> list[Seen]:
        """Continue the tracks by number. Return the detections with other numbers."""
        by_number = {track.detection.number: track for track in self._tracks}
        rest = []
        for detection in detections:
            track = by_number.get(detection.number)
            if track is None:
                rest.append(detection)
            else:
                track.see(detection, stamp_ns, by_place=False)
        return rest

    def _assigned(
        self,
        stamp_ns: int,
        tracks: Sequence[ImageTrack],
        detections: Sequence[Seen],
        followed: ImageTrack | None,
        expected: Callable[[], np.ndarray | None],
    ) -> list[tuple[ImageTrack, Seen]]:
        """Return the tracks with their detections by least total cost. In doubt the followed person gets none."""
        if not tracks or not detections:
            return []
        places = [expected() if track is followed else None for track in tracks]
        points = [t.predicted(stamp_ns) if place is None else place for t, place in zip(tracks, places)]
        costs = pair_costs(np.stack(points), detections)
        limits = np.array([_reach(track, stamp_ns, track is followed) for track in tracks])
        pairs = dict(assign(costs, limits))
        row = next((i for i, track in enumerate(tracks) if track is followed), None)
        if row is not None and row in pairs:
            column = pairs[row]
            rivals = [i for i in range(len(tracks)) if i not in pairs and costs[i, column] <= limits[i]]
            rival = min(rivals, key=lambda i: float(costs[i, column]), default=None)
            share = RIVAL if tracks[row].unseen_s(stamp_ns) <= GUESS_AFTER_S else 0.0
            if rival is not None and costs[row, column] > share * costs[rival, column]:
                pairs[rival] = pairs.pop(row)
        return [(tracks[i], detections[j]) for i, j in pairs.items()]

    def _begin(self, stamp_ns: int, detections: Sequence[Seen]) -> None:
        """Begin a track for each detection that is no duplicate of another one in the image."""
        for detection in sorted(detections, key=lambda d: -int(np.count_nonzero(d.confidence))):
            others = [track.detection for track in self.seen_at(stamp_ns)]
            if all(distance(other.points, detection, 0.0) > SAME_BODY for other in others):
                self._tracks.append(ImageTrack(detection, detection.points.copy(), stamp_ns))


def _mean(vectors: np.ndarray) -> np.ndarray:
    """Return the mean (2,) of vectors (l, 2) without NaN, 0 if all have one. np.nanmean takes three times as long."""
    known = np.isfinite(vectors)
    if not np.count_nonzero(known[:, 0] & known[:, 1]):
        return np.zeros(2)
    total: np.ndarray = np.add.reduce(np.where(known, vectors, 0.0), axis=0)
    return total / np.add.reduce(known, axis=0)


def _reach(track: ImageTrack, stamp_ns: int, followed: bool) -> float:
    """Return the largest cost of a detection that belongs to a track."""
    radius = match_radius(track.unseen_s(stamp_ns))
    return min(radius, FARTHEST_FOLLOWED) if followed else radius


def pair_costs(predicted: np.ndarray, detections: Sequence[Seen]) -> np.ndarray:
    """Return the cost (p, d) of each pair of predicted points (p, l, 2) and a detection: distance, and ratio of sizes.

    Infinite with too few common points.
    """
    costs = distances(predicted, detections, 0.0)
    points = np.stack([detection.points for detection in detections])
    common = np.isfinite(points[None]) & np.isfinite(predicted[:, None])
    with np.errstate(invalid="ignore", divide="ignore"):
        sizes = [_spread(np.where(common, of, np.nan)) for of in (predicted[:, None], points[None])]
        ratio = np.abs(np.log(sizes[1] / sizes[0]))
    result: np.ndarray = costs + SIZE_WEIGHT * np.where(np.isfinite(ratio), ratio, 0.0)
    return result


def _spread(points: np.ndarray) -> np.ndarray:
    """Return the root mean square distance of points (..., l, 2) from their centre; NaN points are ignored."""
    counts = np.maximum(np.count_nonzero(np.isfinite(points), axis=-2, keepdims=True), 1)
    centre = np.nansum(points, axis=-2, keepdims=True) / counts
    spread: np.ndarray = np.sqrt(np.nansum((points - centre) ** 2, axis=(-2, -1)) / counts[..., 0, 0])
    return spread
