"""Who is who in the images of one camera: a track of keypoints for each person in view, whether followed or not.

Place, size and number decide together, see `_assigned`. A person who is guarded (locked, or the only one who is
followed) must not be exchanged for a bystander. A detection therefore belongs to a bystander if a bystander's track
explains it nearly as well as the guarded person's does: that person is then absent.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lassokin_ros.pipeline.people.choice import GUESS_AFTER_S
from lassokin_ros.pipeline.people.matching import (
    FARTHEST,
    NEAR,
    SIZE_WEIGHT,
    SPREAD_PER_S,
    assign,
    distance,
    distances,
    match_radius,
)
from lassokin_ros.pipeline.seen import Seen

RIVAL = 0.7
"""A guarded person gets a detection that a bystander's track explains, too, if its cost is below this share of the
bystander's cost; after an absence of GUESS_AFTER_S not at all."""
FARTHEST_GUARDED = 0.5
"""Largest cost of a detection that is a guarded person's. Bystanders' tracks explain detections farther away."""
OTHER_NUMBER = 0.1
"""Cost of another number than the track's, beside that of the place."""
NUMBER_NEAR = 0.9
"""Largest cost of the place of a detection with the track's number; it grows with SPREAD_PER_S after SILENCE_S, and
from FARTHEST on there is none."""
SAME_BODY = 0.5 * NEAR
"""A detection this near to another one of the same image is a duplicate, not a second person."""
RUNS_PER_S = 1.5
"""1/s: a fast walk, of 2.5 m/s, in a person's sizes."""
LONGEST_PREDICTION_S = 0.5
"""s: a track is continued with constant velocity for this long."""
VELOCITY_MEMORY_S = 0.2
"""s: averaging time of a track's velocity."""
NO_PAIR = 100.0
"""Larger than the cost of any pair."""
ESTABLISHED = 3
"""Detections from which on a track's place counts against its number: the first ones may have been damaged."""
MOST_MISSED = 1
"""Images in a row that may miss a person, for ImageTrack.run."""
SILENCE_S = 0.5
"""s: after a longer silence of the detector, and one of SILENT_PERIODS, it may have restarted: its numbers are new."""
SILENT_PERIODS = 3.0
PAUSE_PERIODS, PAUSE_GROWTH = 1.75, 1.2
"""Usual periods, from which on images have paused; and growth of the usual period by a pause."""
JUMP_MEMORY_S = 60.0
"""s: numbers are not used for this long after one has jumped from one person to another."""


@dataclass(eq=False)
class ImageTrack:
    """The keypoints of one person over time.

    detection: the newest one; points: (l, 2) normalised, the newest position of each landmark; seen_ns: stamp of the
    newest detection; velocity: (2,) 1/s; gap_s: s between the two newest detections; by_place: the newest detection
    was found by place, not by number and place; number: the detector's, None if it is not known (any more); run: number
    of detections without two images in a row that miss the person; missed: number of images since the newest one;
    silent_s: s since the newest detection in which the detector was silent, if these are no absence.
    """

    detection: Seen
    points: np.ndarray
    seen_ns: int
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(2))
    gap_s: float = 0.0
    by_place: bool = False
    number: int | None = None
    run: int = 1
    missed: int = 0
    silent_s: float = 0.0

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
        self.detection, self.seen_ns, self.silent_s = detection, stamp_ns, 0.0
        self.run, self.missed = (self.run if self.missed <= MOST_MISSED else 0) + 1, 0


class Numbers:
    """Whether a detector's person numbers are used: a number is evidence beside the place, never instead of it.

    A number that is the index of a person in the image, or one that a detector gives to somebody else, would lead a
    lock to another person. Numbers are therefore used where the person is expected, and only as far as they have proved
    to last. Times are stamps, ns.
    """

    def __init__(self, sure: bool = False) -> None:
        """sure: the user says that a number is one person's, wherever it is (`person_ids: lasting`)."""
        self.sure = self.proven = sure
        """proven: whether an image had numbers that are no index in it, from 0 or 1 on."""
        self._heard_ns: int | None = None
        self.gap_s = self.period_s = 0.0
        """s between the two newest images; and usually: a pause hardly counts."""
        self._jump: tuple[int, int] | None = None  # stamp, ns, and number

    def hear(self, stamp_ns: int, numbers: Sequence[int]) -> bool:
        """Note the numbers of an image. Return True after a silence: nobody has a number from before."""
        self.gap_s = 0.0 if self._heard_ns is None else (stamp_ns - self._heard_ns) * 1e-9
        silent = self.gap_s > max(SILENCE_S, SILENT_PERIODS * self.period_s)
        self._heard_ns, usual_s = stamp_ns, self.period_s
        if not silent and self.gap_s > 0:
            self.period_s = min(self.gap_s, PAUSE_GROWTH * usual_s) if self.is_pause(self.gap_s) else self.gap_s
        if numbers and not (min(numbers) in (0, 1) and max(numbers) - min(numbers) == len(numbers) - 1):
            self.proven = True
        return silent and not self.sure

    def is_pause(self, seconds: float) -> bool:
        """Return whether a time between two images, s, is longer than usual."""
        return self.period_s > 0 and seconds > PAUSE_PERIODS * self.period_s

    def believed(self, stamp_ns: int) -> bool:
        """Return False for a while after a number has jumped."""
        return self._jump is None or not 0 <= (stamp_ns - self._jump[0]) * 1e-9 <= JUMP_MEMORY_S

    def jump(self, stamp_ns: int, number: int) -> None:
        """Note that a number has jumped from one person to another."""
        if not self.sure:
            self._jump = stamp_ns, number

    @property
    def jumped(self) -> int | None:
        """The number that has jumped, while the numbers are not believed for that; else None."""
        if self._jump is None or self._heard_ns is None or self.believed(self._heard_ns):
            return None
        return self._jump[1]


