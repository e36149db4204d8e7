"""Who is who in the images of a file, and who is tracked (`--person`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.detector.backend import Detected
from lassokin_ros.pipeline.people.image_tracks import ImageTrack, ImageTracks
from lassokin_ros.pipeline.seen import Seen
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.video.sources import stamp_of

LARGEST, NEAREST, ALL = "largest", "nearest", "all"
MOST_PEOPLE = 4
"""People tracked with `--person all`, unless max_people is set."""
LASTING_S, LASTING_SHARE = 1.0, 0.2
"""A person is listed who is seen for 1 s, or for a fifth of a file, whichever is shorter."""

Found = tuple[float, Sequence[Detected]]
"""Time of an image, s, and the people in it."""


class PersonError(LassokinError, ValueError):
    """--person names nobody, or the detector finds one person only."""


@dataclass(frozen=True, eq=False)
class Person:
    """A person in the images of a file.

    seconds: (f,) of the images with the person. detected: the keypoints in them. sizes: (f,) px, the diagonal of the
    sure points.
    """

    seconds: np.ndarray
    detected: Sequence[Detected]
    sizes: np.ndarray

    def words(self, width: int) -> str:
        """Return when, how large and where the person is. width: of the images, px."""
        first = self.detected[0]
        middle = float(np.nanmedian(first.pixels[first.confidence > 0, 0])) / width
        place = "left" if middle < 1 / 3 else "right" if middle > 2 / 3 else "in the middle"
        span = f"{self.seconds[0]:.1f} to {self.seconds[-1]:.1f} s"
        return f"{span}, {np.median(self.sizes):.0f} px in size, at first {place}"


def people_in(images: Sequence[Found]) -> list[Person]:
    """Return the people who are seen for long enough, the largest first: by the sum of the sizes over the images.

    A person who is found again by place within `forget_after` is the same person.
    """
    gathered: dict[ImageTrack, list[tuple[float, Detected]]] = {}
    tracks, patience = ImageTracks(), NodeSettings().forget_after
    for seconds, found in images:
        points = [Seen(np.where(one.confidence[:, None] > 0, one.pixels, np.nan), one.confidence) for one in found]
        sources = dict(zip(map(id, points), found))
        tracks.update(stamp_of(seconds), points, lasting=False, forget_after=patience)
        for track in tracks.seen_at(stamp_of(seconds)):
            gathered.setdefault(track, []).append((seconds, sources[id(track.detection)]))
    everybody = [
        Person(np.array([at for at, _ in rows]), [one for _, one in rows], np.array([_size_px(one) for _, one in rows]))
        for rows in gathered.values()
    ]
    times = [seconds for seconds, _ in images]
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    needed = min(LASTING_S, LASTING_SHARE * len(times) * period)
    lasting = [one for one in everybody if len(one.seconds) * period >= needed]
    return sorted(lasting, key=lambda one: -float(one.sizes.sum()))


def people_of_shots(images: Sequence[Found], cuts: Sequence[float]) -> list[Person]:
    """Return the people of several shots: in each, they are in the order of their sizes; see `people_in`.

    cuts: s, of the first image of each shot but the first. Nothing tells who is who in another shot.
    """
    edges = [-np.inf, *cuts, np.inf]
    parts = [[one for one in images if low <= one[0] < high] for low, high in zip(edges, edges[1:])]
    return [_joined([one for one in same if one is not None]) for same in zip_longest(*map(people_in, parts))]


def _joined(parts: Sequence[Person]) -> Person:
    """Return one person of the parts of a file, in order."""
    seconds, sizes = (np.concatenate([getattr(one, name) for one in parts]) for name in ("seconds", "sizes"))
    return Person(seconds, [detected for one in parts for detected in one.detected], sizes)


def only(images: Sequence[Found], people: Sequence[tuple[int, Person]]) -> list[Found]:
    """Return the images with some people only, in their order. people: number of each, 0 for none, and the person."""
    shown = [
        dict(zip(one.seconds.tolist(), (replace(d, number=n) if n else d for d in one.detected))) for n, one in people
    ]
    return [(seconds, [of[seconds] for of in shown if seconds in of]) for seconds, _ in images]


def choose(who: str, people: Sequence[Person], most: int) -> list[int]:
    """Return the indices of the people to track.

    who: `largest`, `nearest`, `all`, or a number, 1 for the first. most: people tracked with `all`. Raises PersonError.
    """
    if who == ALL:
        return list(range(min(len(people), most)))
    if not people:
        return []
    if who == NEAREST:
        return [max(range(len(people)), key=lambda i: float(np.median(people[i].sizes)))]
    index = 0 if who == LARGEST else number_of(who) - 1
    if index >= len(people):
        raise PersonError(f"--person {who}: there are {len(people)} people in the images; expected 1 to {len(people)}")
    return [index]


def largest_in(images: Sequence[Found], camera: str, width: int) -> tuple[list[Found], str]:
    """Return the images with the largest person alone, and who else is there, in words; empty for one person.

    Others who are never in view together with those who are kept are the same person, who was out of view for a while.
    camera: its name. width: of its images, px.
    """
    people = people_in(images)
    if len(people) < 2:
        return list(images), ""
    present: set[float] = set()
    kept: dict[str, Person] = {}
    for number, person in enumerate(people, 1):
        if present.isdisjoint(person.seconds.tolist()):
            present.update(person.seconds.tolist())
            kept[str(number)] = person
    who, listed = "the first, largest one is tracked", "; ".join(person.words(width) for person in people)
    if len(kept) > 1:
        who = f"{', '.join(kept)} are never in view together and are tracked as one person"
    found = only(images, [(0, _joined([*kept.values()]))])
    return found, f"{len(people)} people in the images of {camera}, {who}: {listed}."


def who_in_words(people: Sequence[Person], chosen: Sequence[int], width: int) -> str:
    """Return who is in the images and who is tracked; empty for one person. width: of the images, px."""
    if len(people) < 2:
        return ""
    numbers = " and ".join(str(i + 1) for i in chosen)
    listed = "; ".join(f"{number}: {person.words(width)}" for number, person in enumerate(people, 1))
    tracked = f"number {numbers} is tracked" if len(chosen) == 1 else f"numbers {numbers} are tracked"
    return f"{len(people)} people in the images, {tracked} (`--person`). {listed}."


def number_of(who: str) -> int:
    """Return the number that `who` is. Raises PersonError if it is none of 1, 2, ..."""
    if not who.isascii() or not who.isdecimal() or int(who) < 1:
        raise PersonError(f"--person '{who}'; expected {NEAREST}, {LARGEST}, {ALL} or a number from 1")
    return int(who)


def settings_for(who: str, live: bool) -> list[str]:
    """Return the parameters name:=value that follow from --person. Raises PersonError.

    live: the images come one by one, so that the tracker chooses the person in the first of them.
    """
    if who == ALL:
        return [f"max_people:={MOST_PEOPLE}"]
    if who not in (LARGEST, NEAREST):
        number_of(who)
        if live:
            raise PersonError(
                f"--person {who}: people are numbered in files only; expected {NEAREST} or {ALL} for a camera and "
                "with --causal"
            )
    return [f"follow:={NEAREST}"] if live else []


def _size_px(person: Detected) -> float:
    """Return the diagonal of the points that the tracker would use, px; 0 without any."""
    sure = person.pixels[person.confidence >= TrackerConfig().min_confidence]
    return float(np.linalg.norm(np.ptp(sure, axis=0))) if len(sure) else 0.0
