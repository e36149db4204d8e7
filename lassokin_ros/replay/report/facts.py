"""The data of the page: log, counts and settings of the replay, and quantities derived from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.body import floor_height
from lassokin_ros.replay.report.log import PersonRow, ReplayLog
from lassokin_ros.replay.report.spans import Span, WrongSpan, spans_of, usual_period, wrong_spans


@dataclass(frozen=True, eq=False)
class Facts:
    """The data of a finished replay.

    title: name of the recording. topics: keypoint topic and camera_info topic. counts: counters of the session.
    landmarks: names in layout order. skeleton: the skeleton before calibration. image_size: (width, height) px, None
    without camera_info. own_keypoints: True if this program detected the keypoints in images, False for recorded ones.
    other_sizes: `image_size` of further cameras. level: (3, 3) rotation from the frame of the rows' positions to that
    of a level camera.
    """

    title: str
    topics: tuple[str, str]
    log: ReplayLog
    counts: Mapping[str, int]
    tracker: TrackerConfig
    node: NodeSettings
    skeleton: Skeleton
    landmarks: tuple[str, ...]
    image_size: tuple[int, int] | None
    own_keypoints: bool = False
    other_sizes: tuple[tuple[int, int] | None, ...] = ()
    level: np.ndarray = field(default_factory=lambda: np.eye(3))

    @property
    def cameras(self) -> dict[str, tuple[int, int] | None]:
        """The image size of each camera by name; the name of the only camera is empty."""
        return dict(zip(self.node.camera_names, (self.image_size, *self.other_sizes)))

    @property
    def received(self) -> int:
        """Number of keypoint messages; with several cameras, number of instants with messages."""
        return self.counts.get("received", 0) if len(self.cameras) == 1 else len(self.log.messages)

    @property
    def tracked(self) -> int:
        """Number of those with a skeleton. The session's count has images without people, and lacks held instants."""
        return sum(message.people > 0 for message in self.log.messages)

    @cached_property
    def people(self) -> list[str]:
        """Ids in order of first appearance; one empty id in single-person mode."""
        return [""] if not self.node.several_people else list(self.log.people)

    def rows(self, person: str) -> list[PersonRow]:
        """Return the rows of one person, including rejected ones."""
        return self.log.people.get(person, [])

    def accepted(self, person: str) -> list[PersonRow]:
        """Return the rows of one person with a skeleton."""
        return [row for row in self.rows(person) if row.rejection is None]

    @cached_property
    def tracks(self) -> list[PersonRow]:
        """The rows of all people with a skeleton."""
        return [row for person in self.people for row in self.accepted(person)]

    @cached_property
    def spans(self) -> dict[str, list[Span]]:
        """The gaps of each person."""
        whole = not self.node.several_people
        return {
            person: spans_of(self.rows(person), self.log.messages, self.tracker.lost_after, whole)
            for person in self.people
        }

    @cached_property
    def wrong(self) -> dict[str, list[WrongSpan]]:
        """The spans of each person in which the pose is likely wrong."""
        return {person: wrong_spans(self.accepted(person)) for person in self.people}

    @property
    def wrong_share(self) -> float:
        """Share of the skeletons that lie in these spans."""
        marked = sum(
            any(span.contains(row.time) for span in self.wrong[person])
            for person in self.people
            for row in self.accepted(person)
        )
        return marked / max(len(self.tracks), 1)

    @cached_property
    def times(self) -> np.ndarray:
        """(m,) s: time of each message."""
        return np.array([message.time for message in self.log.messages])

    @property
    def duration(self) -> float:
        """Time from the first message to the last, s."""
        return float(self.times.max()) if len(self.times) else 0.0

    @cached_property
    def rate(self) -> float:
        """Keypoint rate, Hz: the inverse of the median period; 0 for fewer than two messages."""
        period = usual_period(self.times)
        return 1 / period if period > 0 else 0.0

    @property
    def rejected(self) -> dict[str, int]:
        """Number of rejected messages, per-person frames and camera_info messages, by reason."""
        found = {key.partition(": ")[2]: n for key, n in self.counts.items() if key.startswith("rejected: ") and n}
        return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))

    @property
    def initialisations(self) -> int:
        """Number of initialisations."""
        return sum(row.initialised for row in self.tracks)


def floor_of(facts: Facts, person: str) -> float:
    """Return the floor's height above the camera, m, in a level frame; NaN if the feet are seen in few frames."""
    rows = [row for row in facts.accepted(person) if row.positions is not None and row.observed is not None]
    if not rows:
        return float("nan")
    positions, observed, contacts = (
        np.array([getattr(row, name) for row in rows]) for name in ("positions", "observed", "contacts")
    )
    names, height = facts.skeleton.joint_names, facts.skeleton.height
    return floor_height(names, height, positions, observed, contacts, facts.level)


def bone_changes(facts: Facts, person: str) -> list[tuple[str, float, float]]:
    """Return (joint, length at the end in mm, relative change) of each bone, named by the joint at which it ends."""
    lengths = [row.lengths for row in facts.accepted(person) if row.lengths is not None]
    if not lengths:
        return []
    given = np.linalg.norm(facts.skeleton.offsets, axis=-1)
    return [
        (name, 1e3 * float(end), float(end / start - 1))
        for name, start, end in zip(facts.skeleton.joint_names, given, lengths[-1])
        if start > 1e-6
    ]


def landmark_errors(facts: Facts, rows: list[PersonRow]) -> tuple[np.ndarray, np.ndarray]:
    """Return per landmark: median distance between detected and reprojected point (l,) px, share of frames (l,).

    A landmark that the detector places, but hardly sees, does not count as seen.
    """
    count, numbers = len(facts.landmarks), range(len(facts.cameras))
    pairs = [(row.in_view("detected", k), row.in_view("reprojected", k)) for row in rows for k in numbers]
    apart = [seen - back for seen, back in pairs if seen is not None and back is not None]
    if not apart:
        return np.full(count, np.nan), np.zeros(count)
    distance = np.linalg.norm(np.array(apart), axis=-1)
    found = np.isfinite(distance).any(axis=0)
    middle = np.full(count, np.nan)
    middle[found] = np.nanmedian(distance[:, found], axis=0)
    return middle, np.mean([row.visible for row in rows], axis=0)
