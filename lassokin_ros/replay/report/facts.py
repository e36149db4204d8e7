"""The data of the page: frames, counts and settings of the replay, and quantities derived from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.frames import DETECTED, REPROJECTED, FrameTable, in_view
from lassokin_ros.replay.spans import Span, WrongSpan, marked, spans_of, usual_period, wrong_spans


@dataclass(frozen=True, eq=False)
class Facts:
    """The data of a finished replay.

    title: name of the recording. topics: keypoint topic and camera_info topic. counts: counters of the session.
    landmarks: names in layout order. skeleton: the skeleton before calibration. sizes: (width, height) px of each
    camera's image, None without camera_info. own_keypoints: True if this program detected the keypoints in images,
    False for recorded ones. level: (3, 3) rotation from the frame of the skeleton to that of a level camera.
    """

    title: str
    topics: tuple[str, str]
    table: FrameTable
    counts: Mapping[str, int]
    tracker: TrackerConfig
    node: NodeSettings
    skeleton: Skeleton
    landmarks: tuple[str, ...]
    sizes: tuple[tuple[int, int] | None, ...]
    own_keypoints: bool = False
    level: np.ndarray = field(default_factory=lambda: np.eye(3))

    @property
    def image_size(self) -> tuple[int, int] | None:
        """(width, height) px of the first camera's image; None without camera_info."""
        return self.sizes[0]

    @property
    def received(self) -> int:
        """Number of keypoint messages; with several cameras, number of instants with messages."""
        return self.counts.get("received", 0) if len(self.sizes) == 1 else len(self.table.messages)

    @property
    def tracked(self) -> int:
        """Number of those with a skeleton. The session's count has images without people, and lacks held instants."""
        return sum(message.people > 0 for message in self.table.messages)

    @cached_property
    def people(self) -> list[str]:
        """Ids in order of first appearance; one empty id if one person is followed."""
        return [""] if not self.node.several_people else list(self.table.people)

    @cached_property
    def _columns(self) -> dict[str, Mapping[str, np.ndarray]]:
        return {person: self.table.columns(person) for person in self.people or [""]}

    def rows(self, name: str, person: str | None = None) -> np.ndarray:
        """Return a column of the table, (f, ...), with the rejected frames: of one person, by default of all."""
        found = [columns[name] for one, columns in self._columns.items() if person in (None, one)]
        return found[0] if len(found) == 1 else np.concatenate(found)

    def of(self, name: str, person: str | None = None) -> np.ndarray:
        """Return a column of the frames with a skeleton, (f, ...): of one person, by default of all."""
        values, accepted = self.rows(name, person), self.rows("accepted", person)
        return values if accepted.all() else values[accepted]

    def median(self, name: str) -> float:
        """Return the median of a figure over the frames with a skeleton; NaN if there are none."""
        return float(np.median(self.of(name))) if self.skeletons else float("nan")

    @cached_property
    def skeletons(self) -> int:
        """Number of frames with a skeleton, of all people together."""
        return sum(int(columns["accepted"].sum()) for columns in self._columns.values())

    @cached_property
    def spans(self) -> dict[str, list[Span]]:
        """The gaps of each person."""
        given = self.table.messages, self.tracker.lost_after, not self.node.several_people
        return {person: spans_of(self.of("time", person).tolist(), *given) for person in self.people}

    @cached_property
    def wrong(self) -> dict[str, list[WrongSpan]]:
        """The spans of each person in which the pose is likely wrong."""
        doubts = {person: [doubt for doubt in self.table.of(person).doubts if doubt] for person in self.people}
        return {person: wrong_spans(self.of("time", person), own) for person, own in doubts.items()}

    @property
    def wrong_share(self) -> float:
        """Share of the skeletons that lie in these spans."""
        lying = sum(int(marked(self.of("time", person), self.wrong[person]).sum()) for person in self.people)
        return lying / max(self.skeletons, 1)

    @cached_property
    def times(self) -> np.ndarray:
        """(m,) s: time of each message."""
        return np.array([message.time for message in self.table.messages])

    @property
    def duration(self) -> float:
        """Time from the first message to the last, s."""
        return float(self.times.max(initial=0.0))

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


def bends(rotations: np.ndarray) -> np.ndarray:
    """Return (f, n) degrees, by how much joints turn. rotations: (f, n, 3, 3), of each in its parent's frame."""
    return np.degrees(np.linalg.norm(logarithm(rotations), axis=-1))


def bone_changes(facts: Facts, people: Iterable[str]) -> list[tuple[str, str, float, float]]:
    """Return (person, joint, length at the end in mm, relative change) of each bone, by the joint at which it ends."""
    given, found = np.linalg.norm(facts.skeleton.offsets, axis=-1), []
    for person in people:
        last = facts.table.of(person).last
        if last is not None and last.skeleton is not None:
            ends = np.linalg.norm(last.skeleton.offsets, axis=-1)
            bones = zip(facts.skeleton.joint_names, given, ends)
            found += [(person, name, 1e3 * float(b), float(b / a - 1)) for name, a, b in bones if a > 1e-6]
    return found


def landmark_errors(facts: Facts, person: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return per landmark: median distance between detected and reprojected point (l,) px, share of frames (l,).

    person: None for all. A landmark that the detector places, but hardly sees, does not count as seen.
    """
    count = len(facts.landmarks)
    if not len(facts.of("time", person)):
        return np.full(count, np.nan), np.zeros(count)
    pairs = [[facts.of(in_view(name, k), person) for name in (DETECTED, REPROJECTED)] for k in range(len(facts.sizes))]
    distance = np.linalg.norm(np.concatenate([seen - back for seen, back in pairs]), axis=-1)
    found = np.isfinite(distance).any(axis=0)
    middle = np.full(count, np.nan)
    middle[found] = np.nanmedian(distance[:, found], axis=0)
    return middle, facts.of("visible", person).mean(axis=0)