class ImageTracks:
    """The tracks of all people in the images of one camera. Times are stamps, ns; only differences matter."""

    def __init__(self, sure: bool = False) -> None:
        """sure: see `Numbers`."""
        self._tracks: list[ImageTrack] = []
        self.numbers = Numbers(sure)
        """What is known about the detector's numbers."""

    def __iter__(self) -> Iterator[ImageTrack]:
        return iter(self._tracks)

    def rivals(self, track: ImageTrack, away_s: float) -> list[ImageTrack]:
        """Return the other tracks that may be the person whom a track shows again in the newest image.

        Those who were not seen for as long, and whom a person reaches in this time, away_s, at RUNS_PER_S.
        """
        now_ns, reach = track.seen_ns, RUNS_PER_S * away_s
        missing = [
            one for one in self._tracks if one is not track and max(one.gap_s, one.unseen_s(now_ns)) > 0.5 * away_s
        ]
        new = [one for one in self._tracks if one is not track and one.run == 1 and one.seen_ns == now_ns]
        return [one for one in {*missing, *new} if apart(one.points, track.points) < reach]

    def seen_at(self, stamp_ns: int) -> list[ImageTrack]:
        """Return the tracks with a detection in the image of this stamp."""
        return [track for track in self._tracks if track.seen_ns == stamp_ns]

    def begin_alone(self, detection: Seen, stamp_ns: int) -> ImageTrack:
        """Begin the track of the only person, and forget all others."""
        self._tracks = [ImageTrack(detection, detection.points.copy(), stamp_ns)]
        return self._tracks[0]

    def hear(self, stamp_ns: int, numbers: Sequence[int], lasting: bool) -> bool:
        """Note the numbers of all people in an image, before `update`, also of an empty one.

        lasting: as in `Image`. Return True if nobody has a number from before any more.
        """
        forgotten = self.numbers.hear(stamp_ns, numbers)
        if forgotten or not lasting:
            for track in self._tracks:
                track.number = None
        return forgotten

    def update(
        self,
        stamp_ns: int,
        detections: Sequence[Seen],
        lasting: bool,
        forget_after: float,
        expected: Mapping[ImageTrack, np.ndarray | None] | None = None,
        guarded: Collection[ImageTrack] = (),
        placed: Collection[ImageTrack] = (),
    ) -> None:
        """Continue the tracks with the detections of one image, and begin new ones.

        lasting: the numbers say who is who, see `Numbers`. expected: the tracks of people who are followed, which are
        never forgotten, and (l, 2), where these are expected; None: by the track. guarded: those that no doubtful
        detection continues; placed: those whose place other cameras tell, so that a number is not needed. forget_after:
        s.
        """
        expected = expected or {}
        self._tracks = [t for t in self._tracks if t in expected or 0 <= t.unseen_s(stamp_ns) <= forget_after]
        rest = list(detections)
        believed = lasting and self.numbers.believed(stamp_ns)
        pairs = self._of_sure_numbers(rest) if believed and self.numbers.sure else []
        for track, detection in pairs:
            rest.remove(detection)
            track.see(detection, stamp_ns, by_place=False)
        people = expected, guarded, placed
        for track, detection, by_place in self._assigned(stamp_ns, rest, believed, forget_after, *people):
            rest.remove(detection)
            if believed and track.number not in (None, detection.number):
                self._take_number(detection.number, track, stamp_ns)
            track.see(detection, stamp_ns, by_place)
        self._begin(stamp_ns, rest)
        for track in self._tracks:
            if track.seen_ns == stamp_ns:
                track.number = track.detection.number if lasting else None
            else:
                track.missed += 1

    def _of_sure_numbers(self, detections: Sequence[Seen]) -> list[tuple[ImageTrack, Seen]]:
        """Return the detections whose numbers tracks have, with these."""
        numbered = {track.number: track for track in self._tracks if track.number is not None}
        return [(numbered[one.number], one) for one in detections if one.number in numbered]

    def _take_number(self, number: int, track: ImageTrack, stamp_ns: int) -> None:
        """Take a number from its owner. It has jumped to another track."""
        owner = next((one for one in self._tracks if one is not track and one.number == number), None)
        if owner is not None:
            owner.number = None
            self.numbers.jump(stamp_ns, number)

    def _assigned(
        self,
        stamp_ns: int,
        detections: Sequence[Seen],
        believed: bool,
        forget_after: float,
        expected: Mapping[ImageTrack, np.ndarray | None],
        guarded: Collection[ImageTrack],
        placed: Collection[ImageTrack],
    ) -> list[tuple[ImageTrack, Seen, bool]]:
        """Return tracks with detections, by least total cost, and whether it is by place only.

        The cost is that of the place, and OTHER_NUMBER. The place alone reaches as far as `match_radius`, for up to
        forget_after; with the track's number as far as `_number_radius`. In doubt a guarded person gets none.
        """
        tracks = [track for track in self._tracks if track.seen_ns != stamp_ns]
        if not tracks or not detections:
            return []
        points = [t.predicted(stamp_ns) if (place := expected.get(t)) is None else place for t in tracks]
        costs = pair_costs(np.stack(points), detections)
        unseen = np.array([track.unseen_s(stamp_ns) for track in tracks])
        reach = np.array([_reach(track, stamp_ns, track in guarded) for track in tracks])
        reach[unseen - [track.silent_s for track in tracks] > forget_after] = -1.0
        same = _same_numbers([t.number if believed else None for t in tracks], [one.number for one in detections])
        sure = same if self.numbers.proven else np.zeros_like(same)
        used = np.where((unseen > forget_after)[:, None], same, sure)
        used[[track in placed for track in tracks]] = False
        young = np.array([track.run < ESTABLISHED for track in tracks])[:, None] & same
        used |= young
        costs = np.where(used & np.isinf(costs), NUMBER_NEAR, costs)  # too few points for a place
        by_number = np.maximum(np.array([_number_radius(s) for s in unseen]), reach)
        limits = np.where(used, by_number[:, None], reach[:, None])
        limits[young] = NO_PAIR
        weighed = np.where(costs <= limits, costs + np.where(used, 0.0, OTHER_NUMBER), np.inf)
        pairs = dict(assign(weighed, np.full(len(tracks), NO_PAIR)))
        for row in [i for i, track in enumerate(tracks) if track in guarded and i in pairs and not sure[i, pairs[i]]]:
            column = pairs[row]
            rivals = [i for i in range(len(tracks)) if i not in pairs and costs[i, column] <= limits[i, column]]
            rival = min(rivals, key=lambda i: (not used[i, column], float(costs[i, column])), default=None)
            share = RIVAL if unseen[row] <= GUESS_AFTER_S else 0.0
            if rival is not None and (used[rival, column] or costs[row, column] > share * costs[rival, column]):
                pairs[rival] = pairs.pop(row)
        return [(tracks[i], detections[j], not sure[i, j]) for i, j in pairs.items()]

    def _begin(self, stamp_ns: int, detections: Sequence[Seen]) -> None:
        """Begin a track for each detection that is no duplicate of another one in the image."""
        for detection in sorted(detections, key=lambda d: -int(np.count_nonzero(d.confidence))):
            others = [track.detection for track in self.seen_at(stamp_ns)]
            if all(distance(other.points, detection, 0.0) > SAME_BODY for other in others):
                self._tracks.append(ImageTrack(detection, detection.points.copy(), stamp_ns))


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the distance of the centres of points (l, 2), over the size of the larger; 0 if it is not known."""
    known = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
    if not known.any():
        return 0.0
    size = max(float(np.linalg.norm(np.ptp(points[known], axis=0))) for points in (one, other))
    return float(np.linalg.norm(one[known].mean(axis=0) - other[known].mean(axis=0))) / max(size, 1e-6)


def _mean(vectors: np.ndarray) -> np.ndarray:
    """Return the mean (2,) of vectors (l, 2) without NaN, 0 if all have one. np.nanmean takes three times as long."""
    known = np.isfinite(vectors)
    if not np.count_nonzero(known[:, 0] & known[:, 1]):
        return np.zeros(2)
    total: np.ndarray = np.add.reduce(np.where(known, vectors, 0.0), axis=0)
    return total / np.add.reduce(known, axis=0)


def _reach(track: ImageTrack, stamp_ns: int, guarded: bool) -> float:
    """Return the largest cost of a detection that belongs to a track by its place alone."""
    radius = match_radius(track.unseen_s(stamp_ns))
    return min(radius, FARTHEST_GUARDED) if guarded else radius


def _number_radius(unseen_s: float) -> float:
    """Return the largest cost of a detection that belongs to a track by its number and its place."""
    radius = NUMBER_NEAR + SPREAD_PER_S * max(0.0, unseen_s - SILENCE_S)
    return radius if radius < FARTHEST else NO_PAIR


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


def _same_numbers(rows: Sequence[int | None], columns: Sequence[int]) -> np.ndarray:
    """Return (rows, columns) whether a person's number, None if not known, is that of a detection."""
    known = np.array([number is not None for number in rows], dtype=bool)
    owned = np.array([number or 0 for number in rows], dtype=np.int64)
    same: np.ndarray = (owned[:, None] == np.array(columns, dtype=np.int64)) & known[:, None]
    return same
